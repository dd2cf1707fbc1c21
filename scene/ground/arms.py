"""The surfaces of a junction in road coordinates: carriageways, kerbs, sidewalks, land, and paint."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from scene.ground import markings
from scene.ground.extent import KERB_WIDTH, STRIP, TUCK, wavy
from scene.ground.ground import Ground
from scene.ground.junction import ARM_END, ARM_STRIP, REACH, Junction
from scene.mesh.quads import Quads, grid, quads, rectangles

ARC = 12
"""Pieces of a rounded corner; even."""
CLEAR, CLEAR_STREET = 9.0, 28.0
"""Metres beyond the corners without crossings, driveways or words of the road, and without side streets,
which would run into the houses of the arms."""
LIP = 0.05
"""Height of the outer edges of sidewalks, metres."""
LAP = 0.01
"""Metres by which surfaces overlap where their corners do not meet, so that no gaps show."""
Array = np.ndarray


def with_junction(ground: Ground, junction: Junction) -> Ground:
    """Add a junction to the ground, and remove details near it."""

    def clear(place: float, spare: float = CLEAR) -> bool:
        return abs(place - junction.x) > junction.corner + spare

    return ground._replace(
        junction=junction,
        crosswalks=tuple(c for c in ground.crosswalks if clear(c)),
        side_streets=tuple(s for s in ground.side_streets if clear(s[0], CLEAR_STREET)),
        driveways=tuple(d for d in ground.driveways if clear(d[0])),
        legends=tuple(mark for mark in ground.legends if clear(mark.x)),
        boxes=tuple(b for b in ground.boxes if clear(b[0]) and clear(b[1])),
    )


def outside_junction(part: Quads, junction: Junction) -> Quads:
    """The faces along the road that are not in the junction."""
    x, y = part.corners[..., :2].mean(axis=1).T
    armed = [(y > 0 if side > 0 else y < 0) for side in junction.arms]
    free = (np.abs(x - junction.x) > junction.corner) | ~np.logical_or.reduce(armed)
    return Quads(part.corners[free], part.color[free], part.material[free])


def turned(part: Quads, junction: Junction, side: float) -> Quads:
    """Move faces from the frame of an arm (metres along and left of its middle) to the road's."""
    corners = part.corners.copy()
    corners[..., 0] = junction.x + part.corners[..., 1]
    corners[..., 1] = side * part.corners[..., 0]
    return part._replace(corners=corners)


def arm_road(ground: Ground, junction: Junction, rng: np.random.Generator) -> list[Quads]:
    """Carriageways of the arms and their rounded corners."""
    half, begin = junction.half_width, junction.road_half_width
    begin += TUCK if ground.path.bends else 0.0
    base = np.asarray(ground.road.color)
    along = np.append(np.arange(junction.mouth - LAP, REACH - 2, 4.0), REACH)
    across = np.array([-1, -0.91, -0.5, 0, 0.5, 0.91, 1]) * half
    dirt = np.array([0.72, 0.97, 1.0, 1.0, 0.97, 0.72])
    parts = []
    for side in junction.arms:
        cells = 1 + 0.045 * wavy(rng, along[:-1], 14.0)[:, None] + np.zeros((len(along) - 1, 6))
        color = (cells * dirt).reshape(-1, 1) * base
        level = np.zeros((len(along), 7))
        pieces = [quads(grid(along, across, level), color, ground.road.material)]
        mouth = rectangles(*np.array([begin, junction.mouth, -half - LAP, half + LAP]))
        pieces.append(_level(mouth, 0.0, base, ground.road.material))
        for hand in (-1.0, 1.0):
            outline = _fan(np.array([half, junction.road_half_width]), _arc(junction, 0.0))
            pieces.append(_level(_handed(outline, hand), 0.0, 0.86 * base, ground.road.material))
        parts += [turned(part, junction, side) for part in pieces]
    return parts


def _level(outline: Array, z: float, color: Array, material: str) -> Quads:
    corners = np.concatenate([outline, np.full((*outline.shape[:2], 1), z)], axis=2)
    return quads(corners, color, material)


def _handed(outline: Array, hand: float) -> Array:
    """Convert outlines [..., 2] of (from the arm's middle, from the centre line) to the arm's frame."""
    return np.stack([outline[..., 1], hand * outline[..., 0]], axis=-1)


def _arc(junction: Junction, inset: float) -> Array:
    """The kerb around a corner f64[ARC + 1, 2], from the road to the arm, ``inset`` metres behind its edge.

    Coordinates are metres from the arm's middle and from the road's centre line.
    """
    angle = np.linspace(0, np.pi / 2, ARC + 1)
    centre = np.array([junction.half_width, junction.road_half_width]) + junction.radius
    return centre - (junction.radius - inset) * np.stack([np.sin(angle), np.cos(angle)], axis=1)


def _fan(tip: Array, rim: Array) -> Array:
    """Outlines [n, 4, 2] that fill the area between a point and a line of an odd number of points."""
    first, middle, last = rim[:-2:2], rim[1:-1:2], rim[2::2]
    return np.stack([np.broadcast_to(tip, first.shape), first, middle, last], axis=1)


def corners(ground: Ground, junction: Junction) -> list[Quads]:
    """Kerb and paving around the corners, one on each side of every arm."""
    lines = [_kerb_line(junction, inset) for inset in (0.0, 0.02, KERB_WIDTH)]
    rim = lines[2]
    tip = np.array([junction.corner, junction.mouth]) + LAP
    straight = [np.linspace(rim[k], rim[k + 1], 3) for k in (0, -2)]
    paved = _whole(np.concatenate([_fan(tip, line) for line in (rim[1:-1], *straight)]))
    has_length = np.linalg.norm(np.diff(lines[0], axis=0), axis=1) > 1e-6
    stone = np.array([0.76, 0.95]).repeat(has_length.sum())[:, None] * np.asarray(ground.kerb)
    base = np.asarray(ground.sidewalk.color)
    rear = np.array([(tip[0], rim[0, 1]), tip, (rim[-1, 0], tip[1])])
    high = ground.kerb_height
    heights = (0.0, high + 0.005, high)  # of the kerb's face and of its top
    parts = []
    for side in junction.arms:
        for hand in (-1.0, 1.0):
            edges = [
                np.column_stack([_handed(line, hand), np.full(len(line), z)])
                for line, z in zip(lines, heights, strict=True)
            ]
            faces = [
                np.stack([a[:-1], a[1:], b[1:], b[:-1]], axis=1)[has_length]
                for a, b in pairwise(edges)
            ]
            pieces = [
                quads(np.concatenate(faces), stone, "concrete"),
                _level(_handed(paved, hand), high, base, ground.sidewalk.material),
                _lip(_handed(rear, hand), high, base, ground.sidewalk.material),
            ]
            parts += [turned(part, junction, side) for part in pieces]
    return parts


def _lip(line: Array, height: float, color: Array, material: str) -> Quads:
    """The edge below a line [n, 2] at ``height`` metres."""
    top, low = (np.column_stack([line, np.full(len(line), height - d)]) for d in (0, LIP))
    return quads(np.stack([top[:-1], top[1:], low[1:], low[:-1]], axis=1), color, material)


def _kerb_line(junction: Junction, inset: float) -> Array:
    """A line f64[ARC + 3, 2] along the road, around the corner and along the arm.

    A corner as wide as its radius has no straight piece.
    """
    arc = _arc(junction, inset)
    first, last = (junction.corner + LAP, arc[0, 1]), (arc[-1, 0], junction.mouth + LAP)
    return np.array([first, *arc, last])


def _whole(outline: Array) -> Array:
    """The outlines with an area above zero."""
    x, y = outline[..., 0], outline[..., 1]
    area = np.abs((x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(axis=1))
    return outline[area > 1e-4]


def arm_land(ground: Ground, junction: Junction, rng: np.random.Generator) -> list[Quads]:
    """Land along the arms and behind their ends."""
    base = np.asarray(ground.terrain.color)
    low = ground.kerb_height - 0.01
    parts = []
    for side in junction.arms:
        pieces = []
        if junction.corner > junction.outer + 0.01:
            for hand in (-1.0, 1.0):
                across = hand * np.array([junction.outer - TUCK, junction.corner])
                along = np.linspace(junction.mouth - TUCK, STRIP, 3)
                pieces.append((along, across, np.full((3, 2), low)))
        along = np.append(np.arange(STRIP, ARM_END - 5, 8.0), [ARM_END, ARM_END + 0.5])
        for hand in (-1.0, 1.0):
            across = hand * np.array(
                [junction.outer - TUCK, 16.0, 23.0, ARM_STRIP, ARM_STRIP + 0.5]
            )
            z = np.full((len(along), 5), low)
            z[:, -1] = z[-1] = low - 3.0
            pieces.append((along, across, z))
        behind = np.array([REACH, ARM_END, ARM_END + 0.5])
        across = np.array([-junction.outer, junction.outer])
        pieces.append((behind, across, np.array([[low] * 2, [low] * 2, [low - 3.0] * 2])))
        for along, across, z in pieces:
            cells = grid(along, across, z)
            color = rng.uniform(0.9, 1.1, (len(cells), 1)) * base
            part = quads(cells, color, ground.terrain.material)
            parts.append(turned(part, junction, side))
    return parts


def kept_free(junction: Junction, side: float | None = None) -> tuple[tuple[float, float], ...]:
    """Stretches of the road without painted lines: in its middle, or along the kerb of one side."""
    if side is None:
        reach = junction.half_width + 1.5
    elif side in junction.arms:
        reach = junction.corner + 1.0
    else:
        reach = 0.0
    if junction.crossings[1] != "none" or (junction.control == "lights" and side is None):
        reach = junction.road_stop + 0.5
    return ((junction.x - reach, junction.x + reach),) if reach else ()


def paint(ground: Ground, junction: Junction) -> tuple[list[Array], list[Array]]:
    """Outlines [n, 4, 2] in white and in yellow, road coordinates."""
    half, white = junction.half_width, []
    for side in junction.arms:
        near_side = ground.drive * side  # side on which the arm's traffic approaches
        marks = []
        low, high = sorted((0.15 * near_side, (half - 0.35) * near_side))
        if junction.control == "give way":
            marks.append(markings.give_way(junction.stop, low, high, -1.0))
        else:
            marks.append(rectangles(*np.array([junction.stop, junction.stop + 0.3, low, high])))
        if junction.crossings[0] != "none":
            marks.append(_across(junction.crossings[0], junction.arm_crossing, half))
        if junction.lane_line:
            dash, gap = ground.dash
            start = np.arange(junction.stop + 0.5, REACH - dash, dash + gap)
            marks.append(rectangles(start, start + dash, np.array(-0.06), np.array(0.06)))
        if ground.edge_lines:
            start = np.arange(junction.stop, REACH - 5, 5.0)
            marks += [rectangles(start, start + 5.0, np.array(y - 0.05), np.array(y + 0.05))
                      for y in (half - 0.3, 0.3 - half)]  # fmt: skip
        for outline in marks:
            at = np.stack([junction.x + outline[..., 1], side * outline[..., 0]], axis=-1)
            white.append(at)
    for heading in (-1.0, 1.0):  # of approaching traffic
        if junction.crossings[1] != "none":
            middle = junction.x - heading * junction.road_crossing
            white.append(_across(junction.crossings[1], middle, ground.half_width))
        if junction.control == "lights":
            stop = junction.x - heading * junction.road_stop
            lane = sorted(ground.drive * heading * np.array([0.2, ground.half_width - 0.5]))
            white.append(rectangles(*np.array([stop - 0.15, stop + 0.15, *lane])))
    yellow = []
    if junction.box:
        ends = junction.x - half, junction.x + half
        yellow.append(markings.box_junction(*ends, ground.half_width))
    return white, yellow


def _across(kind: str, at: float, half: float) -> Array:
    return (markings.zebra if kind == "zebra" else markings.studs)(at, half)
