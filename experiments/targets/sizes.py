"""Choose the image size of `fit`: the photographs' own, or the largest that takes the allowed minutes."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from common.errors import UserError, counted
from common.progress import duration
from experiments.config.config import FitPreset

Size = tuple[int, int]
"""Width and height in pixels."""
AREAS: dict[FitPreset, tuple[int, int]] = {
    "smoke": (64 * 48,) * 2,
    "quick": (240 * 176, 480 * 360),
    "full": (480 * 360,) * 2,
}
"""Approximate pixels of the smallest and the largest size that a preset takes."""
MINUTES = 10.0
"""The most minutes that a size may take on this machine, unless the user allows others."""
STEPS = 64
"""Number of areas to try."""
UNIT, SMALLEST = 8, 32
"""Width and height are multiples of the first and at least the second, the coarsest stride of a backbone."""


class Choice(NamedTuple):
    """A size, its seconds on this machine, and those of the smallest size."""

    size: Size
    seconds: float
    smallest: Size
    smallest_seconds: float

    def text(self, workers: int) -> str:
        """Describe size and time in one line."""
        time = f"about {duration(self.seconds)} on {counted(workers, 'worker')}"
        chosen = f"Images of {words(self.size)}, {time}"
        if math.prod(self.size) <= math.prod(self.smallest):
            return chosen
        return f"{chosen}; {words(self.smallest)} would take {duration(self.smallest_seconds)}"


def words(size: Size) -> str:
    """Write a size as its flag takes it."""
    return f"{size[0]}x{size[1]}"


def suitable_size(width: int, height: int, pixels: int = AREAS["quick"][0]) -> Size:
    """Return a size with an image's aspect ratio and about so many pixels, but no more than its own."""
    scale = min(math.sqrt(pixels / (width * height)), 1.0)
    wide, high = (max(round(scale * side / UNIT) * UNIT, SMALLEST) for side in (width, height))
    return wide, high


def choose(
    shape: Size,
    preset: FitPreset,
    seconds: Callable[[Size], float],
    fits: Callable[[Size], bool] = lambda size: True,
    *,
    size: Size | None = None,
    minutes: float | None = None,
) -> Choice:
    """Choose the largest size that fits into memory and takes at most the minutes, else the smallest.

    Args:
        shape: width and height of the photographs.
        preset: its `AREAS` bound the choice.
        seconds: the time that a size takes on this machine; grows with its pixels.
        fits: whether a size fits into memory.
        size: a size that is already decided.
        minutes: the most that it may take; by default `MINUTES`, except for the smallest size.

    Raises:
        UserError: the smallest size takes longer than ``minutes``.
    """
    areas = np.linspace(*AREAS[preset], STEPS)
    sizes = sorted({suitable_size(*shape, area) for area in areas}, key=math.prod)
    smallest, smallest_seconds = sizes[0], seconds(sizes[0])
    if size is None:
        limit = 60 * (MINUTES if minutes is None else minutes)
        if minutes is not None and smallest_seconds > limit:
            raise UserError(
                f"--minutes {minutes:g} is too little: {words(smallest)}, the smallest size, takes "
                f"{math.ceil(smallest_seconds / 6) / 10:g} minutes here; allow as many, take fewer --seeds, "
                "or name a --size"
            )
        quick = sizes[: bisect_right(sizes, limit, key=seconds)]
        size = next(filter(fits, reversed(quick)), smallest)
    return Choice(size, seconds(size), smallest, smallest_seconds)
