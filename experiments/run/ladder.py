"""A ladder of ever costlier fidelities: all challengers at the bottom, few of them at the final size.

Each rung scores the challengers that are left with seeds of its own, which all of them share; the better
half by mean goes on. What cheap nets can tell apart costs no net of the final size. There the hand-set street
joins.

Source: successive halving, Jamieson and Talwalkar (2016), "Non-stochastic Best Arm Identification and
Hyperparameter Optimization".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from experiments.config import Fidelity
from experiments.run.selection import Scores, Selection, means_of, select

Score = Callable[[int, Sequence[str]], Scores]
"""(rung, candidates) -> scores of every candidate, by seed."""


def middle(low: Fidelity, high: Fidelity) -> Fidelity:
    """The fidelity between two, half way on a logarithmic scale; net and rays are the higher one's."""

    def between(a: int, b: int, unit: int = 1) -> int:
        return max(round(math.sqrt(a * b) / unit), 1) * unit

    return replace(
        high,
        width=between(low.width, high.width, 8),
        height=between(low.height, high.height, 8),
        streets=between(low.streets, high.streets),
        shots=between(low.shots, high.shots),
        train=replace(high.train, steps=between(low.train.steps, high.train.steps)),
    )


def fidelities(low: Fidelity, high: Fidelity) -> tuple[Fidelity, ...]:
    """Those of the ladder: the lowest, one between, the highest."""
    return tuple(dict.fromkeys((low, middle(low, high), high)))


def kept(entered: int) -> int:
    """How many of the challengers on a rung go on to the next: half of them, rounded up."""
    return -(-entered // 2)


def compared(challengers: int, rungs: int, reference: bool) -> list[int]:
    """How many candidates have nets on each rung.

    Below the last one a single challenger needs none, nor does the reference, which stays anyhow.
    """
    counts = []
    for _ in range(rungs - 1):
        counts.append(challengers if challengers > 1 else 0)
        challengers = kept(challengers)
    return [*counts, challengers + reference]


def climb(
    candidates: Sequence[str], rungs: int, score: Score, reference: str | None = None
) -> Selection:
    """Send candidates up the ladder, and choose among those on its last rung (`selection.select`).

    Args:
        candidates: their names.
        rungs: from the cheapest to the final one.
        score: trains nets and tests them.
        reference: the candidate that stays to the end, and that others must be better than.
    """
    left = [name for name in candidates if name != reference]
    for rung in range(rungs - 1):
        if len(left) > 1:
            means = means_of(score(rung, left))
            best = sorted(left, key=lambda name: -means[name])[: kept(len(left))]
            left = [name for name in left if name in best]
    finalists = [name for name in candidates if name in left or name == reference]
    return select(score(rungs - 1, finalists), reference)
