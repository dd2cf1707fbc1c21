"""What a few repeated rewards tell: rank correlation, noise, signal, what common seeds are worth.

A reward of proposal p with seed s is taken as a_p + b_s + e_ps: what the proposal is worth, what the
seed does to all proposals alike, and what is left. Common random numbers cancel b.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy import stats

from experiments.study.stats import Estimate, bootstrap


class Pairing(NamedTuple):
    """Variances of the difference of two proposals."""

    common: float  # both with the same seed: 2 var(e)
    independent: float  # with two seeds: 2 (var(b) + var(e))
    p_value: float  # of seeds that do nothing to all proposals alike, by the F test


def spearman(x: np.ndarray, y: np.ndarray) -> float:
    """Rank correlation of f64[n] and f64[n], NaN where one of them is constant."""
    if len(x) < 3 or np.ptp(x) == 0 or np.ptp(y) == 0:
        return math.nan
    return float(np.corrcoef(stats.rankdata(x), stats.rankdata(y))[0, 1])


def noise_variance(table: np.ndarray) -> float:
    """Variance f64[proposals, seeds] -> of one proposal's rewards over seeds: var(b) + var(e)."""
    return float(table.var(axis=1, ddof=1).mean()) if min(table.shape, default=0) > 0 else math.nan


def residual_variance(table: np.ndarray) -> float:
    """Variance of what is left without both means: var(e)."""
    p, s = table.shape
    if p < 2 or s < 2:
        return math.nan
    left = table - table.mean(1, keepdims=True) - table.mean(0, keepdims=True) + table.mean()
    return float((left**2).sum() / ((p - 1) * (s - 1)))


def pairing(table: np.ndarray) -> Pairing | None:
    """What sharing seeds does to differences of proposals.

    Args:
        table: rewards f64[proposals, seeds], at least 2 of each.
    """
    p, s = table.shape
    if p < 2 or s < 2:
        return None
    left = residual_variance(table)
    seeds = p * float(table.mean(axis=0).var(ddof=1))
    degrees = s - 1, (p - 1) * (s - 1)
    p_value = float(stats.f.sf(seeds / left, *degrees)) if left > 0 else math.nan
    return Pairing(2 * left, 2 * noise_variance(table), p_value)


def signal_to_noise(rewards: np.ndarray, table: np.ndarray, seed: int) -> Estimate:
    """How many times the noise of one reward the proposals' true differences are.

    sqrt(max(var(rewards) - var(e), 0) / (var(b) + var(e))): the spread of what proposals are worth over
    that of one proposal's rewards.

    Args:
        rewards: of random proposals, f64[n], all with the same seed, so that b does not spread them.
        table: rewards f64[proposals, seeds] of those that were repeated.
        seed: of the bootstrap, which draws both anew.
    """
    if len(rewards) < 2 or len(table) < 2 or table.shape[1] < 2:
        return Estimate(None, None)
    left = residual_variance(table)

    def ratio(own: np.ndarray, again: np.ndarray) -> float:
        noise = noise_variance(table[again])
        if noise <= 0:
            return math.nan
        return math.sqrt(max(float(rewards[own].var(ddof=1)) - left, 0.0) / noise)

    return bootstrap((len(rewards), len(table)), ratio, seed)
