"""Fittings on a car's shell: lamps, grille, plates, seams, handles, mirrors, roof rails, spoilers."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scene.assets.parts.bodywork import FLANK, Body, cabin, doorway, fascia, flank, roof, shoulder
from scene.assets.parts.palette import (
    AMBER,
    BLACK,
    CHROME,
    LENS,
    PLATE,
    PLATE_YELLOW,
    REFLECTOR,
    TAILLAMP_LENS,
    TRIM,
)
from scene.assets.parts.skin import Span, cuboid, pair, sheet, twin_sheets
from scene.mesh.asset import Asset, Color, Parts, Point, merge
from scene.mesh.solids import ellipsoid, tube


class Fittings(NamedTuple):
    """The fittings of one car; rows are shares of the way up from the sill to the shoulder."""

    lamp: tuple[float, float, float]  # headlamps: inner edge (share of half the nose), rows
    wrap: float  # share of the length that headlamps reach back along the flank
    grille: tuple[float, float, float]  # outer edge (share of half the nose), rows
    slats: int
    rear_lamp: tuple[float, float, float]  # inner edge (share of half the tail), rows
    plate: bool  # a yellow plate at the rear, as in Britain; else white
    bumper: Color | None  # of plastic; None for the colour of the body
    strip: Color | None  # rubbing strip along the doors
    handles: Color
    mirrors: Color
    rails: Color | None = None
    spoiler: Color | None = None
    box: Color | None = None  # on the roof
    sign: Color | None = None  # a taxi's
    spare: bool = False  # wheel on the tail
    aerial: bool = True
    doors: tuple[float, ...] = ()  # seams, as shares of the length
    fog: bool = True


_COLUMNS = np.array([-0.89, -0.733, -0.392, 0.0, 0.392, 0.733, 0.89])
"""Corners of nose and tail across: patches with the same corners lie above them everywhere."""


def _with_knots(span: Span, knots: np.ndarray) -> np.ndarray:
    """Return the ends of a span and the knots inside it."""
    low, high = span
    return np.array([low, *(k for k in knots.tolist() if low + 0.01 < k < high - 0.01), high])


def on_nose(
    b: Body,
    end: int,
    c: Span,
    v: Span,
    color: Color,
    material: str = "plain",
    *,
    lift: float = 0.01,
) -> Asset:
    """Lay a patch on nose (0) or tail (1), spanning ``c`` across and the rows ``v``."""
    return sheet(_nose_points(b, end, c, v, lift), color, material)


def _nose_points(b: Body, end: int, c: Span, v: Span, lift: float) -> np.ndarray:
    points = fascia(b, end, _with_knots(c, _COLUMNS), _with_knots(v, FLANK)[:, None])
    points[..., 0] += lift if end == 0 else -lift
    points[..., 1] *= 1 + lift / (b.width / 2)
    return points if end == 0 else points[::-1]


def on_flank(
    b: Body,
    s: Span,
    v: Span,
    color: Color,
    material: str = "plain",
    *,
    lift: float = 0.008,
    steps: int = 2,
) -> Asset:
    """Lay a patch on both flanks between shares ``s`` of the length and rows ``v``."""
    points = flank(b, np.linspace(*s, steps + 1)[:, None], _with_knots(v, FLANK), arches=False)
    points[..., 1] += lift
    return twin_sheets(points, color, material)


def on_cabin(
    b: Body, s: np.ndarray, w: np.ndarray, color: Color, material: str = "plain", *, lift: float
) -> Asset:
    """Lay a patch on both sides above the shoulder, its corners at shares ``s`` along and ``w`` up."""
    points = cabin(b, *np.broadcast_arrays(s, w))
    points[..., 1] += lift
    return twin_sheets(points, color, material)


def fittings(b: Body, f: Fittings) -> Parts:
    """Build the fittings of the shell ``b``."""
    return [*_front(b, f), *_rear(b, f), *_sides(b, f), *_on_roof(b, f)]


def _on_nose_sides(
    b: Body, end: int, c: Span, v: Span, color: Color, material: str = "lamp", lift: float = 0.012
) -> Asset:
    return twin_sheets(_nose_points(b, end, c, v, lift), color, material)


def _front(b: Body, f: Fittings) -> Parts:
    inner, down, up = f.lamp
    edge, base, crest = f.grille
    yield _on_nose_sides(b, 0, (inner, 1.0), (down, up), LENS)
    yield on_flank(b, (0.0, f.wrap), (down + 0.05, up), LENS, "lamp", lift=0.012)
    yield on_flank(
        b, (f.wrap, f.wrap + 0.012), (down + 0.08, up - 0.05), AMBER, "paint", lift=0.012
    )
    yield _on_nose_sides(
        b, 0, (inner + 0.06, inner + 0.2), (down + 0.05, up - 0.06), REFLECTOR, lift=0.016
    )
    yield on_nose(b, 0, (-edge, edge), (base, crest), BLACK, lift=0.012)
    yield on_nose(b, 0, (-0.62, 0.62), (0.07, 0.27), BLACK, lift=0.008)
    yield on_nose(b, 0, (-1, 1), (0.0, 0.05), TRIM, lift=0.012)
    yield on_nose(b, 0, (-0.9, 0.9), (0.975, 1.0), BLACK, lift=0.006)
    yield _bonnet_gap(b)
    yield on_nose(b, 0, (-0.06, 0.06), (crest - 0.1, crest - 0.01), CHROME, "metal", lift=0.022)
    yield plate(b, 0, PLATE, 0.36)
    for k in range(f.slats):
        v = base + (crest - base) * (k + 0.6) / f.slats
        yield on_nose(b, 0, (-edge, edge), (v, v + 0.02), CHROME, "metal", lift=0.018)
    if f.bumper is not None:
        yield from _bumper(b, 0, f.bumper)
    if f.fog:
        yield _on_nose_sides(b, 0, (0.62, 0.76), (0.12, 0.22), (0.35, 0.35, 0.34))


def _bonnet_gap(b: Body) -> Asset:
    """Build the dark lines between bonnet and wings."""
    s = np.array([0.02, 0.03, 0.08, 0.6 * b.cowl, b.cowl - 0.01])
    points = roof(b, s[:, None], np.array([[0.86, 0.875]]))
    return twin_sheets(points + [0, 0, 0.005], BLACK, "plain")


def _bumper(b: Body, end: int, color: Color) -> Parts:
    along = (0.0, 0.075) if end == 0 else (0.93, 1.0)
    yield on_nose(b, end, (-1, 1), (0.26, 0.52), color, lift=0.02)
    yield on_flank(b, along, (0.26, 0.52), color, lift=0.02)


def plate(b: Body, end: int, color: Color, v: float) -> Asset:
    """Build a number plate with dark characters at row ``v``."""
    middle = fascia(b, end, np.zeros(1), np.array([v]))[0]
    ahead = 1 if end == 0 else -1

    def card(half_width: float, half_height: float, paint: Color, lift: float) -> Asset:
        x, y = lift * ahead, half_width * ahead
        rows = [[(x, -y, z), (x, y, z)] for z in (-half_height, half_height)]
        return sheet(np.array(rows) + middle, paint, "plain")

    return merge(card(0.26, 0.055, color, 0.03), card(0.2, 0.022, (0.12, 0.12, 0.11), 0.034))


def _rear(b: Body, f: Fittings) -> Parts:
    inner, down, up = f.rear_lamp
    height = up - down
    reversing = (inner + 0.03, 0.5 * inner + 0.47), (down + 0.1 * height, down + 0.4 * height)
    yield _on_nose_sides(b, 1, (inner, 1.0), (down, up), TAILLAMP_LENS)
    yield on_flank(b, (0.975, 1.0), (down + 0.03, up), TAILLAMP_LENS, "lamp", lift=0.012)
    yield _on_nose_sides(b, 1, *reversing, (0.6, 0.52, 0.45), lift=0.016)
    yield on_nose(b, 1, (-1, 1), (0.0, 0.12), TRIM, lift=0.01)
    yield on_nose(b, 1, (-inner, inner), (0.515, 0.53), BLACK, lift=0.012)
    yield on_nose(b, 1, (-0.1, 0.1), (0.88, 0.92), CHROME, "metal", lift=0.016)
    yield plate(b, 1, PLATE_YELLOW if f.plate else PLATE, 0.64)
    end = fascia(b, 1, np.array([0.55]), np.array([0.0]))[0]
    pipe = (end[0] - 0.03, end[1], end[2] + 0.02), (end[0] + 0.2, end[1], end[2] + 0.02)
    yield tube(*pipe, 0.03, CHROME, "metal")
    if f.bumper is not None:
        yield from _bumper(b, 1, f.bumper)
    if f.spare:
        x, z = end[0] - 0.02, 0.62 * b.belt + 0.25
        for near, far, radius, color, material in (
            (0.05, 0.17, 0.34, BLACK, "rubber"),
            (0.0, 0.18, 0.22, f.mirrors, "paint"),
        ):
            yield tube((x + near, 0, z), (x - far, 0, z), radius, color, material, sides=16)


def _sides(b: Body, f: Fittings) -> Parts:
    for seam in f.doors:
        foot = 0.1 if doorway(b)[0] < seam < doorway(b)[1] else 0.62
        yield on_flank(b, (seam, seam + 0.0025), (foot, 1.0), BLACK, lift=0.004, steps=1)
    for seam in f.doors[1:]:
        handle = (seam - 0.042, seam - 0.008), (0.8, 0.845)
        yield on_flank(b, *handle, f.handles, "metal", lift=0.025, steps=1)
    doors = doorway(b)
    yield on_flank(b, doors, (0.0, 0.1), TRIM, lift=0.01)
    if f.strip is not None:
        yield on_flank(b, doors, (0.41, 0.48), f.strip, lift=0.014)
    s = np.array([b.cowl + 0.045])
    x, y, z = cabin(b, s, np.array([0.1]))[0]
    z = float(shoulder(b, s)[0]) + 0.08
    mirror = ellipsoid((x, y + 0.13, z), (0.055, 0.11, 0.075), f.mirrors, "paint")
    arm = tube((x, y - 0.03, z - 0.05), (x, y + 0.1, z - 0.03), 0.02, TRIM, sides=4)
    yield pair(merge(mirror, arm))


def _on_roof(b: Body, f: Fittings) -> Parts:
    """Build what is on the roof: rails, spoiler, luggage box, taxi sign, aerial."""
    span = b.roof_rear - b.roof_front
    middle = np.array([b.roof_front + 0.5 * span])
    x, _, z = roof(b, middle, np.zeros(1))[0]
    if f.rails is not None:
        s = np.linspace(b.roof_front + 0.08 * span, b.roof_rear - 0.05 * span, 5)
        line = roof(b, s, np.full(5, 0.93))
        for (x0, y0, z0), (x1, y1, z1) in pairwise(line):
            ends = (x0, y0, z0 + 0.045), (x1, y1, z1 + 0.045)
            yield pair(tube(*ends, 0.02, f.rails, "metal", sides=4))
    if f.spoiler is not None:
        c, ones = np.linspace(-0.85, 0.85, 7), np.ones(7)
        mirror = np.stack([ones, np.sign(c), ones], -1)
        edges = (b.roof_rear - 0.015, b.roof_rear + 0.012)
        points = np.stack([roof(b, s * ones, np.abs(c)) * mirror for s in edges])
        points[1] += [-0.14, 0, 0.02]
        points[0, :, 2] += 0.03
        under = points[1] - [0, 0, 0.04]
        yield sheet(np.concatenate([points, under[None]])[:, ::-1], f.spoiler, "paint")
    if f.box is not None:
        length = 0.62 * span * b.length
        shape = (x, 0.12, z + 0.15), (length / 1.6, 0.42, 0.17)
        yield ellipsoid(*shape, f.box, subdivisions=2)
        for d in (-0.3, 0.4):
            yield cuboid((x + d - 0.03, x + d + 0.03), 0.55, (z - 0.02, z + 0.05), BLACK)
    if f.sign is not None:
        middle_x, _, foot = roof(b, np.array([b.roof_front + 0.08 * span]), np.zeros(1))[0]
        for half_length, half_width, low, high, color, material in (
            (0.07, 0.3, -0.03, 0.13, f.sign, "lamp"),
            (0.075, 0.2, 0.02, 0.09, BLACK, "plain"),
        ):
            along = (middle_x - half_length, middle_x + half_length)
            yield cuboid(along, half_width, (foot + low, foot + high), color, material)
    if f.aerial:
        root = roof(b, np.array([b.roof_rear - 0.06]), np.zeros(1))[0]
        tip: Point = (root[0] - 0.1, 0.0, root[2] + 0.22)
        yield tube((root[0], 0.0, root[2] - 0.01), tip, 0.008, BLACK, sides=4, caps=False)
