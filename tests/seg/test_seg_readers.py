"""The readers of Cityscapes, GTA5, SYNTHIA and KITTI, on tiny folders in their public layouts."""

from collections import namedtuple
from functools import partial

import numpy as np
import pytest
from PIL import Image

from seg.classes import CITYSCAPES_19, IGNORE_LABEL
from seg.data import list_cityscapes, list_folders, read_cityscapes, read_folders
from seg.data.folders import LAYOUTS

from .conftest import H, W, label_values, refuses, refuses_file, write_image, write_label


def write_palette(path, values):
    write_label(path, values)  # makes the folder
    picture = Image.fromarray(values.astype(np.uint8), mode="P")
    picture.putpalette(list(range(256)) * 3)
    picture.save(path)


def write_packed(path, values, dtype=np.uint16):
    instances = np.arange(values.size).reshape(values.shape)
    write_label(path, np.stack([np.zeros_like(values), instances, values], axis=2), dtype)


# A data set of three images: its files, how labels are written, and how all is read.
Case = namedtuple("Case", "images labels names highest table write list read")


def folders(layout, highest, write):
    where = LAYOUTS[layout]
    return Case(
        f"{where.images}/{{}}.png", f"{where.labels}/{{}}.png", ("00000", "00001", "00002"),
        highest, where.table, write,
        partial(list_folders, layout=layout), partial(read_folders, layout=layout),
    )  # fmt: skip


CASES = {
    "cityscapes": Case(
        "leftImg8bit/train/{}_leftImg8bit.png", "gtFine/train/{}_gtFine_labelIds.png",
        ("aachen/aachen_000001_000019", "aachen/aachen_000002_000019", "bonn/bonn_000001_000019"),
        33, CITYSCAPES_19, write_label,
        partial(list_cityscapes, split="train"), partial(read_cityscapes, split="train"),
    ),
    "gta5": folders("gta5", 34, write_palette),
    "synthia": folders("synthia", 22, write_packed),
    "kitti": folders("kitti", 33, write_label),
}  # fmt: skip


@pytest.fixture(params=CASES)
def case(request):
    return CASES[request.param]


@pytest.fixture
def root(tmp_path, case):
    for i, name in enumerate(case.names):
        write_image(tmp_path / case.images.format(name), i)
        case.write(tmp_path / case.labels.format(name), label_values(i, case.highest))
    return tmp_path


def test_public_layout_is_read_at_any_size_and_limit(root, case):
    data = case.read(root)
    assert data.names == tuple(name.rpartition("/")[2] for name in case.names)
    cities = tuple(name.partition("/")[0] for name in case.names if "/" in name)
    assert data.sequences == (cities or (data.sequences[0],) * 3)
    assert data.images.shape == (3, H, W, 3)
    for seed, label in enumerate(data.labels):
        expected = case.table.from_file[label_values(seed, case.highest)]
        np.testing.assert_array_equal(label, expected)
    data, again = (case.read(root, size=(3, 4), limit=2, seed=5) for _ in range(2))
    assert data.labels.shape == (2, 3, 4) and data.names == again.names
    np.testing.assert_array_equal(data.images, again.images)


def test_missing_labels_images_and_folders(root, case):
    (root / case.labels.format(case.names[1])).unlink()
    refuses_file(r"00001.*\.png: image without label; expected .*00001", case.list, root)
    for name in case.names:
        (root / case.images.format(name)).unlink()
    refuses_file("zero images; expected", case.list, root)
    top = case.labels.partition("/")[0]
    (root / top).rename(root / "elsewhere")
    refuses_file(f"{top}.*: no such folder; expected", case.list, root)
    refuses_file(r"gone.*: no such folder; expected", case.list, root / "gone")


def test_sizes_that_disagree_and_values_outside_the_table(root, case):
    write_image(root / case.images.format(case.names[1]), 1, (H + 1, W))
    refuses_file(r"8x6 pixels, but its image .* has 8x7", case.read, root)
    case.write(root / case.labels.format(case.names[1]), np.full((H + 1, W), 1))
    refuses_file(r"8x7 pixels where .* has 8x6; give a size", case.read, root)
    case.write(root / case.labels.format(case.names[0]), np.full((H, W), case.highest + 1))
    refuses_file(f"label value {case.highest + 1} lies outside", case.read, root)


@pytest.mark.parametrize(("table", "values"), [
    ("gta5", {7: "road", 11: "building", 23: "sky", 33: "bicycle", 34: None, 0: None}),
    ("kitti", {7: "road", 26: "car", 24: "person", 17: "pole", 4: None, 16: None, 30: None}),
    ("synthia", {1: "sky", 3: "road", 21: "wall", 10: "person", 11: "bicycle", 20: "train",
                 15: "traffic light", 0: None, 13: None, 22: None}),
])  # fmt: skip
def test_values_in_files_mean_what_the_data_sets_say(table, values):
    table = CASES[table].table
    for value, name in values.items():
        expected = IGNORE_LABEL if name is None else CITYSCAPES_19.classes.index(name)
        assert table.legal[value] and table.from_file[value] == expected


def test_missing_splits_and_layouts_list_those_that_exist(tmp_path):
    for part in ("leftImg8bit/train", "leftImg8bit/val", "gtFine/train"):
        (tmp_path / part).mkdir(parents=True)
    missing = "leftImg8bit: no split 'test'; splits there: train, val"
    refuses_file(missing, list_cityscapes, tmp_path, "test")
    refuses_file("gtFine: no split 'val'; splits there: train", list_cityscapes, tmp_path, "val")
    refuses("unknown layout 'gta6'; known: gta5, synthia, kitti", list_folders, tmp_path, "gta6")


@pytest.mark.parametrize("write", [partial(write_packed, dtype=np.uint8), write_label])
def test_packed_labels_of_other_channels_or_bits(tmp_path, write):
    write_image(tmp_path / "RGB" / "0.png")
    write(tmp_path / "GT" / "LABELS" / "0.png", label_values(0, 22))
    message = r"[13] channel\(s\) of 8 bits; expected three of 16"
    refuses_file(message, read_folders, tmp_path, "synthia")
