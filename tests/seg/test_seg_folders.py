"""The readers of GTA5, SYNTHIA and KITTI, on tiny folders in their public layouts."""

import cv2
import numpy as np
import pytest
from PIL import Image

from seg.classes import CITYSCAPES_19, IGNORE_LABEL, SYNTHIA_13, SYNTHIA_16
from seg.data import LAYOUTS, DataError, list_folders, read_folders

from .conftest import H, W, label_values, write_image, write_label

HIGHEST = {"gta5": 34, "synthia": 22, "kitti": 33}


def write_palette(path, values):
    path.parent.mkdir(parents=True, exist_ok=True)
    picture = Image.fromarray(values.astype(np.uint8), mode="P")
    picture.putpalette(list(range(256)) * 3)
    picture.save(path)


def write_packed(path, values, dtype=np.uint16):
    path.parent.mkdir(parents=True, exist_ok=True)
    instances = np.arange(values.size).reshape(values.shape)
    blue_green_red = np.stack([np.zeros_like(values), instances, values], axis=2)
    assert cv2.imwrite(str(path), blue_green_red.astype(dtype))


WRITE = {"gta5": write_palette, "synthia": write_packed, "kitti": write_label}


@pytest.fixture(params=LAYOUTS)
def layout(request):
    return request.param


@pytest.fixture
def root(tmp_path, layout):
    where = LAYOUTS[layout]
    for i in range(3):
        write_image(tmp_path / where.images / f"{i:05d}.png", i)
        WRITE[layout](tmp_path / where.labels / f"{i:05d}.png", label_values(i, HIGHEST[layout]))
    return tmp_path


def test_public_layout_is_read(root, layout):
    data = read_folders(root, layout)
    assert data.names == ("00000", "00001", "00002")
    assert data.images.shape == (3, H, W, 3)
    table = LAYOUTS[layout].table
    for seed, label in enumerate(data.labels):
        np.testing.assert_array_equal(label, table.from_file[label_values(seed, HIGHEST[layout])])


@pytest.mark.parametrize(
    ("layout", "values"),
    [
        ("gta5", {7: "road", 11: "building", 23: "sky", 33: "bicycle", 34: None, 0: None}),
        ("kitti", {7: "road", 26: "car", 24: "person", 4: None}),
        ("synthia", {1: "sky", 3: "road", 21: "wall", 10: "person", 11: "bicycle", 20: "train",
                     15: "traffic light", 0: None, 13: None, 22: None}),
    ],
)  # fmt: skip
def test_values_in_files_mean_what_the_data_sets_say(layout, values):
    from_file = LAYOUTS[layout].table.from_file
    for value, name in values.items():
        expected = IGNORE_LABEL if name is None else CITYSCAPES_19.classes.index(name)
        assert from_file[value] == expected


def test_every_class_can_occur(layout):
    assert set(LAYOUTS[layout].table.from_file) == {*range(19), IGNORE_LABEL}


def test_subsets_of_classes():
    names = CITYSCAPES_19.classes
    assert len(SYNTHIA_16) == 16
    assert len(SYNTHIA_13) == 13
    assert {names[k] for k in set(range(19)) - set(SYNTHIA_16)} == {"terrain", "truck", "train"}
    assert {names[k] for k in set(SYNTHIA_16) - set(SYNTHIA_13)} == {"wall", "fence", "pole"}


def test_size_limit_and_seed(root, layout):
    data = read_folders(root, layout, (3, 4), limit=2, seed=5)
    assert data.labels.shape == (2, 3, 4)
    assert data.names == read_folders(root, layout, (3, 4), limit=2, seed=5).names


def test_missing_folders_and_labels(root, layout):
    where = LAYOUTS[layout]
    (root / where.labels / "00001.png").unlink()
    with pytest.raises(DataError, match=r"00001\.png: image without label; expected .*00001"):
        list_folders(root, layout)
    (root / where.labels).rename(root / "elsewhere")
    with pytest.raises(DataError, match=f"{where.labels}: no such folder; expected {where.name}"):
        list_folders(root, layout)


def test_zero_images(tmp_path, layout):
    for part in (LAYOUTS[layout].images, LAYOUTS[layout].labels):
        (tmp_path / part).mkdir(parents=True)
    with pytest.raises(DataError, match="zero images"):
        list_folders(tmp_path, layout)


def test_an_unknown_layout_is_refused_by_name(tmp_path):
    with pytest.raises(ValueError, match="unknown layout 'gta6'; known: gta5, synthia, kitti"):
        list_folders(tmp_path, "gta6")


def test_sizes_that_disagree(root, layout):
    where = LAYOUTS[layout]
    write_image(root / where.images / "00001.png", 1, (H + 1, W))
    with pytest.raises(DataError, match=r"8x6 pixels, but its image .* has 8x7"):
        read_folders(root, layout)
    WRITE[layout](root / where.labels / "00001.png", np.full((H + 1, W), 1))
    with pytest.raises(DataError, match=r"8x7 pixels where .* has 8x6; give a size"):
        read_folders(root, layout)


def test_a_value_outside_the_table(root, layout):
    values = np.full((H, W), HIGHEST[layout] + 1)
    WRITE[layout](root / LAYOUTS[layout].labels / "00000.png", values)
    with pytest.raises(DataError, match=f"label value {HIGHEST[layout] + 1} lies outside"):
        read_folders(root, layout)


@pytest.mark.parametrize("layout", ["synthia"], indirect=True)
@pytest.mark.parametrize(
    ("write", "complaint"),
    [
        (
            lambda p, v: write_packed(p, v, np.uint8),
            r"3 channel\(s\) of 8 bits; expected three of 16",
        ),
        (write_label, r"1 channel\(s\) of 8 bits"),
    ],
)
def test_labels_of_other_channels_or_bits(root, layout, write, complaint):
    write(root / "GT" / "LABELS" / "00000.png", label_values(0, 22))
    with pytest.raises(DataError, match=complaint):
        read_folders(root, layout)


@pytest.mark.parametrize("layout", ["gta5"], indirect=True)
def test_palette_labels_saved_as_colours(root, layout):
    write_image(root / "labels" / "00000.png")
    with pytest.raises(DataError, match="a label of mode RGB, that is colours"):
        read_folders(root, layout)
