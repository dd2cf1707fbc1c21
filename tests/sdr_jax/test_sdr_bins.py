import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sdr_jax import bins, relax, space

SPACE = space(["a", "b", "c"], bins=[2, 5, 3])


def test_centres_mask_and_uniform_by_hand() -> None:
    assert bins.mask(SPACE).tolist() == [[1, 1, 0, 0, 0], [1] * 5, [1, 1, 1, 0, 0]]
    np.testing.assert_allclose(bins.centres(SPACE)[0, :2], [0.25, 0.75])
    np.testing.assert_allclose(bins.centres(SPACE)[1], [0.1, 0.3, 0.5, 0.7, 0.9])
    np.testing.assert_allclose(bins.uniform(SPACE)[2], [1 / 3] * 3 + [0, 0])


def test_entropy_by_hand() -> None:
    expected = np.log(2) + np.log(5) + np.log(3)
    assert float(bins.entropy(bins.uniform(SPACE))) == pytest.approx(expected, rel=1e-6)
    assert float(bins.entropy(jnp.eye(5)[:3])) == 0


def test_spread_of_uniform_and_certain_distributions() -> None:
    everything = bins.spread(SPACE, bins.uniform(SPACE))
    np.testing.assert_allclose(everything.centre, 0.5, atol=1e-6)
    np.testing.assert_allclose(everything.width, 1, atol=1e-6)
    certain = bins.spread(SPACE, jax.nn.one_hot(jnp.asarray([1, 4, 0]), 5), 0.1)
    expected = relax(SPACE, jnp.asarray([1, 4, 0]), 0.1)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), certain, expected)


@given(st.integers(0, 2**32 - 1))
def test_spread_stays_inside(seed: int) -> None:
    weights = np.random.default_rng(seed).exponential(size=(3, 5)) * bins.mask(SPACE)
    p = jnp.asarray(weights / weights.sum(axis=1, keepdims=True), jnp.float32)
    centre, width = bins.spread(SPACE, p)
    assert np.all(centre - width / 2 >= -1e-6)
    assert np.all(centre + width / 2 <= 1 + 1e-6)
