"""Means and confidence intervals of a few paired repeats."""

from __future__ import annotations

import math
from collections.abc import Sequence

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
