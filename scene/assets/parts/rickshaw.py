"""Auto-rickshaws: a tub on three wheels under a canvas hood, open at the sides."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.parts.palette import (
    AMBER,
    BLACK,
    CHROME,
    GLASS,
    HEADLAMP,
    PLATE,
    STEEL,
    TAILLAMP,
    TRIM,
    pick,
)
from scene.assets.parts.skin import cuboid, in_plane, pair, twin_sheets
from scene.assets.parts.vehicle import card
from scene.assets.parts.wheel import Wheel, wheel
from scene.mesh.asset import Asset, Color, Parts, merge, translate
from scene.mesh.solids import ellipsoid, loft, polygon, tube

_PAINTS: tuple[tuple[Color, Color], ...] = (
    ((0.02, 0.12, 0.04), (0.55, 0.36, 0.03)), ((0.012, 0.012, 0.012), (0.55, 0.36, 0.03)),
    ((0.55, 0.36, 0.03), (0.015, 0.015, 0.015)), ((0.02, 0.11, 0.04), (0.015, 0.015, 0.015)),
    ((0.03, 0.08, 0.3), (0.015, 0.015, 0.015)), ((0.3, 0.02, 0.02), (0.03, 0.03, 0.032)),
)  # fmt: skip
"""Colours of tub and hood."""


class Rickshaw(NamedTuple):
    """One auto-rickshaw; metres."""

    length: float
    width: float
    height: float
    tub: Color
    hood: Color
    skin: Color | None  # of the driver; None without one
    clothes: Color


def sample_rickshaw(rng: np.random.Generator) -> Rickshaw:
    """Draw an auto-rickshaw: size, paint, and whether it has a driver."""
    tub, hood = _PAINTS[rng.integers(len(_PAINTS))]
    length, width, height = rng.uniform([2.55, 1.28, 1.66], [2.75, 1.36, 1.76])
    return Rickshaw(
        length, width, height, pick(rng, (tub,), 0.2), pick(rng, (hood,), 0.2),
        pick(rng, ((0.16, 0.08, 0.05),), 0.3) if rng.random() < 0.7 else None,
        pick(rng, ((0.3, 0.26, 0.2), (0.35, 0.36, 0.38), (0.05, 0.07, 0.14))),
    )  # fmt: skip


def rickshaw(r: Rickshaw) -> Asset:
    """Build the rickshaw, its single wheel towards +x."""
    nose, tail, half = r.length / 2, -r.length / 2, r.width / 2
    front, rear = nose - 0.3, tail + 0.45
    spec = Wheel(0.22, 0.1, "steel", 8, 0.55, STEEL, 0.3)
    rear_wheel = translate(wheel(spec), (rear, half - 0.03, 0))
    front_wheel = translate(wheel(spec), (front, 0.05, 0))
    parts = [pair(rear_wheel), pair(front_wheel), *_tub(r), *_hood(r), *_front(r), *_driver(r)]
    for y in (half - 0.16, 0.16 - half):
        parts.append(card((tail - 0.012, y, 0.62), 0.12, 0.1, TAILLAMP, "lamp"))
    parts.append(card((tail - 0.012, 0.0, 0.5), 0.34, 0.1, PLATE))
    parts.append(card((tail + 0.035, 0.0, r.height - 0.42), 0.55, 0.2, GLASS, "glass"))
    return merge(*parts)


def _section(half: float, low: float, high: float, top: float) -> np.ndarray:
    """Return a cross-section f64[8, 2] (y, z), its top edge ``top`` times as wide."""
    right = [(0.86 * half, low), (half, low + 0.1), (half, high - 0.06), (top * half, high)]
    return np.array(right + [(-y, z) for y, z in right[::-1]])


def _tub(r: Rickshaw) -> Parts:
    """Build floor, closed rear and seats, and a dark sheet that blocks the view through the open sides."""
    nose, tail, half = r.length / 2, -r.length / 2, r.width / 2
    rings = [in_plane(tail, _section(0.9 * half, 0.34, 0.86, 0.92))]
    for x, high in ((0.14, 0.9), (0.85, 0.72)):
        rings.append(in_plane(tail + x, _section(half, 0.28, high, 0.96)))
    yield loft(rings, r.tub, "paint")
    yield cuboid((tail + 0.8, nose - 0.55), 0.92 * half, (0.26, 0.36), r.tub, "paint")
    yield cuboid((tail + 0.2, tail + 0.75), 0.84 * half, (0.7, 0.8), TRIM, "cloth")
    yield cuboid((tail + 0.12, tail + 0.24), 0.84 * half, (0.75, 1.2), TRIM, "cloth")
    yield cuboid((0.16, 0.5), 0.3, (0.36, 0.72), TRIM, "cloth")
    x, top = tail + 0.1, r.height - 0.1
    yield polygon([(x, 0, 0.4), (nose - 0.6, 0, 0.4), (nose - 0.72, 0, top), (x, 0, top)], BLACK)


def _hood(r: Rickshaw) -> Parts:
    """Build the canvas: roof, rear, and the quarters next to the seat."""
    tail, half, top = -r.length / 2, r.width / 2, r.height
    front = r.length / 2 - 0.72
    edge = ((tail + 0.02, 0.06), (tail + 0.3, 0.0), (front - 0.2, 0.01), (front + 0.08, 0.08))
    roof = [in_plane(x, _section(0.97 * half, top - 0.16, top - drop, 0.8)) for x, drop in edge]
    yield loft(roof, r.hood, "cloth")
    yield cuboid((tail + 0.02, tail + 0.06), 0.9 * half, (0.85, top - 0.1), r.hood, "cloth")
    foot = [(tail + 0.04, 0.93 * half, 0.85), (tail + 0.55, 0.95 * half, 0.85)]
    head = [(tail + 0.04, 0.95 * half, top - 0.12), (tail + 0.75, 0.96 * half, top - 0.12)]
    yield twin_sheets(np.array([foot, head]), r.hood, "cloth")
    for x in (0.1, front + 0.06):
        post = (x, 0.93 * half, 0.3), (x - 0.06, 0.95 * half, top - 0.1)
        yield pair(tube(*post, 0.02, BLACK, "metal", sides=5))


def _front(r: Rickshaw) -> Parts:
    """Build the shield, rounded in plan, with windscreen, lamp, mudguard and mirrors."""
    nose, half, top = r.length / 2, r.width / 2, r.height
    turn = np.linspace(0, np.pi / 2, 5)

    def bow(z: float, back: float, width: float, bulge: float, turn: np.ndarray) -> np.ndarray:
        x, y = nose - back + bulge * np.cos(turn), width * half * np.sin(turn)
        return np.column_stack([x, y, np.full(len(turn), z)])

    shield = ((0.38, 0.5, 0.9), (0.62, 0.42, 0.98), (0.98, 0.5, 0.96))  # z, back, width
    screen = ((1.0, 0.5, 0.95), (top - 0.14, 0.68, 0.93))
    yield twin_sheets(np.array([bow(*row, 0.16, turn) for row in shield]), r.tub)
    yield twin_sheets(np.array([bow(*row, 0.15, turn[:4]) for row in screen]), GLASS, "glass")
    yield pair(ellipsoid((nose - 0.5, half + 0.05, 1.12), (0.02, 0.07, 0.05), BLACK))
    yield pair(ellipsoid((nose - 0.42, 0.55 * half, 0.66), (0.03, 0.04, 0.03), AMBER, "paint"))
    yield ellipsoid((nose - 0.3, 0, 0.4), (0.3, 0.1, 0.12), r.tub, "paint")
    yield tube((nose - 0.36, 0, 0.72), (nose - 0.18, 0, 0.72), 0.09, HEADLAMP, "lamp", sides=10)
    yield cuboid((nose - 0.3, nose - 0.25), 0.2, (0.9, 0.94), CHROME, "metal")


def _driver(r: Rickshaw) -> Parts:
    if r.skin is not None:
        yield ellipsoid((0.3, 0, 0.98), (0.15, 0.22, 0.3), r.clothes, "cloth")
        yield ellipsoid((0.36, 0, 1.37), (0.1, 0.08, 0.12), r.skin, "skin")
        yield pair(tube((0.34, 0.2, 1.12), (0.66, 0.24, 0.98), 0.05, r.clothes, "cloth"))
