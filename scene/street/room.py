"""Rectangles that objects take of the ground, and whether one more has room between them."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from scene.assets import catalogue
from scene.assets.families import FAMILIES
from scene.classes import TrainId

STEM = 0.3
"""Half the width, metres, that crowns, lamps and signs take on the ground: one stands below the rest."""
HELD = frozenset({TrainId.VEGETATION, TrainId.POLE, TrainId.TRAFFIC_SIGN, TrainId.TRAFFIC_LIGHT})
"""Classes of which only a stem is on the ground."""


class Rectangle(NamedTuple):
    """What one object takes, world metres."""

    x: float  # its middle
    y: float
    cos: float  # its own x axis
    sin: float
    long: float  # half its sides, along its x and its y axis
    wide: float


def footprint(family: str, ref: int | str, pose: np.ndarray) -> Rectangle:
    """The rectangle below an asset in a pose f64[4, 4]."""
    x, y, long, wide = _own(family, ref)
    (a, b, _, east), (c, d, _, north) = pose[:2].tolist()
    size = math.hypot(a, c)
    return Rectangle(a * x + b * y + east, c * x + d * y + north, a / size, c / size, long, wide)


@lru_cache(maxsize=4096)
def _own(family: str, ref: int | str) -> tuple[float, float, float, float]:
    """Middle x, y and half length and width of an asset in its own frame, metres."""
    low, high = (corner[:2] for corner in catalogue.bounds(family, ref))
    if FAMILIES[family].train_id in HELD and family != "bush":
        low, high = np.maximum(low, -STEM), np.minimum(high, STEM)
    (x, y), (long, wide) = ((low + high) / 2).tolist(), ((high - low) / 2).tolist()
    return x, y, long, wide


class Rectangles:
    """Rectangles that become more."""

    def __init__(self) -> None:
        """None yet."""
        self._count = 0
        self._rows = np.zeros((6, 64))
        self._radii = np.zeros(64)

    def add(self, box: Rectangle) -> None:
        """One more."""
        if self._count == len(self._radii):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)], axis=1)
            self._radii = np.concatenate([self._radii, np.zeros_like(self._radii)])
        self._rows[:, self._count] = box
        self._radii[self._count] = math.hypot(box.long, box.wide)
        self._count += 1

    def meet(self, box: Rectangle, spare: float) -> bool:
        """Whether one of them comes nearer than ``spare`` metres to ``box``."""
        rows = self._rows[:, : self._count]
        x, y = rows[0] - box.x, rows[1] - box.y
        reach = self._radii[: self._count] + (math.hypot(box.long, box.wide) + 2 * abs(spare))
        near = np.flatnonzero(x * x + y * y <= reach * reach)
        return any(_meets(box, Rectangle(*rows[:, k].tolist()), spare) for k in near)


def _meets(box: Rectangle, other: Rectangle, spare: float) -> bool:
    """Whether two rectangles are nearer than ``spare``.

    They are apart if they are along one of their four axes.
    """
    long, wide = box.long + spare, box.wide + spare
    cos = abs(other.cos * box.cos + other.sin * box.sin)
    sin = abs(other.cos * box.sin - other.sin * box.cos)
    x, y = other.x - box.x, other.y - box.y
    return (
        abs(x * box.cos + y * box.sin) < long + other.long * cos + other.wide * sin
        and abs(y * box.cos - x * box.sin) < wide + other.long * sin + other.wide * cos
        and abs(x * other.cos + y * other.sin) < other.long + long * cos + wide * sin
        and abs(y * other.cos - x * other.sin) < other.wide + long * sin + wide * cos
    )
