"""The fidelities from a reward's size to the final one."""

from __future__ import annotations

import math
from dataclasses import replace

from experiments.config import Fidelity
from seg.recipes import with_steps


def middle(low: Fidelity, high: Fidelity) -> Fidelity:
    """The fidelity half way between two on a logarithmic scale, with net and rays of the higher one."""

    def between(a: int, b: int, unit: int = 1) -> int:
        return max(round(math.sqrt(a * b) / unit), 1) * unit

    return replace(
        high,
        width=between(low.width, high.width, 8),
        height=between(low.height, high.height, 8),
        streets=between(low.streets, high.streets),
        shots=between(low.shots, high.shots),
        train=with_steps(high.train, between(low.train.steps, high.train.steps)),
    )


def fidelities(low: Fidelity, high: Fidelity) -> tuple[Fidelity, ...]:
    """The lowest fidelity, one between, and the highest."""
    return tuple(dict.fromkeys((low, middle(low, high), high)))
