"""The Cityscapes reader, on tiny folders."""

import numpy as np
import pytest

from seg.classes import CITYSCAPES_19
from seg.data import DataError, list_cityscapes, read_cityscapes

from .conftest import H, W, label_values


def test_public_layout_is_read(cityscapes):
    data = read_cityscapes(cityscapes, "train")
    assert data.sequences == ("aachen", "aachen", "bonn", "bonn")
    assert data.names[0] == "aachen_000000_000019"
    assert data.images.shape == (4, H, W, 3)
    for label, seed in zip(data.labels, (2, 3, 0, 1), strict=True):
        np.testing.assert_array_equal(label, CITYSCAPES_19.from_file[label_values(seed, 33)])


def test_size_limit_and_seed(cityscapes):
    data = read_cityscapes(cityscapes, "train", (3, 4), limit=2, seed=5)
    again = read_cityscapes(cityscapes, "train", (3, 4), limit=2, seed=5)
    assert data.labels.shape == (2, 3, 4)
    assert data.names == again.names
    np.testing.assert_array_equal(data.images, again.images)


def test_missing_folders(cityscapes, tmp_path):
    with pytest.raises(DataError, match="gone: no such folder; expected Cityscapes"):
        list_cityscapes(tmp_path / "gone", "train")
    (cityscapes / "gtFine").rename(cityscapes / "gtCoarse")
    with pytest.raises(DataError, match="gtFine: no such folder"):
        list_cityscapes(cityscapes, "train")


def test_missing_split_lists_those_that_exist(cityscapes):
    with pytest.raises(DataError, match="leftImg8bit: no split 'val'; splits there: train"):
        list_cityscapes(cityscapes, "val")
    (cityscapes / "leftImg8bit" / "val").mkdir()
    with pytest.raises(DataError, match="gtFine: no split 'val'; splits there: train"):
        list_cityscapes(cityscapes, "val")


def test_image_without_label(cityscapes):
    next((cityscapes / "gtFine" / "train" / "bonn").iterdir()).unlink()
    with pytest.raises(DataError, match=r"leftImg8bit\.png: image without label; expected .*Ids"):
        list_cityscapes(cityscapes, "train")


def test_zero_images(cityscapes):
    for part in ("leftImg8bit", "gtFine"):
        (cityscapes / part / "val").mkdir()
    with pytest.raises(DataError, match=r"val: zero images; expected <city>"):
        list_cityscapes(cityscapes, "val")
