"""What a few repeated rewards tell: rank correlation, noise, signal, what common seeds are worth.

A reward of proposal p with seed s is taken as a_p + b_s + e_ps: what the proposal is worth, what the
seed does to all proposals alike, and what is left. Common random numbers cancel b.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy import stats

from experiments.study.stats import Estimate

DRAWS = 10_000
"""Of the parametric bootstrap."""


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

    The interval is a parametric bootstrap, with normal a, b and e: the mean square of ``rewards``, and those
    of seeds and of what is left of ``table``, are divided by draws of chi^2 / degrees of freedom, each with
    its own degrees, and the ratio is taken of what results. In simulations of 3, 5 and 10 seeds it covers
    the truth in 95 to 98 %, also where b or a is nothing.

    Args:
        rewards: of random proposals, f64[n], all with the same seed, so that b does not spread them.
        table: rewards f64[proposals, seeds] of those that were repeated.
        seed: of the bootstrap.

    Source: Weerahandi (1993), "Generalized confidence intervals".
    """
    n, (p, s) = len(rewards), table.shape
    noise, left = noise_variance(table), residual_variance(table)
    if n < 2 or p < 2 or s < 2 or noise <= 0:
        return Estimate(None, None)
    spread = float(rewards.var(ddof=1))
    value = math.sqrt(max(spread - left, 0.0) / noise)
    seeds = p * float(table.mean(axis=0).var(ddof=1))  # of p var(b) + var(e)
    rng = np.random.default_rng(seed)
    u, b, e = (
        square * free / rng.chisquare(free, DRAWS)
        for square, free in ((spread, n - 1), (seeds, s - 1), (left, (p - 1) * (s - 1)))
    )
    ratios = np.sqrt(np.maximum(u - e, 0.0) / ((np.maximum(b, e) + (p - 1) * e) / p))
    return Estimate(value, np.quantile(ratios, [0.025, 0.975]).tolist())
