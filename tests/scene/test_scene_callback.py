"""The renderer inside jitted code."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scene.assets.catalogue import AssetPool
from scene.callback import render_fn
from scene.dataset.render import render_street
from scene.render import RenderSettings
from tests.scene.conftest import chosen

POOL = AssetPool(0, 3)
TINY = RenderSettings(width=48, height=32)


def units(n=2):
    return np.random.default_rng(0).random((n, 23), dtype=np.float32)


@pytest.fixture(scope="module")
def render():
    return jax.jit(render_fn(TINY, shots=2, pool=POOL))


@pytest.mark.parametrize("name", ["embree", "opengl"])
def test_under_jit_the_bytes_are_those_of_the_engine(name):
    chosen(name)
    jitted = jax.jit(render_fn(TINY, shots=2, renderer_name=name, pool=POOL))
    images, labels = jitted(jnp.asarray(units()), jnp.array([5, 6], jnp.uint32))
    assert (images.shape, images.dtype) == ((2, 2, 32, 48, 3), jnp.uint8)
    assert (labels.shape, labels.dtype) == ((2, 2, 32, 48), jnp.uint8)
    for i, seed in enumerate((5, 6)):
        for shot, frame in enumerate(render_street(units()[i], seed, 0, 2, TINY, name, POOL)):
            assert np.array_equal(images[i, shot], frame.image)
            assert np.array_equal(labels[i, shot], frame.label)


def test_pictures_can_be_used_in_the_same_program():
    render = render_fn(TINY, pool=POOL)

    @jax.jit
    def brightness(unit, seeds):
        return render(unit, seeds)[0].astype(jnp.float32).mean(axis=(1, 2, 3, 4))

    dim, bright = (units().copy() for _ in range(2))
    dim[:, 0], bright[:, 0] = 0, 1
    seeds = jnp.arange(2, dtype=jnp.uint32)
    assert (brightness(dim, seeds) < brightness(bright, seeds)).all()


def test_values_out_of_range_are_clipped_and_nan_is_the_middle(render):
    wild, tame = units(), units()
    wild[0, :3], tame[0, :3] = (-3, 7, np.nan), (0, 1, 0.5)
    wild[1, 5], tame[1, 5] = np.inf, 1
    seeds = jnp.array([1, 2], jnp.uint32)
    for a, b in zip(render(wild, seeds), render(tame, seeds), strict=True):
        assert np.array_equal(a, b)


def test_wrong_shapes_and_settings_are_refused_before_the_call(render):
    for unit, seeds in (((2, 22), (2,)), ((23,), ()), ((2, 23), (3,))):
        with pytest.raises(ValueError, match=r"expected unit \[n, 23\] and seeds \[n\]"):
            render(jnp.zeros(unit), jnp.zeros(seeds, jnp.uint32))
    for arguments, message in (
        ({"settings": TINY._replace(width=0)}, "0x32 is too small"),
        ({"settings": TINY, "shots": 0}, "shots per street"),
        ({"settings": TINY, "renderer_name": "blender"}, "unknown renderer 'blender'"),
    ):
        with pytest.raises(ValueError, match=message):
            render_fn(**arguments)


def test_vmap_renders_one_by_one(render):
    seeds = jnp.array([[1], [2]], jnp.uint32)
    images, _ = jax.vmap(render)(jnp.asarray(units())[:, None], seeds)
    together, _ = render(units(), seeds[:, 0])
    assert np.array_equal(images[:, 0], together)
