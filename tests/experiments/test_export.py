"""Datasets on disk: seg's own reader of Cityscapes reads what the engine writes."""

import numpy as np
import pytest
from PIL import Image

import scene
from scene.dataset.export import read_dataset
from scene.proposal import draw, random_proposal
from seg.classes import CITYSCAPES_19
from seg.data import read_cityscapes

SETTINGS = scene.RenderSettings(64, 48)
OPTIONS = {"shots": 3, "settings": SETTINGS, "pool": scene.AssetPool(0, 3)}


@pytest.fixture(scope="module")
def units():
    return draw(random_proposal(), 0, 2)


@pytest.fixture(scope="module")
def dataset(units, tmp_path_factory):
    folder = tmp_path_factory.mktemp("export") / "dataset"
    scene.export_dataset(units, 7, folder, **OPTIONS)
    return folder


def test_both_readers_give_what_was_rendered(units, dataset):
    rendered = scene.render_dataset(units, 7, **OPTIONS)
    found, again = read_cityscapes(dataset, "train"), read_dataset(dataset)
    for images in (found.images, again.images):
        np.testing.assert_array_equal(images, rendered.images)
    np.testing.assert_array_equal(again.labels, rendered.labels)
    np.testing.assert_array_equal(found.labels, CITYSCAPES_19.from_train_id[rendered.labels])
    assert found.names[0] == "scenex_000000_000000" and found.names[-1] == "scenex_000001_000002"


def test_label_ids_and_colours_by_hand(dataset):
    folder = dataset / "gtFine" / "train" / "scenex"
    ids = np.asarray(Image.open(folder / "scenex_000000_000000_gtFine_labelIds.png"))
    colour = np.asarray(Image.open(folder / "scenex_000000_000000_gtFine_color.png"))
    label = read_dataset(dataset).labels[0]
    for train_id, label_id, rgb in ((0, 7, (128, 64, 128)), (10, 23, (70, 130, 180))):
        assert (label == train_id).any()
        assert (ids[label == train_id] == label_id).all()
        assert (colour[label == train_id] == rgb).all()
