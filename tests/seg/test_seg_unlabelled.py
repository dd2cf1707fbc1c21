"""Photographs without labels: which are found, how they are read, what is refused."""

import numpy as np
import pytest

from seg.data import DataError, list_unlabelled, load_unlabelled

from .conftest import write_image


def test_images_of_all_sizes_in_all_folders_come_sorted(tmp_path):
    write_image(tmp_path / "b" / "1.png", 0, (6, 8))
    write_image(tmp_path / "a" / "2.jpg", 1, (12, 16))
    (tmp_path / "notes.txt").write_text("no image")
    paths = list_unlabelled(tmp_path)
    assert [p.name for p in paths] == ["2.jpg", "1.png"]
    images = load_unlabelled(paths, (3, 4))
    assert images.shape == (2, 3, 4, 3) and images.dtype == np.uint8


def test_area_averages_where_an_image_shrinks(tmp_path):
    write_image(tmp_path / "1.png", 3, (6, 8))
    (whole,) = load_unlabelled(list_unlabelled(tmp_path), (6, 8))
    (half,) = load_unlabelled(list_unlabelled(tmp_path), (3, 4))
    mean = whole.reshape(3, 2, 4, 2, 3).mean(axis=(1, 3))
    assert np.abs(half - mean).max() <= 0.5


def test_bad_folders_are_named(tmp_path):
    with pytest.raises(DataError, match="nowhere: no such folder"):
        list_unlabelled(tmp_path / "nowhere")
    with pytest.raises(DataError, match="zero images"):
        list_unlabelled(tmp_path)
    for name in ("a", "b"):
        write_image(tmp_path / name / "1.png")
    with pytest.raises(DataError, match="the same name"):
        list_unlabelled(tmp_path)
    (tmp_path / "a" / "1.png").write_text("no image")
    (tmp_path / "b" / "1.png").unlink()
    with pytest.raises(DataError, match="broken"):
        load_unlabelled(list_unlabelled(tmp_path), (3, 4))
