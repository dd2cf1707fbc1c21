"""Datasets: the same bytes from any number of workers, and errors before any work."""

import numpy as np
import pytest

from scene.assets.catalogue import AssetPool
from scene.assets.families import FAMILIES
from scene.attributes import default_unit
from scene.dataset.render import render_dataset, render_street, street_of
from scene.render import RenderSettings
from scene.street.street import sample_street
from scene.workers import WorkerPool
from tests.scene.conftest import DEFAULT

POOL = AssetPool(0, 3)
TINY = RenderSettings(width=48, height=32)


def units(n=3, seed=0):
    return np.random.default_rng(seed).random((n, 23), dtype=np.float32)


def render(workers=0, **changes):
    options = {"shots": 2, "settings": TINY, "pool": POOL, "workers": workers}
    return render_dataset(changes.pop("units", units()), 7, **{**options, **changes})


@pytest.fixture(scope="module")
def here():
    return render()


def test_bytes_do_not_depend_on_the_workers_and_an_open_pool_is_left_open(here):
    with WorkerPool(1) as pool:
        many = [render(pool), render(pool)]
        assert pool._executor is not None
    assert pool._executor is None
    for there in (*many, render(2)):
        assert there.images.tobytes() == here.images.tobytes()
        assert there.labels.tobytes() == here.labels.tobytes()


def test_images_come_in_the_order_of_streets_and_shots(here):
    assert here.images.shape == (6, 32, 48, 3)
    assert here.labels.shape == (6, 32, 48)
    for i, unit in enumerate(units()):
        for shot, frame in enumerate(render_street(unit, 7, i, 2, TINY, "embree", POOL)):
            assert np.array_equal(here.images[2 * i + shot], frame.image)
            assert np.array_equal(here.labels[2 * i + shot], frame.label)


def test_a_street_depends_on_its_attributes_seed_and_index_only(here):
    fewer = render(units=units()[:2])
    assert np.array_equal(fewer.images, here.images[:4])
    alike = render(units=np.stack([default_unit()] * 2))
    assert not np.array_equal(alike.images[:2], alike.images[2:])


def test_streets_of_neighbouring_seeds_are_not_the_same_and_the_pool_of_assets_is_theirs():
    seeds = {street_of(default_unit(), s, i, 1, POOL).seed for s in range(5) for i in range(5)}
    assert len(seeds) == 25
    street = street_of(default_unit(), 1, 0, 1, AssetPool(5, 2))
    assert {p.asset for p in street.placements} == {5, 6}
    default = sample_street(DEFAULT, street.seed, 1)
    assert all(p.asset < FAMILIES[p.family].count for p in default.placements)


def test_progress_counts_streets():
    seen = []
    render(progress=lambda done, of: seen.append((done, of)), shots=1)
    assert seen == [(1, 3), (2, 3), (3, 3)]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"units": np.zeros((2, 22))}, "23 values"),
        ({"units": np.zeros(23)}, r"shape \[streets, 23\]"),
        ({"units": np.zeros((0, 23))}, r"shape \[streets, 23\]"),
        ({"units": np.full((2, 23), np.nan)}, "illumination_intensity is nan"),
        ({"shots": 0}, "shots per street must be 1 or more, not 0"),
        ({"settings": TINY._replace(width=2)}, "2x32 is too small"),
        ({"settings": TINY._replace(samples=0)}, "samples must lie in 1..8"),
        ({"renderer_name": "povray"}, "unknown renderer 'povray'; known: embree, opengl"),
        ({"workers": -1}, "workers must be 0 or more, not -1"),
    ],
)
def test_bad_arguments_are_refused_by_name(changes, message):
    with pytest.raises(ValueError, match=message):
        render(**changes)
