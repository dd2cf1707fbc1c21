"""The twin: hidden, reproducible, made of other assets, and never taken for real data."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.config import MainConfig
from experiments.presets import PRESETS, TARGETS, defaults
from experiments.target import twin as module
from experiments.target.named import named_target
from experiments.target.twin import (
    FIRST_ASSET,
    HIDDEN_WIDTH,
    IMAGES,
    PRIOR_STD,
    SHOTS,
    twin_split,
    twin_world,
)
from scene.assets.families import FAMILIES
from scene.attributes import default_unit
from scene.dataset.render import Dataset
from scene.render.sensor import CameraResponse
from scene.workers import WorkerPool

seeds = st.integers(0, 2**31)


@given(seeds)
def test_hidden_values_are_reproducible_and_inside_the_ranges(seed):
    world, again = twin_world(seed), twin_world(seed)
    np.testing.assert_array_equal(world.centre, again.centre)
    assert (world.response, world.seed) == (again.response, again.seed)
    assert world.centre.shape == world.width.shape == (23,)
    half = HIDDEN_WIDTH / 2
    assert (world.centre >= half).all() and (world.centre <= 1 - half).all()


@given(seeds, seeds)
def test_another_seed_hides_other_values(one, other):
    if one != other:
        assert (twin_world(one).centre != twin_world(other).centre).any()
        assert twin_world(one).response != twin_world(other).response


def test_the_prior_is_the_stated_one():
    centres = np.stack([twin_world(seed).centre for seed in range(400)])
    inside = (default_unit() > 0.45) & (default_unit() < 0.55)  # far from where it is clipped
    offsets = (centres - default_unit())[:, inside]
    assert abs(offsets.mean()) < 0.015
    assert offsets.std() == pytest.approx(PRIOR_STD, rel=0.1)


def test_the_camera_is_another_one():
    assert all(twin_world(seed).response != CameraResponse() for seed in range(5))


class Renders(list):
    """Stands for ``render_dataset`` and keeps what it was asked for."""

    def __call__(self, units, seed, *, shots, settings, **options):
        self.append((units, seed, options))
        size = (len(units) * shots, settings.height, settings.width)
        return Dataset(np.zeros((*size, 3), np.uint8), np.zeros(size, np.uint8))


@pytest.fixture
def renders(monkeypatch):
    renders = Renders()
    monkeypatch.setattr(module, "render_dataset", renders)
    return renders


def split(name, images=None, seed=0):
    world = twin_world(seed)
    pool = WorkerPool(0)
    return twin_split(
        world, name, (8, 16), images=images, renderer="embree", workers=pool, assets=2
    )


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("preset", PRESETS)
def test_its_assets_are_not_the_searchs(renders, target, preset):
    split("train")
    [(_, _, options)] = renders
    ours, theirs = defaults(MainConfig, target, preset).pool, options["pool"]
    assert (
        ours.first + (ours.size or max(family.count for family in FAMILIES.values()))
        <= FIRST_ASSET
        == theirs.first
    )
    assert not theirs.own


def test_its_splits_are_disjoint(renders):
    train, test = split("train"), split("test")
    assert not set(train.names) & set(test.names)
    assert not set(train.sequences) & set(test.sequences)
    (train_units, train_seed, _), (test_units, test_seed, _) = renders
    assert train_seed != test_seed
    assert not np.isin(train_units, test_units).any()


@given(st.integers(1, 200))
def test_as_many_images_as_asked_for_at_most_all(images):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "render_dataset", Renders())
        real = split("test", images)
    assert len(real.names) == len(set(real.names)) == len(real.images) == min(images, IMAGES)
    assert len(set(real.sequences)) == -(-len(real.names) // SHOTS)


def test_fewer_images_are_the_first_of_all(renders):
    assert split("train", 4).names == split("train").names[:4]


def test_every_street_lies_in_the_hidden_interval(renders):
    split("train")
    units, world = renders[0][0], twin_world(0)
    assert (np.abs(units - world.centre) <= HIDDEN_WIDTH / 2 + 1e-6).all()
    assert units.shape == (IMAGES // SHOTS, 23)


def test_it_never_passes_for_real_data(renders):
    config = replace(defaults(MainConfig, "twin", "smoke"), twin_seed=3)
    target = named_target(config, WorkerPool(0))
    assert target.real is False and target.name == "twin"
    assert "twin 3" in target.title and "NOT real data" in target.title
    assert len(target.reward_names) == len(target.test_names) == 8
    assert target.twin is not None
    np.testing.assert_array_equal(target.twin.centre, twin_world(3).centre)


def test_the_same_world_gives_the_same_images():
    one, two = split("train", 1), split("train", 1)
    np.testing.assert_array_equal(one.images, two.images)
    np.testing.assert_array_equal(one.labels, two.labels)
    assert one.images.std() > 10 and len(np.unique(one.labels)) > 3
    assert (split("train", 1, seed=1).images != one.images).any()
