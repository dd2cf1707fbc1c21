"""Datasets on disk: seg's own reader of Cityscapes reads what the engine writes."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scene.classes import VOID
from scene.dataset import Dataset
from scene.export import write_cityscapes
from seg.classes import CITYSCAPES_19, IGNORE_LABEL
from seg.data import read_cityscapes


@pytest.fixture
def dataset() -> Dataset:
    """Two streets of three shots; every train id occurs, and void."""
    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (6, 8, 16, 3), dtype=np.uint8)
    labels = np.resize(np.append(np.arange(19), VOID), (6, 8, 16)).astype(np.uint8)
    return Dataset(images, labels)


def test_round_trip_through_the_reader(dataset, tmp_path):
    write_cityscapes(dataset, tmp_path / "dataset", shots=3)
    found = read_cityscapes(tmp_path / "dataset", "train")
    np.testing.assert_array_equal(found.images, dataset.images)
    np.testing.assert_array_equal(found.labels, CITYSCAPES_19.from_train_id[dataset.labels])
    assert set(np.unique(found.labels)) == {*range(19), IGNORE_LABEL}
    assert found.names[0] == "scenex_000000_000000" and found.names[-1] == "scenex_000001_000002"


def test_label_ids_and_colours_by_hand(dataset, tmp_path):
    write_cityscapes(dataset, tmp_path / "dataset", shots=3)
    folder = tmp_path / "dataset" / "gtFine" / "train" / "scenex"
    ids = np.asarray(Image.open(folder / "scenex_000000_000000_gtFine_labelIds.png"))
    colour = np.asarray(Image.open(folder / "scenex_000000_000000_gtFine_color.png"))
    label = dataset.labels[0]
    for train_id, label_id, rgb in (
        (0, 7, (128, 64, 128)),
        (10, 23, (70, 130, 180)),
        (18, 33, (119, 11, 32)),
    ):
        assert (ids[label == train_id] == label_id).all()
        assert (colour[label == train_id] == rgb).all()
    assert (ids[label == VOID] == 0).all()


def test_an_earlier_dataset_is_replaced(dataset, tmp_path):
    write_cityscapes(dataset, tmp_path / "dataset", shots=3)
    write_cityscapes(Dataset(dataset.images[:2], dataset.labels[:2]), tmp_path / "dataset", shots=1)
    assert len(read_cityscapes(tmp_path / "dataset", "train").names) == 2
    assert [p.name for p in tmp_path.iterdir()] == ["dataset"]


def test_a_full_disk_is_named_and_leaves_the_earlier_dataset(dataset, tmp_path, monkeypatch):
    write_cityscapes(dataset, tmp_path / "dataset", shots=3)
    written = []

    def filling(path: Path, data: bytes) -> int:
        written.append(path)
        if len(written) > 4:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        with open(path, "wb") as file:
            return file.write(data)

    monkeypatch.setattr(Path, "write_bytes", filling)
    with pytest.raises(OSError) as caught:
        write_cityscapes(dataset, tmp_path / "dataset", shots=3)
    assert caught.value.errno == errno.ENOSPC and caught.value.filename == str(written[-1])
    monkeypatch.undo()
    assert [p.name for p in tmp_path.iterdir()] == ["dataset"]
    assert len(read_cityscapes(tmp_path / "dataset", "train").names) == 6


def test_what_a_kill_left_is_swept_away(dataset, tmp_path):
    (tmp_path / "dataset.part" / "leftImg8bit").mkdir(parents=True)
    write_cityscapes(dataset, tmp_path / "dataset", shots=3)
    assert [p.name for p in tmp_path.iterdir()] == ["dataset"]
