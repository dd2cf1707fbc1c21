"""Model selection: is a challenger significantly better than the hand-set street?

All candidates have one net for each of the same n seeds, and a net has one score, on all reward images. So
the seeds are independent, and Dunnett's one-sided test, paired by seed, compares k challengers with the
hand-set street:

    t[i] = mean_j(y[i, j] - y[0, j]) / sqrt(2 s^2 / n)

with s^2 the residual variance of the two-way layout y[i, j] = candidate[i] + seed[j] + error, which has
k (n - 1) degrees of freedom. If no challenger is better, some t exceeds the critical value in 5 % of runs.
The test assumes that nets of all candidates have the same variance.

Source: Dunnett (1955), "A Multiple Comparison Procedure for Comparing Several Treatments with a Control".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy import optimize, stats

from experiments.evaluation.job import Parts
from shell.errors import UserError

FEWEST, MOST = 2, 4
"""The least and the largest default number of parts."""
LEVEL = 0.05
"""The family-wise error rate: the probability that any challenger passes if none is better."""

Scores = Mapping[str, Sequence[float]]
"""Scores by candidate, one for each seed; NaN if training failed."""


class Selection(NamedTuple):
    """The chosen candidate, and the reasons."""

    chosen: str
    scores: Scores  # of all compared candidates
    means: dict[str, float]  # over the seeds without a failed net; NaN if there is none
    t: dict[str, float]  # of the challengers; empty without a test
    critical: float | None  # the value that t must exceed; None without a test
    verdict: str  # in words


def parts_of(sequences: Sequence[str], count: int | None = None) -> Parts:
    """Cut images into parts of about equal size, between sequences if there are enough of them.

    Args:
        sequences: the sequence of every image; images of a sequence are consecutive.
        count: number of parts; by default one for each sequence, but 2 to 4.

    Returns:
        First image of every part, and the first image after it.

    Raises:
        UserError: fewer images than parts.
    """
    images = len(sequences)
    starts = [k for k in range(images) if k == 0 or sequences[k] != sequences[k - 1]]
    count = min(max(len(starts), FEWEST), MOST, images) if count is None else count
    if count > images:
        raise UserError(
            f"--parts {count} would leave a part without images: {images} give the reward"
        )
    cuts = {0, images}
    while len(cuts) <= count:  # halve the largest part that can be cut
        ends = sorted(cuts)
        for places in (starts, range(images)):
            found = [
                (last - first, min((abs(2 * k - first - last), k) for k in inside)[1])
                for first, last in pairwise(ends)
                if (inside := [k for k in places if first < k < last])
            ]
            if found:
                cuts.add(max(found, key=lambda each: each[0])[1])
                break
    return tuple(pairwise(sorted(cuts)))


def complete(scores: Scores) -> np.ndarray:
    """Scores f64[candidates n] of the n seeds without a failed net."""
    values = np.array(list(scores.values()), float)
    return values[:, np.isfinite(values).all(axis=0)]


def means_of(scores: Scores) -> dict[str, float]:
    """Each candidate's mean over the seeds without a failed net; NaN if there is none."""
    values = complete(scores)
    level = values.mean(axis=1) if values.size else np.full(len(values), np.nan)
    return dict(zip(scores, level.tolist(), strict=True))


@cache
def critical_value(challengers: int, seeds: int) -> float:
    """The one-sided critical value of t for a family-wise error rate of `LEVEL`.

    Args:
        challengers: k, the number of challengers of one reference.
        seeds: n, the number of seeds, 2 or more; the variance has k (n - 1) degrees of freedom.
    """
    # Differences to one reference share its noise, which is half of their variance.
    correlation = np.full((challengers, challengers), 0.5) + 0.5 * np.eye(challengers)
    freedom = challengers * (seeds - 1)

    def short(bound: float) -> float:
        at = np.full(challengers, bound)
        # It integrates at random points; without a seed every call would differ.
        below = stats.multivariate_t.cdf(at, shape=correlation, df=freedom, random_state=0)
        return float(below) - (1 - LEVEL)

    return float(optimize.brentq(short, 0, 100, xtol=1e-4))


def select(scores: Scores, reference: str | None = None) -> Selection:
    """Choose the challenger with the highest mean if it is significantly better, otherwise the reference.

    Args:
        scores: scores of all candidates with the same seeds; a failed net drops its seed for all of them.
        reference: the candidate that others must beat. If it has no scores, the highest mean
            decides, and the first of equal ones.
    """
    values, means = complete(scores), means_of(scores)
    n = values.shape[1]

    def untested(chosen: str, why: str) -> Selection:
        return Selection(chosen, scores, means, {}, None, f"not tested: {why}")

    challengers = [name for name in scores if name != reference]
    if reference is None or reference not in scores:
        why = "no hand-set street among the candidates, so the highest mean is taken"
        return untested(max(challengers, key=means.__getitem__), why)
    if not challengers:
        return untested(reference, "no challenger differs from the hand-set street")
    if n < 2:
        lost = "" if n == len(scores[reference]) else " without a failed net"
        return untested(reference, f"{'one' if n else 'no'} seed{lost}")
    residual = values - values.mean(axis=1, keepdims=True) - values.mean(axis=0) + values.mean()
    variance = np.sum(residual**2) / (len(challengers) * (n - 1))
    gain = np.array([means[name] - means[reference] for name in challengers])
    with np.errstate(divide="ignore", invalid="ignore"):  # without noise t is infinite
        t = gain / np.sqrt(2 * variance / n)
    bound, best = critical_value(len(challengers), n), int(gain.argmax())
    passed = bool(t[best] > bound)
    which = challengers[best] if passed else "no challenger"
    return Selection(
        challengers[best] if passed else reference,
        scores,
        means,
        dict(zip(challengers, t.tolist(), strict=True)),
        bound,
        f"{'replaced' if passed else 'kept'}: {which} is significantly better "
        f"at family-wise {100 * LEVEL:g} %",
    )
