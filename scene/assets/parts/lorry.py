"""The parameters of lorries, and their closed bodies: boxes with doors, rails, curtains and lettering."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.parts.glazing import EMPTY, Glazing
from scene.assets.parts.palette import BLACK, STEEL, TRIM, darker
from scene.assets.parts.skin import Span, cuboid
from scene.assets.parts.vehicle import Walls, lettering, panel, panels, strips, walls
from scene.mesh.asset import Color, Parts
from scene.mesh.solids import loft


class TruckParams(NamedTuple):
    """One lorry; metres."""

    load: str  # see ``LOADS`` in truck.py
    length: float
    width: float
    height: float  # of the load
    cab_length: float
    cab_height: float
    axles: tuple[float, ...]  # from the nose to each
    wheel_radius: float
    gap: float  # between cab and load
    windscreen: Span  # shares of the cab's height
    rake: float  # m that the cab's roof is set back
    cab: Color = (0.5, 0.5, 0.5)
    body: Color = (0.6, 0.6, 0.6)
    letters: Color | None = None  # on the sides
    band: Color | None = None  # along the sides
    visor: bool = False  # over the windscreen
    deflector: bool = False  # on the cab's roof
    beacons: bool = False
    round: float = 0.18  # radius of the cab's corners
    grille: Span = (0.2, 0.42)  # shares of the cab's height
    fill: float = 0.7  # how full a load bed is
    seed: int = 0  # of lettering and cargo
    glazing: Glazing = EMPTY


def floor(p: TruckParams) -> float:
    """Return the height of the load bed, m."""
    return 2 * p.wheel_radius + 0.12


def bed(p: TruckParams) -> tuple[float, float, float]:
    """Return centre x, length and width of the load, m."""
    length = p.length - p.cab_length - p.gap
    return -p.length / 2 + length / 2, length, p.width


def sign(p: TruckParams, side: Walls, u: Span, v: Span) -> Parts:
    """Build a band and lettering on both sides."""
    if p.band is not None:
        height = 0.25 * (v[1] - v[0])
        below = (v[0] - height, v[0] - 0.1 * height)
        yield from (panel(wall, (0, 1), below, p.band, "paint") for wall in side[:2])
    if p.letters is not None:
        yield from (lettering(wall, u, v, p.letters, p.seed) for wall in side[:2])


def _doors(rear: np.ndarray) -> Parts:
    """Build rear doors: a seam, upright locking bars and hinges."""
    yield panel(rear, (0.495, 0.505), (0.03, 0.97), BLACK)
    bars, hinges = strips((0.2, 0.4, 0.6, 0.8), 0.006), [(v, v + 0.02) for v in (0.12, 0.5, 0.86)]
    yield panels(rear, bars, [(0.02, 0.98)], STEEL, "metal", lift=0.03)
    yield panels(rear, [(0.0, 0.05), (0.95, 1.0)], hinges, TRIM, "metal", lift=0.03)


def _edges(side: Walls, color: Color) -> Parts:
    """Build rails round the edges of a box body, which catch the light."""
    for wall in (side.left, side.right, side.rear, side.front):
        yield panels(wall, [(0, 1)], [(0, 0.035), (0.965, 1)], color, "metal", lift=0.02)
        yield panels(wall, [(0, 0.012), (0.988, 1)], [(0, 1)], color, "metal", lift=0.02)


def _box_body(p: TruckParams, side: Walls, material: str, rails: Color, u: Span, v: Span) -> Parts:
    """Build a body with rear doors, rails round its edges, and lettering on its sides."""
    x, length, width = bed(p)
    ends = (x - length / 2, x + length / 2)
    yield cuboid(ends, width / 2, (floor(p), p.height), p.body, material)
    yield from _doors(side.rear)
    yield from _edges(side, rails)
    yield from sign(p, side, u, v)


def _sides(p: TruckParams) -> Walls:
    x, length, width = bed(p)
    return walls(length, width, floor(p), p.height, x=x)


def box(p: TruckParams) -> Parts:
    """Build a closed box body."""
    rails = STEEL if max(p.body) > 0.3 else darker(p.body, 1.6)
    return _box_body(p, _sides(p), "paint", rails, (0.14, 0.86), (0.38, 0.74))


def curtain(p: TruckParams) -> Parts:
    """Build a box whose sides are curtains: folds, straps and buckles."""
    side = _sides(p)
    yield from _box_body(p, side, "plain", STEEL, (0.1, 0.9), (0.3, 0.8))
    for wall in side[:2]:
        for share in np.linspace(0.03, 0.97, max(6, round(bed(p)[1] / 0.7))):
            fold, buckle = ((share - half, share + half) for half in (0.002, 0.004))
            yield panel(wall, fold, (0.02, 0.95), darker(p.body, 0.5))
            yield panel(wall, buckle, (0.0, 0.06), TRIM, lift=0.03)


def luton(p: TruckParams) -> Parts:
    """Build a box that reaches forward over the cab."""
    x, length, width = bed(p)
    front, top = x + length / 2, p.height
    brow = [(front, p.cab_height + 0.04), (front + 1.0, p.cab_height + 0.1)]
    brow += [(front + 1.15, top - 0.35), (front + 0.9, top), (front, top)]
    rings = [np.array([(u, y, v) for u, v in brow]) for y in (width / 2, -width / 2)]
    yield from box(p)
    yield loft(rings, p.body, "paint")
