"""The discrepancy of two sets of vectors, and the vectors that a network makes of images."""

from itertools import combinations

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given

from seg.features import features, penultimate, pool
from seg.mmd import mmd2, polynomial_kernel
from seg.nets import Compact
from seg.nets.ops.resize import bilinear

from .conftest import SEEDS, normal, pixels, refuses


def vectors(seed, n):
    return np.random.default_rng(seed).normal(size=(n, 3))


def test_discrepancies_and_pooling_by_hand():
    x, y = np.array([[1.0], [2.0]]), np.array([[0.0], [1.0], [-1.0]])
    np.testing.assert_array_equal(polynomial_kernel(x, y), [[1, 8, 0], [1, 27, -1]])
    # Among x: (1 * 2 + 1)^3 = 27. Among y: k = 1, 1, 0, mean 2 / 3. Between: 36 / 6.
    assert mmd2(x, y) == pytest.approx(27 + 2 / 3 - 2 * 6)
    x = np.array([[1.0, 3.0]])  # per dimension
    np.testing.assert_allclose(polynomial_kernel(x, x), [[(10 / 2 + 1) ** 3]])
    refuses("at least two vectors; got 1 and 3", mmd2, vectors(0, 1), vectors(0, 3))
    maps = jnp.arange(1.0, 9.0).reshape(1, 2, 4, 1)
    # The whole is 4.5; cells are the means of (1, 2), (3, 4), (5, 6), (7, 8).
    np.testing.assert_allclose(pool(maps), [[4.5, 1.5, 3.5, 5.5, 7.5]])
    assert pool(jnp.ones((2, 3, 5, 4))).shape == (2, 20)


@given(SEEDS)
def test_over_all_ways_to_split_one_set_the_mean_is_zero(seed):
    # Exactly, not on average: that is what unbiased means for a finite set.
    z = vectors(seed, 7)
    inside = [np.isin(np.arange(7), chosen) for chosen in combinations(range(7), 3)]
    values = [mmd2(z[part], z[~part]) for part in inside]
    assert np.mean(values) == pytest.approx(0, abs=1e-9 * max(map(abs, values)))


@given(SEEDS)
def test_sides_and_orders_do_not_matter(seed):
    rng = np.random.default_rng(seed)
    x, y = vectors(seed, 5), vectors(seed + 1, 4)
    turned = mmd2(y, x), mmd2(rng.permutation(x), rng.permutation(y))
    assert turned == pytest.approx([mmd2(x, y)] * 2, rel=1e-9, abs=1e-9)


PENULTIMATE = jax.jit(penultimate, static_argnums=2)


@pytest.fixture(scope="module")
def variables():
    key = jax.random.key(0, impl="rbg")  # compiles faster than the default
    return jax.jit(Compact(11).init)(key, jnp.zeros((1, 16, 24, 3)))


def test_logits_are_made_from_the_penultimate_features(variables):
    images = normal(2, 16, 24, 3)
    maps = PENULTIMATE(variables, images, 11)
    assert maps.shape == (2, 4, 6, 24) and float(maps.min()) >= 0
    last = {"params": variables["params"]["Conv_1"]}
    logits = bilinear(nn.Conv(11, (1, 1)).apply(last, maps), 4)
    whole = jax.jit(Compact(11).apply)(variables, images)
    np.testing.assert_allclose(logits, whole, atol=1e-5)


def test_an_image_has_the_same_features_in_any_company(variables):
    images = pixels(19, 16, 24, 3)
    every = features(variables, images, 11)
    assert every.shape == (19, 120) and every.dtype == np.float32
    np.testing.assert_allclose(features(variables, images[17:18], 11), every[17:18], atol=1e-5)
    vector = pool(PENULTIMATE(variables, jnp.asarray(images[3:4] / 255, jnp.float32), 11))
    np.testing.assert_allclose(vector, every[3:4], atol=1e-5)
    # Files of earlier versions hold the parameters alone.
    np.testing.assert_array_equal(features(variables["params"], images, 11), every)
