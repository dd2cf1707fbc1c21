from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sdr_jax import space
from sdr_jax.critic.features import evaluate, features, maximise, tables

SPACE = space(["a", "b", "c", "d"], bins=[3, 5, 2, 4], groups=[["b"], ["d", "a"], ["c"]])
LAYOUT = features(SPACE, 3, 2, 0.5)
EVERY = jnp.asarray(list(product(range(3), range(5), range(2), range(4))), jnp.int32)
BEST_OF = jax.jit(lambda key, weights: maximise(key, SPACE, LAYOUT, weights))
TABLES = jax.jit(lambda weights, actions: tables(SPACE, LAYOUT, weights, actions))


def test_features_by_hand() -> None:
    assert LAYOUT.pairs.tolist() == [[3, 0]]
    x = np.asarray(evaluate(LAYOUT, jnp.asarray([[0, 2, 1, 3]])))[0]
    assert x.shape == LAYOUT.variance.shape == (4 * 3 + 4,)
    a = np.sqrt(2) * np.cos(np.pi / 6 * np.asarray([1, 2]))
    d = np.sqrt(2) * np.cos(np.pi * 7 / 8 * np.asarray([1, 2, 3]))
    np.testing.assert_allclose(x[:3], [*a, 0], atol=1e-6)  # three bins have two cosines
    np.testing.assert_allclose(x[6:9], [-1, 0, 0], atol=1e-6)  # two bins have one
    np.testing.assert_allclose(x[9:12], d, atol=1e-6)
    np.testing.assert_allclose(x[12:], np.outer(d[:2], a).ravel(), atol=1e-6)
    np.testing.assert_allclose(LAYOUT.variance[:3], [1, 1 / 4, 0])
    np.testing.assert_allclose(LAYOUT.variance[12:], np.outer([1, 1 / 4], [1, 1 / 4]).ravel() / 2)


def test_features_have_mean_zero_and_are_orthogonal_over_the_bins() -> None:
    x = np.asarray(evaluate(LAYOUT, EVERY), np.float64)
    np.testing.assert_allclose(x.mean(axis=0), 0, atol=1e-6)
    there = LAYOUT.variance > 0
    np.testing.assert_allclose(x.T @ x / len(x), np.diag(there), atol=1e-5)


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_best_bins_and_the_tables_are_those_of_enumeration(seed: int) -> None:
    normal = np.random.default_rng(seed).normal(size=len(LAYOUT.variance))
    weights = (normal * np.sqrt(LAYOUT.variance)).astype(np.float32)
    values = np.asarray(evaluate(LAYOUT, EVERY)) @ weights
    best = BEST_OF(jax.random.key(seed), jnp.asarray(weights))
    found = np.asarray(evaluate(LAYOUT, best[None, :]))[0] @ weights
    assert found == pytest.approx(values.max(), abs=1e-4)
    table = np.asarray(TABLES(jnp.asarray(weights), best))
    for attribute, count in enumerate(SPACE.bins):
        changed = np.tile(best, (count, 1))
        changed[:, attribute] = np.arange(count)
        expected = np.asarray(evaluate(LAYOUT, jnp.asarray(changed))) @ weights
        actual = table[attribute, :count]
        np.testing.assert_allclose(actual - actual[0], expected - expected[0], atol=1e-4)
        assert np.all(np.isneginf(table[attribute, count:]))
