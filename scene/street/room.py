"""Rectangles that objects take of the ground, and whether one more has room between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from scene.assets import catalogue
from scene.assets.families import FAMILIES
from scene.classes import TrainId
from scene.compiled import njit

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


def footprint(parts: Sequence[tuple[str, int | str]], pose: np.ndarray) -> Rectangle:
    """The rectangle below assets, families and references, that share a pose f64[4, 4]."""
    own = [own_rectangle(family, ref) for family, ref in parts]
    left, right = min(x - long for x, _, long, _ in own), max(x + long for x, _, long, _ in own)
    back, front = min(y - wide for _, y, _, wide in own), max(y + wide for _, y, _, wide in own)
    x, y, long, wide = (
        (left + right) / 2,
        (back + front) / 2,
        (right - left) / 2,
        (front - back) / 2,
    )
    (a, b, _, east), (c, d, _, north) = pose[:2].tolist()
    size = math.hypot(a, c)
    return Rectangle(a * x + b * y + east, c * x + d * y + north, a / size, c / size, long, wide)


@lru_cache(maxsize=4096)
def own_rectangle(family: str, ref: int | str) -> tuple[float, float, float, float]:
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
        self._rows = np.zeros((64, 6))
        self._radii = np.zeros(64)

    def add(self, box: Rectangle) -> None:
        """One more."""
        if self._count == len(self._radii):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
            self._radii = np.concatenate([self._radii, np.zeros_like(self._radii)])
        self._rows[self._count] = box
        self._radii[self._count] = math.hypot(box.long, box.wide)
        self._count += 1

    def meet(self, box: Rectangle, spare: float) -> bool:
        """Whether one of them comes nearer than ``spare`` metres to ``box``."""
        reach = math.hypot(box.long, box.wide) + 2 * abs(spare)
        return _meet(self._rows, self._radii, self._count, *box, spare, reach)


@njit(cache=True)
def _meet(
    rows: np.ndarray,
    radii: np.ndarray,
    count: int,
    own_x: float,
    own_y: float,
    own_cos: float,
    own_sin: float,
    long: float,
    wide: float,
    spare: float,
    reach: float,
) -> bool:
    """Whether one of the first ``count`` of f64[rectangles, 6] is nearer than ``spare`` to another one.

    Only those in ``reach`` beyond their radius are looked at; they are apart if they are along one of the
    four axes of the two.
    """
    long, wide = long + spare, wide + spare
    for k in range(count):
        x, y = rows[k, 0] - own_x, rows[k, 1] - own_y
        far = radii[k] + reach
        if x * x + y * y > far * far:
            continue
        other_cos, other_sin, other_long, other_wide = (
            rows[k, 2],
            rows[k, 3],
            rows[k, 4],
            rows[k, 5],
        )
        cos = abs(other_cos * own_cos + other_sin * own_sin)
        sin = abs(other_cos * own_sin - other_sin * own_cos)
        if (
            abs(x * own_cos + y * own_sin) < long + other_long * cos + other_wide * sin
            and abs(y * own_cos - x * own_sin) < wide + other_long * sin + other_wide * cos
            and abs(x * other_cos + y * other_sin) < other_long + long * cos + wide * sin
            and abs(y * other_cos - x * other_sin) < other_wide + long * sin + wide * cos
        ):
            return True
    return False
