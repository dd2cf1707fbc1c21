"""The surrogate of recorded rewards: a Gaussian process of the record, and no more."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sdr_jax
from benchmarks import recorded

SPACE = sdr_jax.space(["a", "b"], bins=10)


def made(n: int = 80, noise: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """a matters, b does not."""
    rng = np.random.default_rng(0)
    bins = rng.integers(0, 10, (n, 2))
    centre = np.asarray(sdr_jax.relax(SPACE, bins, recorded.WIDTH).centre)
    return bins, 20 + 3 * np.sin(4 * centre[:, 0]) + noise * rng.normal(size=n)


def test_it_finds_the_function_the_noise_and_means_over_wide_intervals() -> None:
    surrogate = recorded.fit(SPACE, *made())
    assert surrogate.noise == pytest.approx(0.2, rel=0.4)
    assert surrogate.lengths[1] > 2 * surrogate.lengths[0]
    for centre in (0.2, 0.5, 0.8):
        proposal = sdr_jax.Proposal(jnp.asarray([centre, 0.5]), jnp.full(2, recorded.WIDTH))
        expected = 20 + 3 * np.sin(4 * centre)
        assert surrogate.true_value(proposal) == pytest.approx(expected, abs=0.25)
    everything = sdr_jax.Proposal(jnp.full(2, 0.5), jnp.ones(2))
    expected = 20 + 3 * np.sin(4 * np.linspace(0.15, 0.85, 400)).mean()
    assert surrogate.true_value(everything) == pytest.approx(expected, abs=0.3)
    many = jax.tree.map(lambda part: jnp.broadcast_to(part, (500, 2)), everything)
    rewards = surrogate.reward(jax.random.key(0), many)
    assert float(rewards.std()) == pytest.approx(surrogate.noise, rel=0.15)


def test_the_committed_record_is_large_enough_and_bins_are_legal() -> None:
    bins, rewards = recorded.read()
    assert len(bins) == len(rewards) >= 400 and bins.shape[1] == 23
    assert 0 <= bins.min() <= bins.max() <= 9 and 0 < rewards.min() < rewards.max() < 100
