import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sdr_jax import relax, space
from sdr_jax.relaxation import bin_centres, bin_mask, entropy, moments, uniform

SPACE = space(["a", "b", "c"], bins=[2, 5, 3])


def test_bins_and_their_entropy_by_hand() -> None:
    assert bin_mask(SPACE).tolist() == [[1, 1, 0, 0, 0], [1] * 5, [1, 1, 1, 0, 0]]
    np.testing.assert_allclose(bin_centres(SPACE)[0, :2], [0.25, 0.75])
    np.testing.assert_allclose(bin_centres(SPACE)[1], [0.1, 0.3, 0.5, 0.7, 0.9])
    np.testing.assert_allclose(uniform(SPACE)[2], [1 / 3] * 3 + [0, 0])
    expected = np.log(2) + np.log(5) + np.log(3)
    assert float(entropy(uniform(SPACE))) == pytest.approx(expected, rel=1e-6)
    assert float(entropy(jnp.eye(5)[:3])) == 0


def test_moments_of_uniform_and_certain_distributions() -> None:
    everything = moments(SPACE, uniform(SPACE))
    np.testing.assert_allclose(everything.centre, 0.5, atol=1e-6)
    np.testing.assert_allclose(everything.width, 1, atol=1e-6)
    certain = moments(SPACE, jax.nn.one_hot(jnp.asarray([1, 4, 0]), 5), 0.1)
    expected = relax(SPACE, jnp.asarray([1, 4, 0]), 0.1)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), certain, expected)


@given(st.integers(0, 2**32 - 1))
def test_moments_are_those_of_the_distribution_and_stay_inside(seed: int) -> None:
    weights = np.random.default_rng(seed).exponential(size=(3, 5)) * bin_mask(SPACE)
    p = weights / weights.sum(axis=1, keepdims=True)
    centre, width = moments(SPACE, jnp.asarray(p, jnp.float32))
    for index, bins in enumerate(SPACE.bins):
        values = (np.arange(bins) + 0.5) / bins
        mean = (p[index, :bins] * values).sum()
        variance = (p[index, :bins] * (values - mean) ** 2).sum() + 1 / bins**2 / 12
        expected = min(1.0, np.sqrt(12 * variance))
        assert float(width[index]) == pytest.approx(expected, abs=1e-5)
        slid = np.clip(mean, expected / 2, 1 - expected / 2)
        assert float(centre[index]) == pytest.approx(slid, abs=1e-5)


@pytest.mark.parametrize(
    ("options", "culprit"),
    [
        (dict(width=1.5), "1.5"),
        (dict(width=-0.1), "-0.1"),
        (dict(width=(0.1, 0.1)), "2 widths for 3"),
        (dict(unoptimised="third"), "'third'"),
    ],
)
def test_bad_relaxation_is_refused(options: dict, culprit: str) -> None:
    with pytest.raises(ValueError, match=culprit):
        relax(SPACE, jnp.zeros(3, int), **options)
