"""Decides the size of the images of `fit`: the photographs' own, or the largest that the minutes allow."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from common.errors import UserError
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
"""A size may take so many minutes of this machine unless the user allows others."""
STEPS = 64
"""Number of areas that are tried."""
UNIT, SMALLEST = 8, 32
"""Width and height are multiples of the first and at least the second, the coarsest stride of a trunk."""


class Choice(NamedTuple):
    """A size, its seconds on this machine, and what the smallest size takes."""

    size: Size
    seconds: float
    smallest: Size
    smallest_seconds: float

    def text(self, workers: int) -> str:
        """One line on size and time."""
        ours = (
            f"Images of {words(self.size)}, about {duration(self.seconds)} on {workers} worker(s)"
        )
        if math.prod(self.size) <= math.prod(self.smallest):
            return ours
        return f"{ours}; {words(self.smallest)} would take {duration(self.smallest_seconds)}"


def words(size: Size) -> str:
    """A size as its flag has it."""
    return f"{size[0]}x{size[1]}"


def suitable_size(width: int, height: int, pixels: int = AREAS["quick"][0]) -> Size:
    """The aspect of an image, with about so many pixels but no more than its own."""
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
    """Choose the largest size that takes at most the minutes and fits into memory, else the smallest.

    Args:
        shape: width and height of the photographs.
        preset: its `AREAS` bound the choice.
        seconds: the time that a size takes on this machine; grows with its pixels.
        fits: whether a size fits into memory.
        size: a size that is decided already.
        minutes: the most that it may take; by default `MINUTES`, but for the smallest size.

    Raises:
        UserError: the smallest size takes longer than ``minutes``.
    """
    areas = np.linspace(*AREAS[preset], STEPS)
    sizes = sorted({suitable_size(*shape, area) for area in areas}, key=math.prod)
    smallest, least = sizes[0], seconds(sizes[0])
    if size is None:
        limit = 60 * (MINUTES if minutes is None else minutes)
        if minutes is not None and least > limit:
            raise UserError(
                f"--minutes {minutes:g} is too little: {words(smallest)}, the smallest size, takes "
                f"{math.ceil(least / 6) / 10:g} minutes here; allow these, or fewer --seeds, or name a --size"
            )
        quick = sizes[: bisect_right(sizes, limit, key=seconds)]
        size = next(filter(fits, reversed(quick)), smallest)
    return Choice(size, seconds(size), smallest, least)
