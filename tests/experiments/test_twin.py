"""The twin: hidden, reproducible, made of other assets, and never taken for real data."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.config import MainConfig
from experiments.presets import defaults
from experiments.target import named, real, twin
from experiments.target.base import with_reward
from experiments.target.named import named_target
from scene import CameraResponse, Dataset, default_unit
from scene.assets.families import FAMILIES

from .conftest import POOL, by_preset

seeds = st.integers(0, 2**31)


@given(seeds, seeds)
def test_hidden_values_are_reproducible_inside_the_ranges_and_other_by_seed(seed, other):
    world, again, another = map(twin.twin_world, (seed, seed, other))
    np.testing.assert_array_equal(world.centre, again.centre)
    assert (world.response, world.seed) == (again.response, again.seed)
    assert world.centre.shape == world.width.shape == (23,)
    assert (np.abs(world.centre - 0.5) <= 0.5 - twin.HIDDEN_WIDTH / 2).all()
    assert world.response != CameraResponse()
    if seed != other:
        assert (world.centre != another.centre).any() and world.response != another.response


def test_the_prior_is_the_stated_one_and_the_same_world_gives_the_same_images():
    inside = abs(default_unit() - 0.5) < 0.05  # far from where it is clipped
    drawn = np.stack([twin.twin_world(seed).centre for seed in range(400)])
    offsets = (drawn - default_unit())[:, inside]
    assert abs(offsets.mean()) < 0.015
    assert offsets.std() == pytest.approx(twin.PRIOR_STD, rel=0.1)
    one, two = split("train", 1), split("train", 1)
    assert (one.images == two.images).all() and (one.labels == two.labels).all()
    assert one.images.std() > 10 and len(np.unique(one.labels)) > 3
    assert (split("train", 1, seed=1).images != one.images).any()


def blank(units, seed, *, shots, settings, **options):
    """Stands for ``render_dataset``."""
    size = (len(units) * shots, settings.height, settings.width)
    return Dataset(np.zeros((*size, 3), np.uint8), np.zeros(size, np.uint8))


@pytest.fixture
def renders(monkeypatch):
    """The calls of what stands for ``render_dataset``."""
    stub = Mock(side_effect=blank)
    monkeypatch.setattr(twin, "render_dataset", stub)
    return stub.call_args_list


def split(name, images=None, seed=0):
    own = {"images": images, "renderer": "embree", "workers": POOL, "assets": 2}
    return twin.twin_split(twin.twin_world(seed), name, (8, 16), **own)


@by_preset
def test_its_assets_are_not_the_searchs(renders, target, preset):
    split("train")
    [(_, options)] = renders
    ours, theirs = defaults(MainConfig, target, preset).pool, options["pool"]
    most = ours.size or max(family.count for family in FAMILIES.values())
    assert ours.first + most <= twin.FIRST_ASSET == theirs.first and not theirs.own


def test_its_splits_are_disjoint_and_it_never_passes_for_real_data(renders):
    train, test = split("train"), split("test")
    assert not {*train.names, *train.sequences} & {*test.names, *test.sequences}
    ((train_units, train_seed), _), ((test_units, test_seed), _) = renders
    assert train_seed != test_seed and not np.isin(train_units, test_units).any()
    # Every street lies in the hidden interval.
    assert (np.abs(train_units - twin.twin_world(0).centre) <= twin.HIDDEN_WIDTH / 2 + 1e-6).all()
    assert train_units.shape == (twin.IMAGES // twin.SHOTS, 23)
    target = named_target(defaults(MainConfig, "twin", "smoke", twin_seed=3), POOL)
    assert target.real is False and target.name == "twin"
    assert "twin 3" in target.title and "NOT real data" in target.title
    assert len(target.reward_names) == len(target.test_names) == 8
    np.testing.assert_array_equal(target.twin.centre, twin.twin_world(3).centre)


def in_turns(target):
    """Whether images of two sizes are still there when they are asked for in turns."""
    small, large = target.at(8, 16), target.at(16, 32)
    return all(target.at(8, 16) is small and target.at(16, 32) is large for _ in range(2))


def test_images_of_two_sizes_are_rendered_once(renders, monkeypatch):
    monkeypatch.setattr(named, "refuse_void", lambda split, *_: split)
    target = named_target(defaults(MainConfig, "twin", "smoke"), POOL)
    assert in_turns(target) and in_turns(with_reward(target, np.arange(3)))
    assert len(renders) == 4  # two sides each


def test_images_of_two_sizes_are_read_once(tiny_camvid, monkeypatch):
    listing, split, load = real.LISTS["camvid"]
    reads = Mock(side_effect=load)
    monkeypatch.setitem(real.LISTS, "camvid", (listing, split, reads))
    assert in_turns(named_target(replace(tiny_camvid, few=2), POOL))
    assert reads.call_count == 4


@given(st.integers(1, 200))
def test_as_many_images_as_asked_for_at_most_all(images):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(twin, "render_dataset", blank)
        real, whole = split("test", images), split("test")
    assert real.names == whole.names[:images]
    assert len(real.names) == len(set(real.names)) == len(real.images) == min(images, twin.IMAGES)
    assert len(set(real.sequences)) == -(-len(real.names) // twin.SHOTS)
