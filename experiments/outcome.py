"""What one evaluation came to. Worker processes load this file; it knows nothing of search methods."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from experiments.reward import Evaluation
from seg.train import TrainingError


class Outcome(NamedTuple):
    """What one dataset was worth, or why that is not known."""

    reward: float  # mIoU in [0, 1]; NaN if it failed
    class_iou: list[float | None]  # None for classes that do not occur in the truth
    render_seconds: float
    train_seconds: float
    failed: str | None = None
    stored: bool = False  # it was known, and took no time now

    @property
    def seconds(self) -> float:
        """What the evaluation took, when it was made, on a worker's one core."""
        return self.render_seconds + self.train_seconds


def attempt(evaluate: Callable[..., Evaluation], *arguments: Any) -> Outcome:
    """Evaluate; training that diverges is an outcome, too."""
    started = time.perf_counter()
    try:
        found = evaluate(*arguments)
    except TrainingError as error:
        return Outcome(math.nan, [], 0.0, time.perf_counter() - started, str(error))
    if not math.isfinite(found.reward):
        return Outcome(found.reward, [], 0.0, time.perf_counter() - started)
    return Outcome(found.reward, found.class_iou, found.render_seconds, found.train_seconds)
