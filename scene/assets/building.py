"""Buildings: the facade in the plane y = 0 faces the road (-y), the body extends to y > 0.

The facade is a wall with real openings; a layer of frames lies some centimetres behind it, and
panes of glass between the two. Everything else (roof, chimneys, balconies, shop front) is added.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, Point, box, merge, polygon, quad, translate, tube, vary

KINDS: tuple[str, ...] = (
    "terrace", "shop", "office", "apartments", "detached", "warehouse", "townhouse", "hall",
)  # fmt: skip

RECESS = 0.14
"""Depth of the frames behind the facade (metres)."""
PROUD = 0.04
"""How far what is laid on a wall stands off it (metres)."""

BRICKS: tuple[Color, ...] = (
    (0.25, 0.09, 0.06), (0.35, 0.27, 0.17), (0.30, 0.20, 0.11), (0.20, 0.10, 0.07),
)  # fmt: skip
RENDERS: tuple[Color, ...] = (
    (0.58, 0.57, 0.54), (0.52, 0.47, 0.36), (0.45, 0.38, 0.30), (0.50, 0.50, 0.52),
)  # fmt: skip
PAINTS: tuple[Color, ...] = (
    (0.03, 0.05, 0.16), (0.05, 0.13, 0.07), (0.28, 0.03, 0.03), (0.03, 0.03, 0.03),
    (0.45, 0.40, 0.28), (0.05, 0.20, 0.24), (0.40, 0.20, 0.03),
)  # fmt: skip
SLATES: tuple[Color, ...] = ((0.09, 0.09, 0.10), (0.18, 0.09, 0.06), (0.14, 0.12, 0.10))


class BuildingParams(NamedTuple):
    """A block of storeys with a grid of windows under one roof."""

    width: float  # along x, m
    depth: float  # along y, m
    storeys: int  # above the ground floor
    ground: float  # height of the ground floor, m
    storey: float  # height of each storey above it, m
    bays: int  # windows in a row
    window: tuple[float, float]  # width and height, as shares of bay and storey
    panes: tuple[int, int]  # across and up, in each window
    doors: tuple[int, ...]  # bays with a door, where the ground floor is "door"
    hood: float  # how far a roof over each door or an awning over a shop stands out, m; 0 for none
    ground_floor: str  # "door", "shop", "gate" or "windows"
    roof: str  # "flat", "gable" (ridge along the road), "front gable" or "hip"
    rise: float  # height of roof or parapet, m
    chimneys: int
    chimney: Color
    balconies: tuple[int, ...]  # bays with balconies
    sills: bool
    side_windows: int  # in a row of each side wall
    wall: Color
    wall_material: str
    ground_wall: Color  # of the ground floor
    ground_material: str
    frame: Color
    accent: Color  # door, signboard, gate
    roof_color: Color


def _choose(rng: np.random.Generator, colors: tuple[Color, ...], amount: float = 0.2) -> Color:
    return vary(rng, colors[rng.integers(len(colors))], amount)


def sample_building(rng: np.random.Generator, kind: str) -> BuildingParams:
    """Draw a building of one of ``KINDS``."""
    brick, render = _choose(rng, BRICKS), _choose(rng, RENDERS)
    white = vary(rng, (0.60, 0.60, 0.58), 0.1)
    concrete = vary(rng, (0.31, 0.30, 0.28), 0.25)
    stuccoed = rng.random() < 0.5
    terrace = BuildingParams(
        width=float(rng.uniform(8.5, 12.0)), depth=float(rng.uniform(8.0, 10.0)),
        storeys=int(rng.integers(1, 3)), ground=float(rng.uniform(2.8, 3.2)),
        storey=float(rng.uniform(2.7, 3.0)), bays=4, window=(0.48, 0.58), panes=(1, 2),
        doors=((0, 3), (1, 2))[rng.integers(2)], hood=0.45 if rng.random() < 0.4 else 0.0,
        ground_floor="door", roof="gable", rise=float(rng.uniform(2.0, 3.0)), chimneys=2,
        chimney=brick,
        balconies=(), sills=True, side_windows=0, wall=brick, wall_material="brick",
        ground_wall=brick, ground_material="brick", frame=white, accent=_choose(rng, PAINTS),
        roof_color=_choose(rng, SLATES),
    )  # fmt: skip
    match kind:
        case "terrace":
            return terrace
        case "shop":
            return terrace._replace(
                storeys=int(rng.integers(1, 4)), ground=float(rng.uniform(3.4, 4.0)),
                ground_floor="shop", ground_wall=terrace.accent, ground_material="paint",
                wall=render if stuccoed else brick,
                wall_material="plaster" if stuccoed else "brick",
                roof=str(rng.choice(["gable", "flat"])), rise=float(rng.uniform(1.8, 2.5)),
                hood=0.55 if rng.random() < 0.4 else 0.0,
                chimneys=int(rng.integers(0, 3)), bays=int(rng.integers(3, 5)),
            )  # fmt: skip
        case "office":
            return terrace._replace(
                width=float(rng.uniform(10, 14)), depth=12.0, storeys=int(rng.integers(3, 5)),
                ground=3.8, storey=float(rng.uniform(3.2, 3.7)), bays=int(rng.integers(5, 7)),
                window=(float(rng.uniform(0.78, 0.9)), float(rng.uniform(0.6, 0.8))), panes=(1, 1),
                ground_floor="windows", roof="flat", rise=0.7, chimneys=0, sills=False,
                side_windows=2, wall=concrete, wall_material="concrete", ground_wall=concrete,
                ground_material="concrete", frame=vary(rng, (0.08, 0.09, 0.1), 0.4),
                roof_color=concrete,
            )  # fmt: skip
        case "apartments":
            return terrace._replace(
                width=float(rng.uniform(10, 13)), depth=11.0, storeys=int(rng.integers(2, 4)),
                ground=3.0, storey=2.9, bays=4, window=(0.5, 0.6), panes=(2, 1),
                doors=(2,), hood=0.5, roof=str(rng.choice(["flat", "hip"])), rise=0.9, chimneys=0,
                balconies=((1, 2), (0, 3))[rng.integers(2)], sills=False, side_windows=1,
                wall=render, wall_material="plaster", ground_wall=render,
                ground_material="plaster",
            )  # fmt: skip
        case "detached":
            return terrace._replace(
                width=float(rng.uniform(8.0, 9.5)), storeys=1, bays=3, panes=(2, 1),
                doors=(1,), hood=0.55,
                window=(0.55, 0.5), roof=str(rng.choice(["front gable", "hip"])), chimneys=1,
                rise=float(rng.uniform(2.4, 3.4)), side_windows=2,
                wall=render, wall_material="plaster",
                roof_color=vary(rng, (0.20, 0.08, 0.05), 0.25),
            )  # fmt: skip
        case "warehouse":
            return terrace._replace(
                width=float(rng.uniform(11, 14)), depth=12.0, storeys=1, ground=4.0,
                storey=float(rng.uniform(1.8, 2.6)), bays=4, window=(0.7, 0.42), panes=(2, 1),
                ground_floor="gate", roof="front gable", rise=float(rng.uniform(1.0, 1.8)),
                chimneys=0, sills=False, frame=concrete,
                wall=vary(rng, (0.24, 0.27, 0.29), 0.3), wall_material="metal",
            )  # fmt: skip
        case "townhouse":
            return terrace._replace(
                width=float(rng.uniform(8.5, 10.5)), storeys=int(rng.integers(2, 4)), bays=4,
                storey=float(rng.uniform(3.0, 3.5)), window=(0.42, 0.66), panes=(2, 2), rise=0.8,
                roof="flat", ground_wall=render, ground_material="plaster", doors=(3,), hood=0.0,
                wall=render if stuccoed else brick,
                wall_material="plaster" if stuccoed else "brick",
            )  # fmt: skip
        case "hall":
            stone = vary(rng, (0.33, 0.28, 0.20), 0.2)
            return terrace._replace(
                width=float(rng.uniform(8.0, 10.0)), depth=12.0, storeys=1, bays=3,
                ground=float(rng.uniform(3.4, 4.0)), storey=float(rng.uniform(4.5, 6.0)),
                window=(0.4, 0.72), panes=(2, 3), doors=(1,), hood=0.0, roof="front gable",
                rise=float(rng.uniform(3.5, 5.0)), chimneys=0, side_windows=3, wall=stone,
                wall_material="concrete", ground_wall=stone, ground_material="concrete",
            )  # fmt: skip
    raise ValueError(f"unknown kind of building {kind!r}; known: {', '.join(KINDS)}")


class _Opening(NamedTuple):
    left: float
    right: float
    low: float
    high: float
    glazed: bool


def _upright(left: float, right: float, low: float, high: float, y: float) -> list[Point]:
    return [(left, y, low), (right, y, low), (right, y, high), (left, y, high)]


def _columns(params: BuildingParams, bays: int, share: float) -> Iterator[tuple[float, float]]:
    """Left and right edge of each bay's opening."""
    pitch = params.width / bays
    for bay in range(bays):
        middle = (bay + 0.5) * pitch - params.width / 2
        yield middle - share * pitch / 2, middle + share * pitch / 2


def _upper_openings(params: BuildingParams) -> list[list[_Opening]]:
    """Openings of the storeys above the ground floor, by column."""
    p = params
    sill = p.storey * (1 - p.window[1]) * 0.55
    columns = []
    for bay, (left, right) in enumerate(_columns(p, p.bays, p.window[0])):
        column = []
        for storey in range(p.storeys):
            floor = p.ground + storey * p.storey
            low = floor + (0.1 if bay in p.balconies else sill)
            column.append(_Opening(left, right, low, floor + sill + p.window[1] * p.storey, True))
        columns.append(column)
    return columns


def _ground_openings(params: BuildingParams) -> list[list[_Opening]]:
    """Openings of the ground floor, by column."""
    p = params
    top = 0.82 * p.ground
    match p.ground_floor:
        case "shop":
            spans = list(_columns(p, 3, 0.86))
            return [
                [_Opening(*span, 0.08 if i == 1 else 0.55, 0.74 * p.ground, True)]
                for i, span in enumerate(spans)
            ]
        case "gate":
            spans = list(_columns(p, 3, 0.72))
            return [
                [_Opening(*spans[0], 0.05, 0.85 * p.ground, False)],
                [_Opening(*spans[1], 0.05, 0.85 * p.ground, False)],
                [_Opening(*spans[2], 1.6, 0.7 * p.ground, True)],
            ]
        case "windows":
            return [[_Opening(*s, 0.3, top, True)] for s in _columns(p, p.bays, p.window[0])]
    return [
        [_Opening(left, right, 0.12 if bay in p.doors else 0.9, top, bay not in p.doors)]
        for bay, (left, right) in enumerate(_columns(p, p.bays, p.window[0]))
    ]


def _pierced_wall(
    width: float, low: float, high: float, columns: list[list[_Opening]], color: Color,
    material: str,
) -> list[Asset]:  # fmt: skip
    """The wall around the openings: full-height piers, and what is above and below each opening."""
    edges = [-width / 2, *(e for c in columns for e in (c[0].left, c[0].right)), width / 2]
    parts = [
        quad(_upright(left, right, low, high, 0), color, material)
        for left, right in zip(edges[::2], edges[1::2], strict=True)
    ]
    for column in columns:
        levels = [low, *(z for o in column for z in (o.low, o.high)), high]
        parts += [
            quad(_upright(column[0].left, column[0].right, a, b, 0), color, material)
            for a, b in zip(levels[::2], levels[1::2], strict=True)
        ]
    return parts


def _fill(opening: _Opening, params: BuildingParams, panes: tuple[int, int]) -> list[Asset]:
    """What one sees in an opening: panes of glass before the frames, or a door."""
    p, o = params, opening
    if not o.glazed:
        return [quad(_upright(o.left, o.right, o.low, o.high, RECESS - 0.05), p.accent, "paint")]
    bar = 0.07
    xs, zs = np.linspace(o.left, o.right, panes[0] + 1), np.linspace(o.low, o.high, panes[1] + 1)
    glass = (0.03, 0.035, 0.04)
    return [
        quad(_upright(x0 + bar / 2, x1 - bar / 2, z0 + bar / 2, z1 - bar / 2, RECESS - 0.05), glass,
             "glass")
        for x0, x1 in pairwise(xs)
        for z0, z1 in pairwise(zs)
    ]  # fmt: skip


def _facade(params: BuildingParams) -> list[Asset]:
    """Both parts of the front with frames, panes, doors and sills."""
    p = params
    eaves = p.ground + p.storeys * p.storey
    upper, ground = _upper_openings(p), _ground_openings(p)
    parts = [quad(_upright(-p.width / 2, p.width / 2, 0, eaves, RECESS), p.frame, "paint")]
    parts += _pierced_wall(p.width, 0, p.ground, ground, p.ground_wall, p.ground_material)
    parts += _pierced_wall(p.width, p.ground, eaves, upper, p.wall, p.wall_material)
    for column in ground:
        parts += _fill(column[0], p, (1, 1) if p.ground_floor != "door" else p.panes)
    for column in upper:
        for opening in column:
            parts += _fill(opening, p, p.panes)
            if p.sills:
                sill = _upright(opening.left - 0.08, opening.right + 0.08, opening.low - 0.12,
                                opening.low, -PROUD)  # fmt: skip
                parts.append(quad(sill, p.frame, "plaster"))
    return parts


def _shop_front(params: BuildingParams) -> list[Asset]:
    """Signboard over the windows, with paler lettering."""
    p = params
    low, high = 0.77 * p.ground, 0.97 * p.ground
    board = box((0.96 * p.width, 0.25, high - low), (0, -0.05, low), p.accent, "paint")
    ink = tuple(0.5 if c < 0.25 else 0.04 for c in p.accent)
    words = quad(
        _upright(-0.25 * p.width, 0.2 * p.width, low + 0.2, high - 0.2, -0.05 - 0.125 - PROUD),
        (ink[0], ink[1], ink[2]), "paint",
    )  # fmt: skip
    return [board, words]


def _hoods(params: BuildingParams) -> list[Asset]:
    """A slab over each door, or one sloping awning over the shop."""
    p = params
    if not p.hood:
        return []
    if p.ground_floor == "shop":
        half, top, low = 0.46 * p.width, 0.77 * p.ground, 0.64 * p.ground
        out = [(-half, -p.hood, low), (half, -p.hood, low)]
        slope = quad([*out, (half, -0.2, top), (-half, -0.2, top)], p.frame, "cloth")
        edge = quad(_upright(-half, half, low - 0.2, low, -p.hood), p.accent, "cloth")
        return [slope, edge]
    spans = list(_columns(p, p.bays, p.window[0] + 0.15))
    return [
        box((spans[bay][1] - spans[bay][0], p.hood, 0.16),
            (sum(spans[bay]) / 2, -p.hood / 2, 0.84 * p.ground), p.frame, "concrete")
        for bay in p.doors
    ]  # fmt: skip


def _balcony(params: BuildingParams, bay: int, storey: int) -> list[Asset]:
    p = params
    left, right = list(_columns(p, p.bays, 0.9))[bay]
    floor = p.ground + storey * p.storey
    width, middle = right - left, (left + right) / 2
    slab = box((width, 0.55, 0.14), (middle, -0.275, floor - 0.06), p.frame, "concrete")
    front = quad(_upright(left, right, floor + 0.2, floor + 0.95, -0.53), p.accent, "metal")
    return [slab, front]


def _sides(params: BuildingParams) -> list[Asset]:
    """Side walls and back, with a few windows laid on the sides."""
    p = params
    eaves, half = p.ground + p.storeys * p.storey, p.width / 2
    parts = [quad(_upright(-half, half, 0, eaves, p.depth), p.wall, p.wall_material)]
    for side in (-1, 1):
        corners = [(side * half, y, z) for y, z in
                   ((0, 0), (p.depth, 0), (p.depth, eaves), (0, eaves))]  # fmt: skip
        parts.append(quad(corners, p.wall, p.wall_material))
        for storey in range(p.storeys if p.side_windows else 0):
            z = p.ground + (storey + 0.3) * p.storey
            for y in (np.arange(p.side_windows) + 0.5) / p.side_windows * p.depth:
                for off, grow, color, material in (
                    (PROUD, 0.0, p.frame, "paint"), (2 * PROUD, -0.1, (0.03, 0.035, 0.04), "glass")
                ):  # fmt: skip
                    x, w, h = side * (half + off), 0.55 + grow, 0.5 * p.storey
                    window = [(x, y - w, z - grow), (x, y + w, z - grow), (x, y + w, z + h + grow),
                              (x, y - w, z + h + grow)]  # fmt: skip
                    parts.append(quad(window, color, material))
    return parts


def _pitched_roof(params: BuildingParams, over: float = 0.35) -> list[Asset]:
    """Two slopes and two ends about a ridge: ends upright for a gable, sloping for a hip."""
    p = params
    eaves = p.ground + p.storeys * p.storey
    along_y = p.roof == "front gable"
    long, short = (p.depth, p.width) if along_y else (p.width, p.depth)
    inset = short / 2 if p.roof == "hip" else 0.0
    inset = min(inset, 0.4 * long)
    drop = p.rise * over / (short / 2)  # the slope goes on beyond the wall

    def place(u: float, v: float, z: float) -> Point:
        """From (along the ridge, across it) to (x, y)."""
        return (v, p.depth / 2 + u, z) if along_y else (u, p.depth / 2 + v, z)

    reach = long / 2 + over
    ridge = [place(s * (reach - inset), 0, eaves + p.rise) for s in (-1, 1)]
    parts = []
    for side in (-1, 1):
        low = [place(s * reach, side * (short / 2 + over), eaves - drop) for s in (-1, 1)]
        parts.append(polygon([*low, ridge[1], ridge[0]], p.roof_color, "roof"))
    for side, top in zip((-1, 1), ridge, strict=True):
        out = reach if inset else long / 2
        level, half = (eaves - drop, short / 2 + over) if inset else (eaves, short / 2)
        end = [place(side * out, -half, level), place(side * out, half, level)]
        apex = top if inset else place(side * out, 0, eaves + p.rise)
        color, material = (p.roof_color, "roof") if inset else (p.wall, p.wall_material)
        parts.append(polygon([*end, apex], color, material))
    return parts


def _flat_roof(params: BuildingParams) -> list[Asset]:
    """A parapet with a cornice below it."""
    p = params
    eaves = p.ground + p.storeys * p.storey
    cornice = box((p.width + 0.3, p.depth + 0.3, 0.2), (0, p.depth / 2, eaves), p.frame, "concrete")
    parapet = box((p.width, p.depth, p.rise - 0.2), (0, p.depth / 2, eaves + 0.2), p.wall,
                  p.wall_material)  # fmt: skip
    return [cornice, parapet]


def _chimney(params: BuildingParams, share: float) -> list[Asset]:
    p = params
    base, top = p.ground + p.storeys * p.storey, 0.9 + p.rise
    stack = box((0.9, 0.7, top), (0, 0, 0), p.chimney, "brick")
    pots = [
        tube((x, 0, top), (x, 0, top + 0.4), 0.13, (0.3, 0.12, 0.06), "brick", sides=4)
        for x in (-0.22, 0.22)
    ]
    return [translate(merge(stack, *pots), (share * (p.width / 2 - 0.6), p.depth / 2 + 0.4, base))]


def building(params: BuildingParams) -> Asset:
    """Build the building."""
    p = params
    parts = [*_facade(p), *_sides(p), *(_flat_roof(p) if p.roof == "flat" else _pitched_roof(p))]
    if p.ground_floor == "shop":
        parts += _shop_front(p)
    if p.ground_floor in ("shop", "door"):
        parts += _hoods(p)
    for bay in p.balconies:
        for storey in range(p.storeys):
            parts += _balcony(p, bay, storey)
    for share in np.linspace(-1, 1, 2)[: p.chimneys]:
        parts += _chimney(p, float(share))
    return merge(*parts)
