"""Means, confidence intervals and tests of a few repeats."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats


def mean_ci95(values: Sequence[float]) -> tuple[float, list[float] | None]:
    """Mean and its 95 % confidence interval [low, high] by Student's t; None for one value.

    mean +- t(0.975, n - 1) s / sqrt(n), with s the sample standard deviation.
    """
    x = np.asarray(values, float)
    mean = float(x.mean())
    if len(x) < 2:
        return mean, None
    half = float(stats.t.ppf(0.975, len(x) - 1) * x.std(ddof=1) / math.sqrt(len(x)))
    return mean, [mean - half, mean + half]


def paired_gain(ours: Sequence[float], theirs: Sequence[float]) -> tuple[float, list[float] | None]:
    """Mean and 95 % interval of the differences of paired repeats."""
    if len(ours) != len(theirs):
        raise ValueError(f"{len(ours)} values cannot be paired with {len(theirs)}")
    return mean_ci95([a - b for a, b in zip(ours, theirs, strict=True)])


class Welch(NamedTuple):
    """Welch's t-test of two sets of repeats."""

    difference: float  # of the means
    t: float
    degrees: float  # of freedom, by Welch and Satterthwaite
    p_value: float  # two-sided

    @property
    def stars(self) -> str:
        """The paper's marks: ** for p < 0.01, * for p < 0.05."""
        return "**" if self.p_value < 0.01 else "*" if self.p_value < 0.05 else ""


def welch(ours: Sequence[float], theirs: Sequence[float]) -> Welch | None:
    """Whether two means differ, without assuming equal variances.

    t = (mean(a) - mean(b)) / sqrt(var(a) / n_a + var(b) / n_b). None where a set has fewer than two
    values or none of them varies: then there is nothing to test with.

    Source: Welch (1947), "The generalization of 'Student's' problem".
    """
    a, b = np.asarray(ours, float), np.asarray(theirs, float)
    if min(len(a), len(b)) < 2 or (np.ptp(a) == 0 and np.ptp(b) == 0):
        return None
    found = stats.ttest_ind(a, b, equal_var=False)
    values = (a.mean() - b.mean(), found.statistic, found.df, found.pvalue)
    return Welch(*(float(value) for value in values))


RESAMPLES = 1000
"""Of each bootstrap."""


class Estimate(NamedTuple):
    """A value and its 95 % interval; None where it is not defined."""

    value: float | None
    ci95: list[float] | None


def bootstrap(counts: Sequence[int], statistic: Callable[..., float], seed: int) -> Estimate:
    """A statistic of one or more sets, with the interval of the percentile bootstrap.

    Args:
        counts: how many each set holds; every set is drawn anew by itself.
        statistic: of the chosen ones, one i64[count] for each set; NaN where it is not defined.
        seed: of the resampling.
    """
    value = statistic(*(np.arange(count) for count in counts))
    if not math.isfinite(value):
        return Estimate(None, None)
    rng = np.random.default_rng(seed)
    drawn = np.array(
        [statistic(*(rng.integers(0, n, n) for n in counts)) for _ in range(RESAMPLES)]
    )
    drawn = drawn[np.isfinite(drawn)]
    ends = np.quantile(drawn, [0.025, 0.975]).tolist() if len(drawn) else None
    return Estimate(value, ends)
