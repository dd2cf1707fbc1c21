"""Additions to a facade: shop fronts and signs, bay windows, balconies, cornices, pipes, dishes.

Each layer has its own distance from the wall, at least 3 cm from the others, so that no two flicker in the
same plane where they cross.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from itertools import pairwise

import numpy as np

from scene.assets.parts.facade import PROUD, Finish, Part, Patch, bays, relief, upright
from scene.assets.parts.palette import BLACK, WINDOW
from scene.assets.parts.skin import Span
from scene.mesh.asset import Color, Point
from scene.mesh.solids import block, disc, polygon, tube

STRING, PIPE, BOARD, PILASTER, CORNICE = 0.115, 0.15, 0.19, 0.27, 0.32
"""Distances from the wall (metres)."""
BAY_DEPTH = 0.6
"""Depth of bay windows and balconies (metres)."""


def band(span: Span, depth: float, base: float, height: float, color: Color) -> Part:
    """Build a slab along the facade, set into it by 5 cm."""
    return relief((span[0], -depth, base), (span[1], 0.05, base + height), color, "concrete")


def capitals(
    rng: np.random.Generator, span: Span, levels: Span, y: float, color: Color
) -> Iterable[Part]:
    """Build strokes that look like a line of capitals from a distance."""
    low, high = levels
    height = high - low
    width, stroke, x = 0.62 * height, 0.15 * height, span[0]
    while x + width <= span[1]:
        if rng.random() < 0.86:  # else a gap between words
            has_left, has_right = (int(v) for v in rng.random(2) < (0.85, 0.45))
            a, b = x + stroke * has_left, x + width - stroke * has_right
            strokes = [(x, x + stroke, low, high)] * has_left
            strokes += [(b, x + width, low, high)] * has_right
            for z in (low, (low + high - stroke) / 2, high - stroke):
                strokes += [(a, b, z, z + stroke)] * int(rng.random() < 0.6)
            yield from (Patch(upright(*s, y), color, "paint") for s in strokes)
        x += 1.3 * width


def contrast(color: Color) -> Color:
    """Return cream for a dark colour, black for a bright one."""
    is_dark = sum(color) / 3 < 0.25
    return (0.75, 0.70, 0.52) if is_dark else (0.03, 0.03, 0.035)


def shop_front(
    rng: np.random.Generator,
    width: float,
    ground: float,
    colors: tuple[Color, Color],
    awning: float,
) -> Iterable[Part]:
    """Build a fascia with lettering, pilasters at both ends, goods in the windows, and optionally an awning.

    Args:
        rng: generator of letters and goods, advanced.
        width: of the facade (metres).
        ground: height of the ground floor (metres).
        colors: of the fascia, and of every other stripe of the awning.
        awning: its depth (metres); 0 for none.
    """
    board, stripe = colors
    low, high, half = 0.77 * ground, 0.97 * ground, 0.48 * width
    yield relief((-half, -BOARD, low), (half, 0.05, high), board, "paint")
    span = (-0.3 * width, float(rng.uniform(0.1, 0.32)) * width)
    yield from capitals(rng, span, (low + 0.15, high - 0.15), -BOARD - PROUD, contrast(board))
    for s in (-1, 1):
        x = s * (width / 2 - 0.16)
        yield relief((x - 0.14, -PILASTER, 0), (x + 0.14, 0.05, high), board, "paint")
    for left, right in bays(width, 3, 0.7)[::2]:
        for x in np.arange(left, right - 0.5, 0.62).tolist():
            if rng.random() < 0.6:
                height, foot = rng.uniform(0.3, 0.8), rng.uniform(0.65, 1.1)
                red, green, blue = rng.uniform(0.08, 0.7, 3).tolist()
                corners = upright(x, x + 0.42, foot, foot + height, 0.05)
                yield Patch(corners, (red, green, blue), "paint")
    if awning:
        edges = np.linspace(-0.46 * width, 0.46 * width, 13)
        edge, front = 0.64 * ground, -BOARD - 0.1
        for k, (a, b) in enumerate(pairwise(edges)):
            tone = (stripe, board)[k % 2]
            slope = [(a, -awning, edge), (b, -awning, edge), (b, front, low), (a, front, low)]
            yield Patch(slope, tone, "cloth")
            yield Patch(upright(a, b, edge - 0.2, edge, -awning), tone, "cloth")


def hanging_sign(x: float, base: float, color: Color) -> Iterable[Part]:
    """Build a board across the pavement on a bracket, painted on both sides."""
    depth = BAY_DEPTH + 0.3
    end, low, high = -depth + 0.1, base + 0.2, base + 0.65
    yield block((x - 0.04, -depth, base), (x + 0.04, -0.25, base + 0.85), color, "paint")
    for side in (x - 0.07, x + 0.07):
        corners = [(side, end, low), (side, -0.35, low), (side, -0.35, high), (side, end, high)]
        yield Patch(corners, contrast(color), "paint")
    yield block((x - 0.03, -depth, base + 0.85), (x + 0.03, 0.05, base + 0.93), BLACK)


def bay_window(
    span: Span, levels: tuple[float, float, float], wall: Finish, frame: Color, roof: Color
) -> Iterable[Part]:
    """Build a canted bay window in front of the wall.

    Args:
        span: left and right edge at the wall (metres).
        levels: heights of sill, head and top (metres).
        wall: colour and material of the apron.
        frame: colour around the panes.
        roof: colour of its lid.
    """
    (left, right), (sill, head, top) = span, levels
    cant = min(0.45, 0.25 * (right - left))
    plan = [(left, 0.0), (left + cant, -BAY_DEPTH), (right - cant, -BAY_DEPTH), (right, 0.0)]
    for (x0, y0), (x1, y1) in pairwise(plan):
        length = math.hypot(x1 - x0, y1 - y0)
        out = np.array([y1 - y0, x0 - x1]) / length * PROUD

        def facet(a: float, b: float, low: float, high: float, lift: float) -> list[Point]:
            foot = [
                (x0 + s * (x1 - x0) + lift * out[0], y0 + s * (y1 - y0) + lift * out[1])  # noqa: B023
                for s in (a, b)
            ]
            return [(*foot[0], low), (*foot[1], low), (*foot[1], high), (*foot[0], high)]

        yield Patch(facet(0, 1, 0, sill, 0), *wall)
        yield Patch(facet(0, 1, sill, top, 0), frame, "paint")
        panes = max(1, round(length / 0.7))
        for k in range(panes):
            a, b = (k + 0.09) / panes, (k + 0.91) / panes
            yield Patch(facet(a, b, sill + 0.1, head, 1), WINDOW, "glass")
    lid = [(x, y * 1.15, top) for x, y in plan]
    ridge = [(left + cant, -0.02, top + 0.45), (right - cant, -0.02, top + 0.45)]
    yield Patch([lid[1], lid[2], ridge[1], ridge[0]], roof, "roof")
    yield polygon([lid[0], lid[1], ridge[0]], roof, "roof")
    yield polygon([lid[2], lid[3], ridge[1]], roof, "roof")


def balcony(span: Span, floor: float, frame: Color, accent: Color) -> Iterable[Part]:
    """Build a slab with a see-through railing."""
    (left, right), out = span, -BAY_DEPTH
    foot, head = floor + 0.07, floor + 0.98
    yield relief((left, out, floor - 0.07), (right, 0.05, foot), frame, "concrete")
    yield relief((left, out, head), (right, out + 0.05, floor + 1.04), accent, "metal")
    for x in np.arange(left + 0.02, right - 0.05, 0.16).tolist():
        yield Patch(upright(x, x + 0.035, foot, head, out + 0.025), accent, "metal")
    low, high = floor + 0.1, floor + 1
    for x in span:
        yield Patch([(x, 0, low), (x, out, low), (x, out, high), (x, 0, high)], accent, "metal")


def drainpipe(x: float, top: float, color: Color = (0.025, 0.025, 0.028)) -> Iterable[Part]:
    """Build a pipe with a hopper from the gutter to the ground."""
    yield relief((x - 0.13, -PIPE - PROUD, top - 0.35), (x + 0.13, 0.05, top - 0.1), color)
    yield relief((x - 0.05, -PIPE, 0), (x + 0.05, -0.05, top - 0.35), color)


def dish(x: float, z: float) -> Iterable[Part]:
    """Build a satellite dish on its arm."""
    yield disc((x, -0.42, z), 0.3, (0.5, 0.5, 0.5), "metal", axis=(0.4, -1, 0.5), sides=10)
    yield tube((x, 0, z - 0.1), (x, -0.4, z), 0.025, (0.2, 0.2, 0.2), "metal", sides=4)


def quoins(width: float, levels: Span, color: Color) -> Iterable[Part]:
    """Build alternating long and short stones at both edges."""
    low, high = levels
    for side in (-1, 1):
        for k, z in enumerate(np.arange(low, high - 0.3, 0.36).tolist()):
            ends = side * width / 2, side * (width / 2 - (0.5 if k % 2 else 0.3))
            stone = upright(min(ends), max(ends), z + 0.02, z + 0.34, -PROUD)
            yield Patch(stone, color, "plaster")


def timbers(width: float, levels: list[float], columns: list[Span], color: Color) -> Iterable[Part]:
    """Build dark beams at every floor and, behind them, posts at both sides of every window."""
    half = width / 2
    yield from (band((-half, half), STRING, z - 0.1, 0.2, color) for z in levels)
    for left, right in columns:
        for x in (left - 0.14, right + 0.14):
            yield Patch(upright(x - 0.09, x + 0.09, levels[0], levels[-1], -PROUD), color, "wood")


def turret(
    x: float, radius: float, eaves: float, floors: list[float], wall: Finish, roof: Color
) -> Iterable[Part]:
    """Build a round corner tower with a window at every floor and a pointed roof."""
    y = 0.35 * radius
    shaft = partial(tube, sides=12, caps=False)
    foot, top, tip = ((x, y, z) for z in (0, eaves + 1.2, eaves + 1.2 + 2.6 * radius))
    yield shaft(foot, top, radius, *wall)
    yield shaft(top, tip, 1.15 * radius, roof, "roof", end_radius=0.03)
    for floor in floors:
        for turn in (-2.4, -np.pi / 2, -0.75):
            outward = np.array([math.cos(turn), math.sin(turn)])
            side = np.array([-outward[1], outward[0]]) * 0.3
            middle = np.array([x, y]) + (radius + PROUD) * outward
            (a, b), (c, d) = middle - side, middle + side
            low, high = floor + 0.8, floor + 2.2
            yield Patch([(a, b, low), (c, d, low), (c, d, high), (a, b, high)], WINDOW, "glass")
