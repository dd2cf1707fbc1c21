"""The CamVid reader, on tiny folders and on the real one."""

import numpy as np
import pytest
from PIL import Image

from seg.classes import CAMVID_11
from seg.data import list_camvid, load, read_camvid, subset

from .conftest import H, W, label_values, refuses, refuses_file, write_label


@pytest.mark.parametrize("listed", ["published", "relative, with blank lines", "not"])
def test_public_lists_and_folders_without_lists_are_read(camvid, listed):
    text = (camvid / "train.txt").read_text().replace("/SegNet/CamVid/", "")
    if listed == "not":
        (camvid / "train.txt").unlink()
    elif listed != "published":
        (camvid / "train.txt").write_text(f"\n{text}\n\n")
    data = read_camvid(camvid, "train")
    assert data.names == ("0001TP_000001", "0001TP_000002", "Seq05VD_f00003")
    assert data.sequences == ("0001TP", "0001TP", "Seq05VD")
    assert data.images.shape == (3, H, W, 3) and data.images.dtype == np.uint8
    for i, label in enumerate(data.labels):
        np.testing.assert_array_equal(label, CAMVID_11.from_file[label_values(i, 11)])


@pytest.mark.parametrize(("listed", "on_disk"), [("png", "jpg"), ("jpg", "png")])
def test_the_extension_on_disk_wins(camvid, listed, on_disk):
    for path in (camvid / "train").iterdir():
        Image.open(path).save(path.with_suffix(f".{on_disk}"))
        if on_disk != "png":
            path.unlink()
    text = (camvid / "train.txt").read_text()
    (camvid / "train.txt").write_text(text.replace(".png /", f".{listed} /"))
    entries = list_camvid(camvid, "train")
    assert {entry.image_path.suffix for entry in entries} == {f".{on_disk}"}
    assert len(load(entries, CAMVID_11).images) == 3


def test_resizing(tmp_path):
    corners, fine = np.array([[0, 1], [2, 3]]), np.ones((6, 8), int)
    write_label(tmp_path / "trainannot" / "a_1.png", np.kron(corners, fine))
    write_label(tmp_path / "train" / "a_1.png", np.kron(60 * corners, fine)[..., None] * [1, 1, 1])
    for size in ((4, 4), (2, 2), (24, 32)):
        data = read_camvid(tmp_path, "train", size)
        assert data.images.shape == (1, *size, 3)
        blocks = np.kron(corners, np.ones((size[0] // 2, size[1] // 2), int))
        np.testing.assert_array_equal(data.labels, blocks[None])
        if size != (24, 32):
            np.testing.assert_array_equal(data.images[0, ..., 0], 60 * blocks)


def test_limit_is_a_seeded_subset_in_order(camvid):
    entries = list_camvid(camvid, "train")
    assert subset(entries, 2, seed=1) == subset(entries, 2, seed=1)
    assert len({subset(entries, 2, seed) for seed in range(20)}) == 3
    assert all(list(kept) == sorted(kept) for kept in (subset(entries, 2, s) for s in range(5)))
    assert subset(entries, 99) == subset(entries, None) == entries
    assert len(read_camvid(camvid, "train", limit=2).names) == 2
    refuses("limit must be at least 1", subset, entries, 0)


def test_what_is_missing_or_not_as_it_should_be(camvid):
    lines, name, kept = camvid / "train.txt", "0001TP_000002.png", camvid / "kept"
    image, label = camvid / "train" / name, camvid / "trainannot" / name
    listed = lines.read_text()
    for folder in ("val", "valannot"):
        (camvid / folder).mkdir()
    refuses_file(r"no split 'test'.*Splits there: train, val", list_camvid, camvid, "test")
    refuses_file("val: zero images", list_camvid, camvid, "val")
    refuses_file(r"gone: no such folder; expected CamVid", list_camvid, camvid / "gone", "train")
    refuses_file("zero images to load", load, (), CAMVID_11)
    refuses(r"size must be a positive \(height, width\)", read_camvid, camvid, "train", (0, 4))
    for text, message in (
        ("\n", ": zero images"), ("train/a.png\n", ", line 1: expected 'image label'"),
        ("\xff\xfe\x00", ": not a readable text file"),
    ):  # fmt: skip
        lines.write_text(text, encoding="latin-1")
        refuses_file(rf"train\.txt{message}", list_camvid, camvid, "train")
    lines.write_text(listed)
    image.rename(kept)
    refuses_file(r"0001TP_000002\.png: no such image", list_camvid, camvid, "train")
    kept.rename(image)
    label.unlink()
    missing = r"0001TP_000002\.png: image without label; expected .*png"
    refuses_file(missing, list_camvid, camvid, "train")
    lines.unlink()
    refuses_file(missing, list_camvid, camvid, "train")


def test_real_camvid(camvid_dir):
    entries = list_camvid(camvid_dir, "train")
    assert len(entries) == 367 and len(list_camvid(camvid_dir, "val")) == 101
    assert {entry.sequence for entry in entries} == {"0001TP", "0006R0", "0016E5"}
    data = load(subset(entries, 40, seed=1), CAMVID_11, (90, 120))
    share = np.bincount(data.labels.ravel(), minlength=256) / data.labels.size
    # Shares over all 367 images: road .32, building .23, sky .17, void .04.
    for name, expected in (("road", 0.32), ("building", 0.23), ("sky", 0.17)):
        assert share[CAMVID_11.classes.index(name)] == pytest.approx(expected, abs=0.06)
    assert 0 < share[255] < 0.1
    sky, road = (data.images[data.labels == i].mean() for i in (0, 3))
    assert sky > road + 40
