"""Datasets: the same bytes from any number of workers, and in jitted code; errors before any work."""

from itertools import chain

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from common.workers.pool import WorkerPool
from scene import AssetPool, default_unit, sample_street
from scene.assets.families import FAMILIES
from scene.callback import render_fn
from scene.dataset.render import COMPILING, compile_first, render_dataset, render_street, street_of
from tests.scene.conftest import DEFAULT, POOL, TINY, chosen, refused, units


def render(workers=0, **changes):
    options = {"shots": 2, "settings": TINY, "pool": POOL, "workers": workers}
    seed = changes.pop("seed", 7)
    return render_dataset(changes.pop("units", units(3)), seed, **{**options, **changes})


@pytest.fixture(scope="module")
def serial():
    return render()


def test_bytes_do_not_depend_on_the_workers_and_an_open_pool_is_left_open(serial):
    reported = []
    with WorkerPool(1) as pool:
        many = [render(pool), render(pool, progress=lambda *counts: reported.append(counts))]
        assert pool._executors
    assert not pool._executors and reported == [(1, 3), (2, 3), (3, 3)]  # streets
    for parallel in (*many, render(2)):
        assert (parallel.images == serial.images).all() and (parallel.labels == serial.labels).all()


def test_images_come_in_order_and_depend_on_attributes_seed_and_index_only(serial):
    assert np.array_equal(render(units=units(3)[:2]).images, serial.images[:4])
    alike = render(units=np.stack([default_unit()] * 2))
    assert not np.array_equal(alike.images[:2], alike.images[2:])
    assert (serial.images.shape, serial.labels.shape) == ((6, 32, 48, 3), (6, 32, 48))
    street_frames = (
        render_street(unit, 7, i, 2, TINY, "embree", POOL) for i, unit in enumerate(units(3))
    )
    images, labels, *_ = zip(*chain(*street_frames), strict=True)
    assert np.array_equal(serial.images, images) and np.array_equal(serial.labels, labels)


def test_streets_of_neighbouring_seeds_are_not_the_same_and_the_pool_of_assets_is_theirs():
    seeds = {street_of(default_unit(), s, i, 1, POOL).seed for s in range(5) for i in range(5)}
    assert len(seeds) == 25
    street = street_of(default_unit(), 1, 0, 1, AssetPool(7, 3))
    assert {p.asset for p in street.placements} == {7, 8, 9}
    default = sample_street(DEFAULT, street.seed, 1)
    assert all(p.asset < FAMILIES[p.family].count for p in default.placements)


@pytest.mark.parametrize(("changes", "message"), [
    ({"units": np.zeros((2, 22))}, r"23 \(scenex\) or"),
    ({"units": np.zeros(23)}, r"shape \[streets, attributes\]"),
    ({"units": np.zeros((0, 23))}, r"shape \[streets, attributes\]"),
    ({"units": np.full((2, 23), np.nan)}, "illumination_intensity is nan"),
    ({"seed": 2**32}, "seed must lie in 0..4294967295, not 4294967296"),
    ({"shots": 0}, "shots per street must be 1 or more, not 0"),
    ({"settings": TINY._replace(width=2)}, "2x32 is too small"),
    ({"settings": TINY._replace(samples=0)}, "samples must lie in 1..8"),
    ({"renderer_name": "povray"}, "unknown renderer 'povray'; known: embree, opengl"),
    ({"pool": AssetPool(use="own")}, "use 'own' needs a folder of own assets"),
    ({"workers": -1}, "workers must be 0 or more, not -1"),
])  # fmt: skip
def test_bad_arguments_are_refused_by_name(changes, message):
    refused(ValueError, message, render, **changes)
    if not changes.keys() & {"units", "workers", "seed"}:  # those can be told before the call
        refused(ValueError, message, render_fn, **{"settings": TINY, **changes})


@pytest.fixture(scope="module")
def compiled():
    return jax.jit(render_fn(TINY, shots=2, pool=POOL))


@pytest.mark.parametrize("name", ["embree", "opengl"])
def test_under_jit_the_bytes_are_those_of_the_engine(name):
    chosen(name)
    jitted = jax.jit(render_fn(TINY, shots=2, renderer_name=name, pool=POOL))
    images, labels = jitted(jnp.asarray(units(2)), jnp.array([5, 6], jnp.uint32))
    assert (images.shape, images.dtype) == ((2, 2, 32, 48, 3), jnp.uint8)
    assert (labels.shape, labels.dtype) == ((2, 2, 32, 48), jnp.uint8)
    for i, seed in enumerate((5, 6)):
        for shot, frame in enumerate(render_street(units(2)[i], seed, 0, 2, TINY, name, POOL)):
            assert (images[i, shot] == frame.image).all() and (labels[i, shot] == frame.label).all()


def test_values_out_of_range_are_clipped_nan_is_the_middle_and_vmap_renders_one_by_one(compiled):
    wild, tame = units(2), units(2)
    wild[0, :3], tame[0, :3] = (-3, 7, np.nan), (0, 1, 0.5)
    wild[1, 5], tame[1, 5] = np.inf, 1
    seeds = jnp.array([1, 2], jnp.uint32)
    assert all(map(np.array_equal, compiled(wild, seeds), compiled(tame, seeds)))
    seeds = jnp.array([[1], [2]], jnp.uint32)
    images, _ = jax.vmap(compiled)(jnp.asarray(units(2))[:, None], seeds)
    together, _ = compiled(units(2), seeds[:, 0])
    assert np.array_equal(images[:, 0], together)


@pytest.mark.parametrize(("unit", "seeds"), [((2, 22), (2,)), ((23,), ()), ((2, 23), (3,))])
def test_wrong_shapes_are_refused_before_the_call(compiled, unit, seeds):
    with pytest.raises(ValueError, match=r"expected unit|must have 23"):
        compiled(jnp.zeros(unit), jnp.zeros(seeds, jnp.uint32))


def test_the_first_use_of_a_renderer_is_announced_before_it_compiles(tmp_path, monkeypatch, capsys):
    """And not again, unless it was stopped before it had compiled."""
    events = []

    class Stub:
        def render(self, street, settings):
            events.append(capsys.readouterr().err)
            if len(events) == 2:
                raise KeyboardInterrupt

    monkeypatch.setattr("scene.compiled._folder", lambda: str(tmp_path))
    monkeypatch.setattr("scene.dataset.render.renderer", lambda name: Stub())
    text = COMPILING + "\n"
    with WorkerPool(0) as serial:
        with pytest.raises(KeyboardInterrupt):
            compile_first(serial, "embree")
        compile_first(serial, "embree")
        compile_first(serial, "embree")
        assert events[0] == events[2] == text and set(events[3:]) == {""}
        count = len(events)
        compile_first(serial, "opengl")  # has functions of its own
        assert events[count] == text
