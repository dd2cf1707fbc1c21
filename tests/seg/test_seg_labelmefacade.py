"""The LabelMeFacade reader, on tiny folders and on the real one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from seg.classes import CAMVID_11, IGNORE_LABEL, LABELMEFACADE_6
from seg.data import list_labelmefacade, load_labelmefacade, read_labelmefacade, subset
from seg.data.labelled import cut
from seg.data.labelmefacade import ASPECT, COLORS, read_colors

from .conftest import pixels, refuses_file

NAMES = ("town__p10", "boston_may__img_7", "town__p9")  # as they are listed
SORTED = ("boston_may__img_7", "town__p10", "town__p9")
SIZE = (6, 8)


def paint(root, name, image, ids):
    """A photograph u8[h w 3] and the colours of its labels, places of `COLORS`."""
    for folder, suffix, picture in (
        ("images", ".jpg", image),
        ("labels", ".png", np.array(COLORS, np.uint8)[ids]),
    ):
        (root / folder).mkdir(exist_ok=True)
        Image.fromarray(picture).save(root / folder / f"{name}{suffix}")


def ids_of(name, size=SIZE):
    return pixels(*size, seed=NAMES.index(name), below=len(COLORS))


@pytest.fixture
def root(tmp_path):
    """Three photographs of two albums in a list, and one more for tests."""
    for name in NAMES:
        paint(tmp_path, name, pixels(*SIZE, 3), ids_of(name))
    (tmp_path / "train.txt").write_text("\n".join(NAMES) + "\n\n")
    return tmp_path


def test_photographs_come_by_album_with_the_classes_of_their_colours(root):
    data = read_labelmefacade(root, "train")
    assert data.names == SORTED and data.sequences == ("boston_may__img", "town__p", "town__p")
    assert data.images.shape == (3, *SIZE, 3) and data.images.dtype == np.uint8
    by_hand = {
        (128, 0, 0): "building", (128, 128, 0): "building", (0, 0, 128): "building",
        (128, 0, 128): "car", (128, 128, 128): "sidewalk", (128, 64, 0): "road",
        (0, 128, 128): "sky", (0, 128, 0): "vegetation", (0, 0, 0): None,
    }  # fmt: skip
    assert tuple(by_hand) == COLORS
    for name, label in zip(data.names, data.labels, strict=True):
        colors = np.asarray(Image.open(root / "labels" / f"{name}.png"))
        for place in np.ndindex(SIZE):
            own = by_hand[tuple(colors[place].tolist())]
            expected = IGNORE_LABEL if own is None else LABELMEFACADE_6.classes.index(own)
            assert label[place] == expected
    assert read_labelmefacade(root, "train", limit=2, seed=1).names == tuple(
        entry.name for entry in subset(list_labelmefacade(root, "train"), 2, 1)
    )


@pytest.mark.parametrize(("name", "album"), [
    ("static_street__p1010213", "static_street__p"), ("a__set2__img_1579", "a__set2__img"),
    ("a__img-10.21op9-p-015t", "a__img-10.21op9-p-"), ("boston_street__0095", "boston_street"),
    ("laredo__street_espiritu_santo", "laredo__street_espiritu_santo"), ("0095", "0095"),
])  # fmt: skip
def test_an_album_is_what_comes_before_the_last_number(tmp_path, name, album):
    paint(tmp_path, name, pixels(*SIZE, 3), pixels(*SIZE, below=9))
    (tmp_path / "some.txt").write_text(name)
    assert [entry.sequence for entry in list_labelmefacade(tmp_path, "some")] == [album]


def test_transparency_and_palettes_change_no_label(root):
    path = root / "labels" / f"{NAMES[0]}.png"
    expected = LABELMEFACADE_6.from_file[ids_of(NAMES[0])]
    transparent = Image.open(path).convert("RGBA")
    transparent.putalpha(7)
    palette = Image.fromarray(ids_of(NAMES[0]))
    palette.putpalette(np.array(COLORS).ravel().tolist())
    for picture in (transparent, palette):
        picture.save(path)
        assert Image.open(path).mode == picture.mode in ("RGBA", "P")
        np.testing.assert_array_equal(read_colors(path, LABELMEFACADE_6), expected)


@given(st.integers(1, 90), st.integers(1, 90), st.sampled_from([4 / 3, 1.0, 2.5, 0.4]))
def test_a_cut_is_the_largest_of_its_aspect_around_the_centre(height, width, aspect):
    rows, columns = np.mgrid[:height, :width]
    found = cut(np.dstack([rows, columns]), aspect)
    high, wide = found.shape[:2]
    assert high == height or wide == width  # no more is lost than must be
    assert abs(wide - high * aspect) <= max(1, aspect) * 0.5 + 1e-9 or 1 in (high, wide)
    for axis, whole in ((0, height), (1, width)):
        before, after = found[0, 0, axis], whole - 1 - found[-1, -1, axis]
        assert 0 <= after - before <= 1


@pytest.mark.parametrize(("size", "kept"), [
    ((512, 683), (512, 683)), ((512, 768), (512, 683)), ((683, 512), (384, 512)),
    ((512, 512), (384, 512)), ((6, 8), (6, 8)), ((1, 1), (1, 1)),
])  # fmt: skip
def test_cuts_by_hand(size, kept):
    assert cut(np.zeros(size), ASPECT).shape == kept


@pytest.mark.parametrize("size", [(6, 8), (12, 16), (12, 12), (3, 4)])
@pytest.mark.parametrize("across", [True, False], ids=["wide", "high"])
def test_image_and_label_are_cut_alike_before_they_are_resized(tmp_path, size, across):
    # Sky and road in the middle, between edges of building that a cut to 4:3 takes away.
    ids = np.zeros((24, 48) if across else (48, 32), int)
    middle = ids[:, 8:40] if across else ids[12:36]
    middle[:12], middle[12:] = 6, 5
    paint(tmp_path, "p1", np.array(COLORS, np.uint8)[ids], ids)
    (tmp_path / "train.txt").write_text("p1")
    data = read_labelmefacade(tmp_path, "train", size)
    sky, road = (LABELMEFACADE_6.classes.index(name) for name in ("sky", "road"))
    expected = np.repeat([sky, road], [size[0] // 2, size[0] - size[0] // 2])
    if size[0] % 2 == 0:
        np.testing.assert_array_equal(data.labels[0], np.tile(expected[:, None], size[1]))
    assert set(data.labels.ravel().tolist()) == {sky, road}
    assert data.images[0, 0].mean() > 70 and data.images[0, -1].mean() < 70  # sky over road
    assert np.ptp(data.images[0, 0, :, 2].astype(int)) < 40  # no edge of building beside the sky


def test_what_is_missing_or_not_as_it_should_be(root):
    listing, name = root / "train.txt", NAMES[1]
    image, label = root / "images" / f"{name}.jpg", root / "labels" / f"{name}.png"
    listed = list_labelmefacade, root, "train"
    refuses_file(r"gone: no such folder; expected LabelMeFacade", listed[0], root / "gone", "train")
    refuses_file(r"no split 'test'.*Splits there: train", listed[0], root, "test")
    text = listing.read_text()
    for content, message in (
        ("\n \n", ": zero images in split 'train'"), (f"{text}{name}", f", line 5: {name} is listed twice"),
        ("\xff\xfe\x00", ": not a readable text file"), ("\nnone_1", ", line 2: no image .*none_1"),
        ("../labels/a_1", r", line 1: \.\./labels/a_1 leads out of .*images"),
    ):  # fmt: skip
        listing.write_text(content, encoding="latin-1")
        refuses_file(rf"train\.txt{message}", *listed)
    listing.write_text(text)
    data, pixels_of_label = label.read_bytes(), np.array(Image.open(label))
    label.unlink()
    refuses_file(rf"{name}\.jpg: image without label; expected .*{name}\.png", *listed)
    read = read_labelmefacade, root, "train"
    label.write_bytes(data[: len(data) // 2])
    refuses_file(rf"{name}\.png: not a readable image", *read)
    Image.fromarray(pixels_of_label[:, 1:]).save(label)
    refuses_file(rf"{name}\.png: 7x6 pixels, but its image .*{name}\.jpg has 8x6", *read)
    label.write_bytes(data)
    image.write_bytes(image.read_bytes()[:200])
    refuses_file(rf"{name}\.jpg: not a readable image", *read)
    image.unlink()
    refuses_file(rf"train\.txt, line 2: no image .*{name}\.jpg", *listed)
    refuses_file("zero images to load", load_labelmefacade, ())


@given(st.tuples(*[st.integers(0, 255)] * 3).filter(lambda color: color not in COLORS))
def test_any_colour_of_no_class_is_named_with_its_file(tmp_path_factory, color):
    path = tmp_path_factory.getbasetemp() / "odd.png"
    painted = np.array(COLORS, np.uint8)[[[0, 1, 2], [3, 4, 5]]]
    painted[1, 2] = color
    Image.fromarray(painted).save(path)
    message = (
        r"odd\.png: colour \({}, {}, {}\) lies outside the labelmefacade table; its colours are "
    )
    refuses_file(message.format(*color), read_colors, path, LABELMEFACADE_6)


def test_smoothed_labels_and_labels_of_ids_are_refused(tmp_path):
    path = tmp_path / "label.png"
    Image.fromarray(pixels(9, 9, 3)).save(path)
    refuses_file(r"colour (\(.*\), ){2}\(.*\) and 78 more", read_colors, path, LABELMEFACADE_6)
    Image.fromarray(np.full((3, 4), 5, np.uint8)).save(path)
    refuses_file(r"colour \(5, 5, 5\) lies", read_colors, path, CAMVID_11)


def test_real_labelmefacade(labelmefacade_dir):
    train, test = (list_labelmefacade(labelmefacade_dir, split) for split in ("train", "test"))
    assert (len(train), len(test)) == (100, 300)
    assert not {entry.name for entry in train} & {entry.name for entry in test}
    # The published lists cut through albums: photographs of most training albums are in both.
    albums, reported = ({entry.sequence for entry in side} for side in (train, test))
    assert (len(albums), len(reported), len(albums & reported)) == (43, 81, 32)
    data = load_labelmefacade(subset(train, 40, seed=1), size=(90, 120))
    share = np.bincount(data.labels.ravel(), minlength=256) / data.labels.size
    # Shares over all 100 images; void is .04.
    for name, expected in (("building", 0.54), ("road", 0.14), ("sky", 0.11), ("car", 0.04)):
        found = share[LABELMEFACADE_6.classes.index(name)]
        assert found == pytest.approx(expected, abs=0.06)
    assert 0 < share[IGNORE_LABEL] < 0.1
    sky, road = (
        data.images[data.labels == LABELMEFACADE_6.classes.index(n)].mean() for n in ("sky", "road")
    )
    assert sky > road + 40


@pytest.mark.slow
def test_every_colour_in_the_real_files_is_known(labelmefacade_dir):
    for split in ("train", "test"):
        for entry in list_labelmefacade(labelmefacade_dir, split):
            label = read_colors(entry.label_path, LABELMEFACADE_6)
            assert np.mean(label == IGNORE_LABEL) < 0.5, entry.name
