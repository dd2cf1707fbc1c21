"""A wall with real openings in the plane y = 0, and what fills them behind it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, Point, quad

RECESS = 0.14
"""Depth of the frames behind the facade (metres)."""
PANE = 0.09
"""Depth of panes and doors behind the facade: they stand before the frames (metres)."""
PROUD = 0.04
"""How far what is laid on a wall stands off it (metres)."""
BAR = 0.07
"""Width of the bars between panes (metres)."""
GLASS: Color = (0.03, 0.035, 0.04)


class Opening(NamedTuple):
    """A hole in the facade, metres."""

    left: float
    right: float
    low: float
    high: float
    glazed: bool = True


def upright(left: float, right: float, low: float, high: float, y: float) -> list[Point]:
    """Corners of an upright rectangle that faces the road."""
    return [(left, y, low), (right, y, low), (right, y, high), (left, y, high)]


def bays(width: float, count: int, share: float) -> list[tuple[float, float]]:
    """Left and right edge of an opening in each of ``count`` bays, ``share`` of the bay wide."""
    pitch = width / count
    middles = (np.arange(count) + 0.5) * pitch - width / 2
    return [(float(m - share * pitch / 2), float(m + share * pitch / 2)) for m in middles]


def pierced_wall(
    width: float,
    levels: tuple[float, float],
    columns: Sequence[Sequence[Opening]],
    color: Color,
    material: str,
) -> list[Asset]:
    """The wall between two ``levels`` around its openings.

    Args:
        width: of the wall, centred on x = 0 (metres).
        levels: of its foot and its top (metres).
        columns: openings above one another, equally wide; from left to right, from the foot up.
        color: of the wall.
        material: of the wall.

    Returns:
        Piers of the full height, and what is below, between and above the openings of a column.
    """
    low, high = levels
    edges = [-width / 2, *(e for c in columns for e in (c[0].left, c[0].right)), width / 2]
    areas = [(a, b, low, high) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    for column in columns:
        bounds = [low, *(z for o in column for z in (o.low, o.high)), high]
        gaps = zip(bounds[::2], bounds[1::2], strict=True)
        areas += [(column[0].left, column[0].right, a, b) for a, b in gaps]
    return [quad(upright(*area, 0), color, material) for area in areas]


def fill(opening: Opening, panes: tuple[int, int], door: Color) -> list[Asset]:
    """Panes of glass, so many across and up, or a door."""
    left, right, low, high, glazed = opening
    if not glazed:
        return [quad(upright(left, right, low, high, PANE), door, "paint")]
    across, up = np.linspace(left, right, panes[0] + 1), np.linspace(low, high, panes[1] + 1)
    half = BAR / 2
    return [
        quad(upright(x0 + half, x1 - half, z0 + half, z1 - half, PANE), GLASS, "glass")
        for x0, x1 in pairwise(across)
        for z0, z1 in pairwise(up)
    ]


def side_window(x: float, middle: float, low: float, high: float, frame: Color) -> list[Asset]:
    """A framed window laid on the outside of the side wall in the plane ``x``."""
    side = 1 if x > 0 else -1
    layers = ((PROUD, 0.55, 0.0, frame, "paint"), (2 * PROUD, 0.45, 0.1, GLASS, "glass"))
    return [
        quad(
            [(x + side * off, middle + s * half, z) for s, z in
             ((-1, low + margin), (1, low + margin), (1, high - margin), (-1, high - margin))],
            color, material,
        )
        for off, half, margin, color, material in layers
    ]  # fmt: skip
