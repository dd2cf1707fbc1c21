"""The background that closes the horizon: the street's continuation, and rows of houses and trees.

It is beyond the lines that attributes control and has its own random stream, so that it does not change them.
Streets with few buildings are among trees and fields, so the background thins out with them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from scene.attributes import StreetParams
from scene.ground.path import Path

LINES_END = 165.0
"""Metres along the road at which lines of objects have ended."""
BEHIND = 36.0
"""Metres from the centre line beyond which no line has objects."""
VISTA_END = 300.0
"""Metres along the road at which the continuation ends."""
BELT = 11.0
"""Metres between objects on the outer side of a bend."""
WOODS = 0.55
"""Share of places without a house that have a tree; the others stay empty."""


class Backdrop(NamedTuple):
    """One object of the background, standing on the ground."""

    family: str
    x: float  # metres along the road
    y: float  # metres left of the centre line
    yaw: float  # radians left of the driving direction


def background(params: StreetParams, rng: np.random.Generator) -> list[Backdrop]:
    """Houses, trees and bushes around the street; consumes ``rng``."""
    town = 0.06 + 0.84 * params.building_probability
    across = float(rng.uniform(LINES_END + 10, VISTA_END + 40))
    return [
        *_vista(params, town, across, rng),
        *_closure(town, across, rng),
        *(thing for side in (1.0, -1.0) for thing in _back_row(side, town, rng)),
    ]


def _vista(
    params: StreetParams, town: float, end: float, rng: np.random.Generator
) -> list[Backdrop]:
    """The street's continuation: houses on both sides, as far from the road as before."""
    things = []
    for side in (1.0, -1.0):
        for x in np.arange(LINES_END + 6, end - 12, max(params.building_interval, 13.0)):
            place = float(x + rng.uniform(-1, 1))
            yaw = 0.0 if side > 0 else math.pi
            set_back = params.building_position + float(rng.uniform(0, 1.5))
            kind = _kind(town, rng)
            if kind:
                things.append(Backdrop(kind, place, side * set_back, yaw))
    return things


def _closure(town: float, end: float, rng: np.random.Generator) -> list[Backdrop]:
    """A row across the end of the road, where it bends or meets another road, with trees in front."""
    things = []
    for y in np.arange(-84.0, 84.0, 13.0) + rng.uniform(-6, 6):
        kind = _kind(town, rng, woods=0.9)
        at = end + float(rng.uniform(0, 3)) + 0.0015 * float(y) ** 2
        if kind:
            things.append(Backdrop(kind, at, float(y), -math.pi / 2))
        if rng.random() < 0.5:
            things.append(_tree(at - rng.uniform(4, 9), float(y) + rng.uniform(-6, 6), rng))
    return things


def _back_row(side: float, town: float, rng: np.random.Generator) -> list[Backdrop]:
    """The next street, visible through gaps: backs or fronts of houses, with gardens."""
    things = []
    row = float(rng.uniform(BEHIND + 6, BEHIND + 20))
    for x in np.arange(-5.0, 260.0, 15.0):
        kind = _kind(0.8 * town, rng, woods=0.75)
        place = float(x + rng.uniform(-2, 2))
        yaw = 0.0 if rng.random() < 0.5 else math.pi
        if kind == "building":
            # A house that faces away extends from its origin towards the road.
            depth = 14.0 if (yaw == 0.0) != (side > 0) else 0.0
            things.append(Backdrop(kind, place, side * (row + depth), yaw))
        elif kind:
            things.append(_tree(place, side * (row + rng.uniform(0, 12)), rng))
        if rng.random() < 0.45:
            things.append(_tree(place + 7, side * rng.uniform(BEHIND, row), rng))
    return things


def belt(path: Path, params: StreetParams, rng: np.random.Generator) -> list[Backdrop]:
    """Houses and trees on the outer side of bends, where rows that follow the road have wide gaps."""
    town = 0.06 + 0.84 * params.building_probability
    things = []
    for (start, _), (_, curvature), _, (end, _) in zip(*[iter(path.bends)] * 4, strict=True):
        out = -1.0 if curvature > 0 else 1.0
        for row in (BEHIND - 4, BEHIND + 28):
            x = start
            while x < min(end, LINES_END):
                kind = _kind(0.7 * town, rng, woods=0.9)
                y = out * (row + float(rng.uniform(0, 6)))
                if kind == "building":
                    things.append(Backdrop(kind, x, y, 0.0 if out > 0 else math.pi))
                elif kind:
                    things.append(_tree(x, y, rng))
                # The same distance in the world for all bends.
                x += BELT / (1 + abs(curvature * y))
    return things


def _kind(town: float, rng: np.random.Generator, woods: float = WOODS) -> str:
    """A house in town, otherwise a tree, a bush or nothing."""
    if rng.random() < town:
        return "building"
    if rng.random() < woods:
        return "tree" if rng.random() < 0.8 else "bush"
    return ""


def _tree(x: float, y: float, rng: np.random.Generator) -> Backdrop:
    family = "tree" if rng.random() < 0.85 else "bush"
    return Backdrop(family, float(x), float(y), float(rng.uniform(-math.pi, math.pi)))
