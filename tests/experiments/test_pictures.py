"""The three pictures: written whole, of the right things."""

import numpy as np
import pytest
from PIL import Image

from experiments.main import pictures
from experiments.run.search import Found
from experiments.target.base import Target
from scene.dataset.render import Dataset
from scene.proposal import random_proposal
from seg.classes import CAMVID_11, CITYSCAPES_19, IGNORE_LABEL
from seg.data import RealSet

N = 4
TARGET = Target("camvid", True, "camvid", "the title", (), (), (), lambda height, width: None)


@pytest.fixture
def found() -> Found:
    rng = np.random.default_rng(0)
    half = random_proposal()
    probabilities = rng.dirichlet(np.ones(5), (6, 23)).astype(np.float32)
    rewards = rng.random((6, 2)).astype(np.float32)
    rewards[2, 0] = np.nan  # it failed
    baselines, groups = np.full(6, 0.4, np.float32), np.repeat(np.arange(3), 2)
    return Found(half, half, half, [], rewards, baselines, groups, probabilities, 0.0, 0.0)


def test_colours_are_the_tables():
    labels = np.array([[0, 1], [10, IGNORE_LABEL]], np.uint8)
    wanted = [[(128, 64, 128), (244, 35, 232)], [(70, 130, 180), (0, 0, 0)]]
    np.testing.assert_array_equal(pictures.colorize(labels, CITYSCAPES_19), wanted)
    np.testing.assert_array_equal(pictures.colorize(labels, CAMVID_11)[0, 0], (128, 128, 128))


@pytest.mark.parametrize("baseline", [0.4, np.nan, 900.0])  # none, and in a unit of its own
def test_rewards_and_distributions(found, baseline, tmp_path):
    found = found._replace(baselines=np.full(6, baseline, np.float32))
    pictures.rewards(tmp_path / "pictures", found, "title")
    pictures.distributions(tmp_path / "pictures", found, "title")
    names = {"reward.png", "attributes.png", "probabilities.npy"}
    assert {p.name for p in (tmp_path / "pictures").iterdir()} == names
    for name in ("reward.png", "attributes.png"):
        picture = np.asarray(Image.open(tmp_path / "pictures" / name).convert("RGB"))
        assert min(picture.shape[:2]) > 300 and picture.std() > 5
    kept = np.load(tmp_path / "pictures" / "probabilities.npy")
    np.testing.assert_array_equal(kept, found.probabilities)


def test_samples_show_target_random_and_learnt_with_labels(tmp_path, monkeypatch):
    shown = []
    monkeypatch.setattr(pictures, "_enlarge", lambda image: shown.append(image) or image)
    rng = np.random.default_rng(1)
    images = rng.integers(0, 256, (3, N, 8, 16, 3), dtype=np.uint8)
    labels = rng.integers(0, 11, (3, N, 8, 16), dtype=np.uint8)
    test = RealSet(("n",) * N, ("s",) * N, images[0], labels[0])
    datasets = {name: Dataset(images[k], labels[k]) for k, name in ((1, "random"), (2, "learnt"))}
    pictures.samples(tmp_path, TARGET, test, datasets)
    assert len(shown) == 3 and (tmp_path / "images.png").exists()
    for k in range(3):
        ids = labels[k] if k == 0 else CAMVID_11.from_train_id[labels[k]]
        above, below = np.split(shown[k], 2)
        np.testing.assert_array_equal(above, np.concatenate(list(images[k]), axis=1))
        expected = pictures.colorize(ids, CAMVID_11)
        np.testing.assert_array_equal(below, np.concatenate(list(expected), axis=1))


def test_a_full_disk_leaves_no_half_picture(found, tmp_path, full_disk):
    with pytest.raises(OSError) as caught:
        pictures.rewards(tmp_path / "pictures", found, "title")
    assert caught.value.filename == str(tmp_path / "pictures" / "reward.png")
    assert list((tmp_path / "pictures").iterdir()) == []


def test_small_images_are_enlarged_by_whole_numbers():
    image = np.arange(2 * 96 * 3, dtype=np.uint8).reshape(2, 96, 3)
    large = image.repeat(16, axis=0).repeat(16, axis=1)
    np.testing.assert_array_equal(pictures._enlarge(image), large)
