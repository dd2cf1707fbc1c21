"""Buses: a chamfered hull with rows of windows, doors on the right, a lit destination board."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, block, merge
from scene.assets._palette import AMBER, BLACK, GLASS, HEADLAMP, PLATE, STEEL, TAILLAMP, TRIM, pick
from scene.assets._vehicle import Walls, arch, axle, hull, lamps, panel, walls, window_row


class BusParams(NamedTuple):
    """One bus; metres, and shares of the height between floor edge and roof."""

    length: float
    width: float
    height: float
    decks: int
    bays: int  # windows along each side
    glass: tuple[float, float]  # share: lower and upper edge of the windows of one deck
    wheel_radius: float
    rear_axles: int
    doors: int
    first_door: float  # m from the nose to the front door
    rake: float  # m that the top of the front is set back
    board: bool  # destination board
    color: Color = (0.3, 0.02, 0.02)
    skirt: Color = (0.05, 0.05, 0.05)  # lower band of the sides
    stripe: bool = False


_MODELS: dict[str, BusParams] = {
    "single decker": BusParams(11.8, 2.55, 3.05, 1, 7, (0.36, 0.86), 0.48, 1, 2, 0.45, 0.10, True),
    "double decker": BusParams(10.8, 2.52, 4.30, 2, 6, (0.34, 0.84), 0.48, 1, 1, 0.5, 0.18, True),
    "coach": BusParams(12.2, 2.55, 3.55, 1, 6, (0.50, 0.90), 0.50, 2, 1, 0.6, 0.40, False),
    "minibus": BusParams(7.2, 2.15, 2.75, 1, 4, (0.42, 0.86), 0.36, 1, 1, 2.1, 0.45, True),
    "midibus": BusParams(9.3, 2.40, 2.90, 1, 5, (0.34, 0.88), 0.42, 1, 1, 0.4, 0.15, True),
}
KINDS: tuple[str, ...] = tuple(_MODELS)
"""Body types."""

_LIVERIES: tuple[Color, ...] = (
    (0.38, 0.016, 0.018),  # red
    (0.62, 0.62, 0.60),  # white
    (0.50, 0.45, 0.33),  # cream
    (0.52, 0.31, 0.025),  # yellow
    (0.025, 0.07, 0.22),  # blue
    (0.03, 0.16, 0.08),  # green
    (0.34, 0.35, 0.36),  # silver
)
_FLOOR = 0.32
"""Height of the lower edge of the body, m."""


def sample_bus(rng: np.random.Generator, kind: str) -> BusParams:
    """Draw a bus of one body type: size within 5 %, livery."""
    model = _MODELS[kind]
    color = pick(rng, _LIVERIES)
    return model._replace(
        length=model.length * rng.uniform(0.95, 1.05),
        height=model.height * rng.uniform(0.98, 1.02),
        bays=model.bays + int(rng.integers(0, 2)),
        color=color,
        skirt=pick(rng, _LIVERIES if rng.random() < 0.4 else (BLACK, TRIM)),
        stripe=bool(rng.random() < 0.5),
    )


def bus(params: BusParams) -> Asset:
    """The bus of ``params``, driving towards +x, its doors on the right."""
    p = params
    side = walls(p.length, p.width, _FLOOR, p.height)
    parts = [
        hull(p.length, p.width, _FLOOR, p.height, p.color, nose=p.rake, chamfer=0.16),
        *_running_gear(p),
        *_ends(p, side),
        *_doors(p, side),
    ]
    for deck in range(p.decks):
        low, high = ((deck + g) / p.decks for g in p.glass)
        start, end = 0.02, 0.985 - 1.2 * p.rake / p.length
        parts.append(window_row(side.left, p.bays, (1 - end, 1 - start), (low, high), 0.09))
        if deck:
            parts.append(window_row(side.right, p.bays, (start, end), (low, high), 0.09))
    for wall in (side.left, side.right):
        parts.append(panel(wall, (0, 1), (0, 0.1), p.skirt, lift=0.006))
        if p.stripe:
            low = p.glass[0] / p.decks
            parts.append(panel(wall, (0, 1), (low - 0.09, low - 0.03), p.skirt, lift=0.006))
    return merge(*parts)


def _axles(p: BusParams) -> list[float]:
    front = p.length / 2 - (2.6 if p.length > 8 else 1.4)
    rear = -p.length / 2 + 0.27 * p.length
    return [front, rear] + ([rear - 1.3] if p.rear_axles == 2 else [])


def _running_gear(p: BusParams) -> list[Asset]:
    half, radius = p.width / 2, p.wheel_radius
    parts = []
    for x in _axles(p):
        parts.append(axle(x, half + 0.02, radius, 0.3, STEEL, rim_share=0.55))
        parts += [arch(x, y, radius, radius + 0.09) for y in (half + 0.013, -half - 0.013)]
    return parts


def _doors(p: BusParams, side: Walls) -> list[Asset]:
    """Glass doors down to the floor on the right, windows between them."""
    high = p.glass[1] / p.decks
    width = 1.25 / p.length
    starts = [1 - p.first_door / p.length - width] + [0.48] * (p.doors - 1)
    parts = []
    for start in starts:
        leaf = (start, start + width / 2 - 0.03 / p.length), (start + width / 2, start + width)
        parts.append(panel(side.right, (start - 0.004, start + width + 0.004), (0.03, high), TRIM))
        parts += [
            panel(side.right, u, (0.07, high - 0.02), GLASS, "glass", lift=0.02) for u in leaf
        ]
    low = p.glass[0] / p.decks
    edges = [0.985 - 1.2 * p.rake / p.length, *(e for s in starts for e in (s + width, s)), 0.02]
    for end, start in zip(edges[::2], edges[1::2], strict=True):
        if end - start > 0.05:
            count = max(1, round((end - start) * p.bays))
            parts.append(window_row(side.right, count, (start, end), (low, high), 0.09))
    return parts


def _ends(p: BusParams, side: Walls) -> list[Asset]:
    """Windscreens, rear windows, destination boards, lamps, plates and bumpers."""
    front, rear = side.front.copy(), side.rear
    front[2:, 0] -= p.rake
    top = 1 - 0.16 / (p.height - _FLOOR)
    parts = []
    for deck in range(p.decks):
        low, high = (deck + p.glass[0] - 0.06) / p.decks, (deck + p.glass[1] - 0.02) / p.decks
        parts.append(panel(front, (0.05, 0.95), (low, high), GLASS, "glass"))
        parts.append(panel(rear, (0.12, 0.88), (low + 0.06, high), GLASS, "glass"))
    board = (p.glass[1] - 0.01) / p.decks
    if p.board:
        height = min(0.14 / p.decks, top - board) if p.decks == 1 else 0.1
        parts.append(panel(front, (0.14, 0.86), (board, board + height), BLACK, lift=0.02))
        text = (board + 0.25 * height, board + 0.75 * height)
        parts.append(panel(front, (0.24, 0.76), text, AMBER, lift=0.03))
    parts += [
        panel(front, (0, 1), (0, 0.07 / p.decks + 0.02), TRIM),
        panel(rear, (0, 1), (0, 0.07 / p.decks + 0.02), TRIM),
        panel(front, (0.4, 0.6), (0.05, 0.09), PLATE, lift=0.03),
        panel(rear, (0.4, 0.6), (0.11, 0.15), PLATE, lift=0.03),
        lamps(front, (0.04, 0.2), (0.12 / p.decks + 0.02, 0.2 / p.decks + 0.02), HEADLAMP),
        lamps(rear, (0.02, 0.1), (0.14 / p.decks, 0.32 / p.decks), TAILLAMP),
    ]
    x, z = p.length / 2 + 0.1, min(2.3, 0.75 * p.height)
    for y in (p.width / 2 + 0.12, -p.width / 2 - 0.12):
        parts.append(block((x - 0.12, y - 0.09, z - 0.35), (x, y + 0.09, z), TRIM))
    return parts
