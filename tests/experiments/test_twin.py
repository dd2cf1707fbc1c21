"""The twin: hidden, reproducible, made of other assets, and never taken for real data."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.files import read_json
from experiments.config import MainConfig
from experiments.config.presets import defaults
from experiments.targets import named, real, twin
from experiments.targets.base import with_reward
from experiments.targets.named import named_target
from scene import CameraResponse, Dataset, default_unit
from scene.assets.families import FAMILIES
from scene.attributes import BY_NAME, names
from seg.classes import CITYSCAPES_19, class_table

from .conftest import POOL, by_preset, main_job

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
    centres = np.stack([twin.twin_world(seed).centre for seed in range(400)])
    offsets = (centres - default_unit())[:, inside]
    assert abs(offsets.mean()) < 0.015
    assert offsets.std() == pytest.approx(twin.PRIOR_STD, rel=0.1)
    one, two = split("train", 1), split("train", 1)
    assert (one.images == two.images).all() and (one.labels == two.labels).all()
    assert one.images.std() > 10 and len(np.unique(one.labels)) > 3
    assert (split("train", 1, seed=1).images != one.images).any()


def test_near_twins_are_those_of_earlier_results(renders):
    """Numbers of the commit before there were far ones."""
    world = twin.twin_world(3)
    recorded = [0.36066490, 0.33834773, 0.76027501, 0.16220139]
    np.testing.assert_allclose(world.centre[:4], recorded, rtol=1e-6)
    assert world.seed == 285672446
    assert world.response.gamma == pytest.approx(1.0459199299)
    split("train", 8, seed=3)
    ((units, seed), _) = renders[0]
    assert seed == 285672447 and units.shape == (2, 23)
    np.testing.assert_allclose(units[1, :3], [0.34755832, 0.29952526, 0.76383485], rtol=1e-6)


@given(seeds)
def test_far_twins_lie_anywhere_but_see_a_street(seed):
    world, near = twin.twin_world(seed, "far"), twin.twin_world(seed)
    unit = dict(zip(names("extended"), world.centre.tolist(), strict=True))
    assert world.width.tolist() == pytest.approx([twin.HIDDEN_WIDTH] * 40)
    assert (np.abs(world.centre - 0.5) <= 0.5 - twin.HIDDEN_WIDTH / 2 + 1e-6).all()
    # The ranges in words that people can check.
    height, pitch = (
        BY_NAME[name].physical(unit.pop(name))
        for name in ("camera_position_y", "camera_rotation_x")
    )
    assert 1.0 <= height <= 2.5 + 1e-5 and -8 - 1e-5 <= pitch <= 8 + 1e-5
    assert all(0.1 - 1e-6 <= value <= 0.9 + 1e-6 for value in unit.values())
    np.testing.assert_array_equal(world.centre, twin.twin_world(seed, "far").centre)
    assert world.seed != near.seed and world.response != near.response


def test_far_centres_fill_their_ranges():
    far = np.stack([twin.twin_world(seed, "far").centre for seed in range(400)])
    free = [k for k, name in enumerate(names("extended")) if name not in twin.FAR_CAMERA]
    quarters = np.quantile(far[:, free], [0.25, 0.5, 0.75], axis=0)
    assert np.abs(quarters.mean(axis=1) - [0.3, 0.5, 0.7]).max() < 0.01
    assert np.abs(quarters.T - [0.3, 0.5, 0.7]).max() < 0.1
    # Drawn apart from each other, and from near ones.
    near = np.stack([twin.twin_world(seed).centre for seed in range(400)])
    together = np.corrcoef(np.concatenate([far, near], axis=1).T)
    together -= np.eye(len(together))
    assert np.abs(together).max() < 0.25


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


def split(name, images=None, seed=0, kind="near"):
    own = {"images": images, "renderer": "embree", "workers": POOL, "assets": 2}
    return twin.twin_split(twin.twin_world(seed, kind), name, (8, 16), **own)


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
    assert train_units.shape == (twin.IMAGES // twin.SHOTS["near"], 23)
    target = named_target(defaults(MainConfig, "twin", "smoke", twin_seed=3), POOL)
    assert target.real is False and target.name == "twin"
    assert "twin 3" in target.title and "NOT real data" in target.title
    assert len(target.reward_names) == len(target.test_names) == 8
    np.testing.assert_array_equal(target.twin.centre, twin.twin_world(3).centre)


def test_it_has_the_classes_of_cityscapes_but_exact_labels(renders):
    split("train")
    assert "outlines" not in renders[0][1]
    target = named_target(defaults(MainConfig, "twin", "smoke"), POOL)
    exact = class_table(target.table)
    assert exact.outlines == () != CITYSCAPES_19.outlines
    assert exact.classes == CITYSCAPES_19.classes
    np.testing.assert_array_equal(exact.from_train_id, CITYSCAPES_19.from_train_id)


def test_streets_of_a_far_twin_lie_in_the_hidden_intervals(renders):
    split("train", kind="far")
    ((units, _), options) = renders[0]
    world = twin.twin_world(0, "far")
    assert (np.abs(units - world.centre) <= world.width / 2 + 1e-6).all()
    assert units.shape == (twin.IMAGES, 40)
    assert options["pool"].first == twin.FIRST_ASSET
    assert options["settings"].response == world.response
    target = named_target(defaults(MainConfig, "twin", "smoke", twin_seed=3, twin="far"), POOL)
    assert (target.name, target.real) == ("far twin", False)
    assert (
        target.title.startswith("the far twin 3, rendered by our own engine")
        and "NOT real" in target.title
    )
    np.testing.assert_array_equal(target.twin.centre, twin.twin_world(3, "far").centre)


@pytest.mark.parametrize(("flags", "count"), [((), 40), (("--space", "scenex"), 23)])
def test_a_job_on_a_far_twin_ends_in_either_space(flags, count, counted, out, capsys):
    brief = ("--method", "random_search", "--out", str(out))
    assert main_job("twin", "--twin", "far", *brief, *flags) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("Target: the far twin 0, ") and "the far twin, not real" in printed
    summary, config = (read_json(out / f"{name}.json") for name in ("summary", "config"))
    assert (config["twin"], summary["target"]) == ("far", "far twin")
    (answer,) = summary["components"]
    assert len(answer["attributes"]) == count
    assert len(summary["hidden_centres"]) == 40
    assert list(summary["recovery"]["by_attribute"]) == list(names("extended"))[:count]
    assert (out / "report.html").read_text().count('class="hidden"') == count


def in_turns(target):
    """Whether images of two sizes are still there when they are asked for in turns."""
    small, large = target.at(8, 16), target.at(16, 32)
    return all(target.at(8, 16) is small and target.at(16, 32) is large for _ in range(2))


def test_images_of_two_sizes_are_rendered_once(renders, monkeypatch):
    def unchecked(reward, test, *_):
        return {"reward": reward, "test": test}

    monkeypatch.setattr(named, "two_sides", unchecked)
    target = named_target(defaults(MainConfig, "twin", "smoke"), POOL)
    assert in_turns(target) and in_turns(with_reward(target, np.arange(3)))
    assert len(renders) == 4  # two sides each


def test_images_of_two_sizes_are_read_once(tiny_camvid, monkeypatch):
    reads = Mock(side_effect=real.load)
    monkeypatch.setattr(real, "load", reads)
    assert in_turns(named_target(replace(tiny_camvid, few=2), POOL))
    assert reads.call_count == 4


@given(st.integers(1, 200))
def test_as_many_images_as_asked_for_at_most_all(images):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(twin, "render_dataset", blank)
        real, all_images = split("test", images), split("test")
    assert real.names == all_images.names[:images]
    assert len(real.names) == len(set(real.names)) == len(real.images) == min(images, twin.IMAGES)
    assert len(set(real.sequences)) == -(-len(real.names) // twin.SHOTS["near"])
