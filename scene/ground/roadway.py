"""The carriageway: cells of asphalt, repairs, iron covers, and markings."""

from __future__ import annotations

from itertools import product

import numpy as np

from scene.ground import markings
from scene.ground.arms import kept_free, paint
from scene.ground.extent import (
    COVER_LIFT,
    NEAR_END,
    PAINT_LIFT,
    PATCH_LIFT,
    STRIP,
    TUCK,
    stations,
    wavy,
)
from scene.ground.ground import Ground, along
from scene.ground.litter import leaves, puddles
from scene.look.surfaces import DUST
from scene.mesh.quads import Quads, discs, flat, grid, joined, quads, rectangles

WHITE, YELLOW = (0.56, 0.56, 0.53), (0.50, 0.34, 0.05)
IRON, STEEL = (0.07, 0.065, 0.06), (0.12, 0.12, 0.124)
TINTS = {"green": (0.055, 0.10, 0.07), "red": (0.14, 0.065, 0.052)}
"""Colours of a tinted cycle lane."""
FADED = 0.75
"""Share of lost paint of the most worn lines on the oldest roads."""
CYCLE_LANE = 1.5
"""Width of a cycle lane along the kerb, metres."""
GAUGE = 1.435
"""Distance between the rails of a tram track, metres."""
SIDE_STREET = 6.0
"""Width of a side street, metres."""


def road_quads(ground: Ground, rng: np.random.Generator) -> list[Quads]:
    """All faces of the road."""
    parts = [_carriageway(ground, rng)]
    if ground.patches:
        parts.append(_patches(ground, rng))
    if ground.covers:
        parts += _covers(ground, rng)
    parts += [_side_street(ground, x, side) for x, side in ground.side_streets]
    if ground.rails:
        parts.append(_rails(ground))
    return parts + _paint(ground, rng) + puddles(ground, rng) + leaves(ground, rng, road=True)


def _carriageway(ground: Ground, rng: np.random.Generator) -> Quads:
    """Cells of slightly different brightness; dirt along the kerb, lanes of different age."""
    x = along(ground, 4.0)
    y = np.array([-5.0, -4.55, -2.5, 0.0, 2.5, 4.55, 5.0]) * ground.half_width / 5
    if ground.shaped:
        y[0], y[-1] = y[0] - TUCK, y[-1] + TUCK
    across = np.array([0.72, 0.97, 1.0, 1.0, 0.97, 0.72])
    across[:3] *= 1 + ground.lane_shade
    cells = (
        1 + 0.045 * wavy(rng, x[:-1], 14.0)[:, None] + rng.uniform(-0.012, 0.012, (len(x) - 1, 6))
    )
    cells = cells * across
    if ground.junction:  # no dirt without a kerb
        mouth = np.abs((x[1:] + x[:-1]) / 2 - ground.junction.x) < ground.junction.corner
        for side in ground.junction.arms:
            cells[mouth, 5 if side > 0 else 0] /= 0.72
    color = cells[..., None] * np.asarray(ground.road.color)
    ragged = ground.dust * (0.75 + 0.25 * wavy(rng, x[:-1], 11.0))[:, None]
    for column in (0, 5):
        color[:, column] += ragged * (np.array(DUST) - color[:, column])
    return quads(grid(x, y, np.zeros((len(x), len(y)))), color.reshape(-1, 3), ground.road.material)


def _patches(ground: Ground, rng: np.random.Generator) -> Quads:
    """Trenches and potholes that were filled with another mix."""
    n = ground.patches
    length = np.exp(rng.uniform(np.log(0.8), np.log(14), n))
    width = rng.uniform(0.4, 1.6, n)
    cross = rng.random(n) < 0.3  # a trench from kerb to kerb
    length, width = np.where(cross, width, length), np.where(cross, 2 * ground.half_width, width)
    x = rng.uniform(-2, 90, n)
    free = 2 * ground.half_width - width
    y = -ground.half_width + free * rng.random(n)
    body = rectangles(x, x + length, y, y + width)
    shade = rng.choice([0.55, 0.7, 0.8, 1.2], n)
    color = shade[:, None] * np.asarray(ground.road.color)
    return flat(body, PATCH_LIFT, color, "fresh asphalt")


def _covers(ground: Ground, rng: np.random.Generator) -> list[Quads]:
    """Manholes in the lanes and gratings at the kerb."""
    n = ground.covers
    centre = np.stack(
        [rng.uniform(3, 80, n), (ground.half_width - 1.2) * rng.uniform(-1, 1, n)], axis=1
    )
    dark = 0.6 * np.asarray(ground.road.color)
    x = np.arange(rng.uniform(0, 18), 90, 18.0)
    side = np.where(np.arange(len(x)) % 2 == 0, 1.0, -1.0) * (ground.half_width - 0.3)
    gratings = rectangles(x, x + 0.5, side - 0.2, side + 0.2)
    if ground.junction:
        gratings = markings.clear_of(gratings, kept_free(ground.junction))
    return [
        flat(discs(centre, 0.42), PATCH_LIFT + 0.001, dark, "fresh asphalt"),
        flat(discs(centre, 0.32), COVER_LIFT, np.array(IRON), "iron"),
        flat(gratings, COVER_LIFT, np.array(IRON), "iron"),
    ]


def _rails(ground: Ground) -> Quads:
    """Two tram tracks; each rail is a line of steel next to a dark groove."""
    x, parts = stations(8.0), []
    for track, rail in product((-1, 1), (-1, 1)):
        y = track * ground.rails + rail * GAUGE / 2
        for left, wide, color in ((0.0, 0.055, STEEL), (0.05 * rail, 0.045, IRON)):
            low, high = y - left - wide / 2, y - left + wide / 2
            outlines = rectangles(x[:-1], x[1:], np.array(low), np.array(high))
            parts.append(flat(outlines, PATCH_LIFT, np.array(color), "metal"))
    return joined(parts)


def _side_street(ground: Ground, x: float, side: float) -> Quads:
    """A side street across the sidewalk: the kerb drops and the road rises to meet it."""
    lift, end = 0.004, STRIP if ground.shaped else 45.0
    y = side * np.array(
        [ground.half_width, ground.half_width + 0.5, ground.outer, ground.outer + 4, end]
    )
    z = np.array([0.0, *[ground.kerb_height] * 4]) + lift
    # Its corners are rounded.
    half = SIDE_STREET / 2 + np.array([2.5, 1.3, 0.4, 0.0, 0.0])
    left, right = (np.stack([x + s * half, y, z], axis=1) for s in (-1, 1))
    corners = np.stack([left[:-1], right[:-1], right[1:], left[1:]], axis=1)
    return quads(corners, 0.94 * np.asarray(ground.road.color), ground.road.material)


def _paint(ground: Ground, rng: np.random.Generator) -> list[Quads]:
    """Markings in white, yellow and the tint of a cycle lane."""
    half = ground.half_width
    crossings = tuple((x - 4.0, x + 4.0) for x in ground.crosswalks)
    free = crossings + ground.boxes
    junction = ground.junction
    mouths = {s: tuple((x - 4.5, x + 4.5) for x, side in ground.side_streets if side == s)
              for s in (-1.0, 1.0)}  # fmt: skip
    middle = free + kept_free(junction) if junction else free
    white = [markings.clear_of(o, middle) for o in _centre(ground)]
    yellow: list[np.ndarray] = []
    for side in (-1.0, 1.0):
        closed = free + mouths[side]
        if junction:
            closed += kept_free(junction, side)
        for k in range(ground.edge_lines):
            edge = markings.line(side * (half - 0.3 - 0.22 * k), 0.1)
            (yellow if ground.edge_yellow else white).append(markings.clear_of(edge, closed))
        style = ground.parking[int(side > 0)]
        if style != "none":
            white.append(markings.clear_of(markings.parking(half, side, style), closed))
        if ground.cycle_lane != "none":
            lane = markings.dashes(side * (half - CYCLE_LANE), 4.0, 2.0)
            white.append(markings.clear_of(lane, closed))
    for x in ground.crosswalks:
        white += _crossing(ground, x)
    white += [markings.legend(mark) for mark in ground.legends]
    yellow += [markings.box_junction(a, b, half) for a, b in ground.boxes]
    for x, side in ground.side_streets:
        white.append(_mouth(ground, x, side))
    if junction:
        for outlines, more in zip((white, yellow), paint(ground, junction), strict=True):
            outlines += more
    parts = [
        flat(outline, PAINT_LIFT, _worn(ground, rng, outline, color), "marking")
        for outlines, color in ((white, WHITE), (yellow, YELLOW))
        for outline in [np.concatenate(outlines) if outlines else np.zeros((0, 4, 2))]
    ]
    if ground.cycle_lane in TINTS:
        parts.append(_tinted(ground))
    return [p for p in parts if len(p.corners)]


def _worn(
    ground: Ground, rng: np.random.Generator, outlines: np.ndarray, color: tuple
) -> np.ndarray:
    """Colours f64[n, 3] of paint that shows the road below, more so if it is older."""
    left = rng.uniform(1 - FADED * ground.wear, 1.0, (len(outlines), 1))
    return left * np.asarray(color) + (1 - left) * np.asarray(ground.road.color)


def _centre(ground: Ground) -> list[np.ndarray]:
    """The line between the two directions."""
    dash, gap = ground.dash
    if ground.centre == "double":
        return [markings.line(-0.12, 0.1), markings.line(0.12, 0.1)]
    if ground.centre == "one side":
        return [markings.line(-0.13, 0.1), markings.dashes(0.13, dash, gap, 0.1)]
    if ground.centre == "hatched":
        return [markings.hatching(markings.LINES_START, NEAR_END)]
    return [markings.dashes(0.0, dash, gap)] if ground.centre == "dashed" else []


def _crossing(ground: Ground, x: float) -> list[np.ndarray]:
    """A crossing, and on each side a stop line or teeth across the approaching lane."""
    half = ground.half_width
    across = markings.zebra if ground.crossing == "zebra" else markings.studs
    parts = [across(x, half)]
    for heading in (-1.0, 1.0):
        y0, y1 = sorted((0.2 * ground.drive * heading, (half - 0.5) * ground.drive * heading))
        at = x - 3.0 * heading
        if ground.give_way:
            parts.append(markings.give_way(at, y0, y1, -heading))
        else:
            parts.append(rectangles(np.array(at - 0.15), np.array(at + 0.15),
                                    np.array(y0), np.array(y1)))  # fmt: skip
    return parts


def _mouth(ground: Ground, x: float, side: float) -> np.ndarray:
    """The broken line across the mouth of a side street."""
    start = np.arange(x - SIDE_STREET / 2, x + SIDE_STREET / 2, 0.9)
    y = side * (ground.half_width - 0.15)
    return rectangles(start, start + 0.5, np.array(y - 0.08), np.array(y + 0.08))


def _tinted(ground: Ground) -> Quads:
    x = stations(13.0)[1:-4]
    inner, outer = ground.half_width - CYCLE_LANE + 0.06, ground.half_width - 0.02
    lanes = [
        rectangles(x[:-1], x[1:], np.array(min(s * inner, s * outer)),
                   np.array(max(s * inner, s * outer)))
        for s in (-1, 1)
    ]  # fmt: skip
    color = np.array(TINTS[ground.cycle_lane])
    return flat(np.concatenate(lanes), PATCH_LIFT + 0.002, color, "asphalt")
