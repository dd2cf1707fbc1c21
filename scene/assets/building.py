"""Buildings: the facade in the plane y = 0 faces the road (-y), the body extends to y > 0.

The facade is a wall with real openings; a layer of frames lies some centimetres behind it, and
panes of glass between the two. Everything else (roof, chimneys, balconies, shop front) is added.
"""

from __future__ import annotations

from itertools import chain, product
from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, box, merge, quad, vary
from scene.assets._facade import (
    PROUD,
    RECESS,
    Opening,
    bays,
    fill,
    pierced_wall,
    side_window,
    upright,
)
from scene.assets._roof import chimney, flat, pitched

KINDS: tuple[str, ...] = (
    "terrace", "shop", "office", "apartments", "detached", "warehouse", "townhouse", "hall",
)  # fmt: skip

Finish = tuple[Color, str]
"""Colour and material of a wall."""

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
    sills: bool
    side_windows: int  # in a row of each side wall
    ground_floor: str  # "doors", "shop", "gates" or "windows"
    doors: tuple[int, ...]  # bays with a door, where the ground floor has doors
    hood: float  # how far a slab over each door or a shop's awning stands out, m; 0 for none
    balconies: tuple[int, ...]  # bays with balconies
    roof: str  # "flat", "gable" (ridge along the road), "front gable" or "hip"
    rise: float  # height of roof or parapet, m
    chimneys: int  # up to 2, one at either end
    wall: Finish
    ground_wall: Finish  # of the ground floor
    frame: Color  # around panes; sills, cornice, slabs
    accent: Color  # doors, signboard, gates, railings
    roof_color: Color
    chimney: Color


def sample_building(rng: np.random.Generator, kind: str) -> BuildingParams:
    """Draw a building of one of ``KINDS``."""

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def one_of(colors: tuple[Color, ...]) -> Color:
        return vary(rng, colors[rng.integers(len(colors))], 0.2)

    brick, paint = one_of(BRICKS), one_of(PAINTS)
    bricks, plaster = (brick, "brick"), (one_of(RENDERS), "plaster")
    concrete = (vary(rng, (0.31, 0.30, 0.28), 0.25), "concrete")
    either = (bricks, plaster)[rng.integers(2)]
    hooded, flat_topped = rng.random() < 0.4, rng.random() < 0.5
    terrace = BuildingParams(
        width=between(8.5, 12), depth=between(8, 10), storeys=int(rng.integers(1, 3)),
        ground=between(2.8, 3.2), storey=between(2.7, 3.0), bays=4, window=(0.48, 0.58),
        panes=(1, 2), sills=True, side_windows=0, ground_floor="doors",
        doors=((0, 3), (1, 2))[rng.integers(2)], hood=0.45 if hooded else 0.0, balconies=(),
        roof="gable", rise=between(2, 3), chimneys=2, wall=bricks, ground_wall=bricks,
        frame=vary(rng, (0.60, 0.60, 0.58), 0.1), accent=paint, roof_color=one_of(SLATES),
        chimney=brick,
    )  # fmt: skip
    match kind:
        case "terrace":
            return terrace
        case "shop":
            return terrace._replace(
                storeys=int(rng.integers(1, 4)), ground=between(3.4, 4), bays=int(rng.integers(3, 5)),
                ground_floor="shop", ground_wall=(paint, "paint"), wall=either,
                roof="flat" if flat_topped else "gable",
                rise=between(0.6, 1) if flat_topped else between(1.8, 2.5),
                hood=0.55 if hooded else 0.0, chimneys=int(rng.integers(0, 3)),
            )  # fmt: skip
        case "office":
            return terrace._replace(
                width=between(10, 14), depth=12.0, storeys=int(rng.integers(3, 5)), ground=3.8,
                storey=between(3.2, 3.7), bays=int(rng.integers(5, 7)), panes=(1, 1), sills=False,
                window=(between(0.78, 0.9), between(0.6, 0.8)), ground_floor="windows",
                roof="flat", rise=0.7, chimneys=0, side_windows=2, wall=concrete,
                ground_wall=concrete, frame=vary(rng, (0.08, 0.09, 0.1), 0.4),
            )  # fmt: skip
        case "apartments":
            return terrace._replace(
                width=between(10, 13), depth=11.0, storeys=int(rng.integers(2, 4)), ground=3.0,
                storey=2.9, window=(0.5, 0.6), panes=(2, 1), sills=False, side_windows=1,
                doors=(2,), hood=0.5, balconies=((1, 2), (0, 3))[rng.integers(2)],
                roof="flat" if flat_topped else "hip", rise=0.9 if flat_topped else between(2, 3),
                chimneys=0, wall=plaster, ground_wall=plaster,
            )  # fmt: skip
        case "detached":
            return terrace._replace(
                width=between(8, 9.5), storeys=1, bays=3, window=(0.55, 0.5), panes=(2, 1),
                side_windows=2, doors=(1,), hood=0.55, rise=between(2.4, 3.4), chimneys=1,
                roof=("hip", "front gable")[rng.integers(2)], wall=plaster,
                ground_wall=either, roof_color=vary(rng, (0.20, 0.08, 0.05), 0.25),
            )  # fmt: skip
        case "warehouse":
            return terrace._replace(
                width=between(11, 14), depth=12.0, storeys=1, ground=4.0, storey=between(1.8, 2.6),
                window=(0.7, 0.42), panes=(2, 1), sills=False, ground_floor="gates",
                roof="front gable", rise=between(1, 1.8), chimneys=0, frame=concrete[0],
                wall=(vary(rng, (0.24, 0.27, 0.29), 0.3), "metal"),
            )  # fmt: skip
        case "townhouse":
            return terrace._replace(
                width=between(8.5, 10.5), storeys=int(rng.integers(2, 4)), storey=between(3, 3.5),
                window=(0.42, 0.66), panes=(2, 2), doors=(3,), hood=0.0, roof="flat", rise=0.8,
                wall=either, ground_wall=plaster,
            )  # fmt: skip
        case "hall":
            stone = (vary(rng, (0.33, 0.28, 0.20), 0.2), "concrete")
            return terrace._replace(
                width=between(8, 10), depth=12.0, storeys=1, ground=between(3.4, 4),
                storey=between(4.5, 6), bays=3, window=(0.4, 0.72), panes=(2, 3), side_windows=3,
                doors=(1,), hood=0.0, roof="front gable", rise=between(3.5, 5), chimneys=0,
                wall=stone, ground_wall=stone,
            )  # fmt: skip
    raise ValueError(f"unknown kind of building {kind!r}; known: {', '.join(KINDS)}")


def eaves(params: BuildingParams) -> float:
    """Height of the walls (metres)."""
    return params.ground + params.storeys * params.storey


def _upper_openings(params: BuildingParams) -> list[list[Opening]]:
    """Openings of the storeys above the ground floor, by column; balconies have glass doors."""
    p = params
    sill = p.storey * (1 - p.window[1]) * 0.55
    head = sill + p.storey * p.window[1]
    floors = p.ground + p.storey * np.arange(p.storeys)
    return [
        [Opening(*span, z + (0.1 if bay in p.balconies else sill), z + head) for z in floors]
        for bay, span in enumerate(bays(p.width, p.bays, p.window[0]))
    ]


def _ground_openings(params: BuildingParams) -> list[list[Opening]]:
    """Openings of the ground floor, by column."""
    p = params
    windows = bays(p.width, p.bays, p.window[0])
    top = 0.82 * p.ground
    match p.ground_floor:
        case "shop":
            left, entrance, right = bays(p.width, 3, 0.86)
            high = 0.74 * p.ground
            row = [Opening(*left, 0.55, high), Opening(*entrance, 0.08, high),
                   Opening(*right, 0.55, high)]  # fmt: skip
        case "gates":
            *gates, office = bays(p.width, 3, 0.72)
            row = [Opening(*gate, 0.05, 0.85 * p.ground, glazed=False) for gate in gates]
            row.append(Opening(*office, 1.6, 0.7 * p.ground))
        case "windows":
            row = [Opening(*span, 0.3, top) for span in windows]
        case _:
            row = [Opening(*span, 0.9, top) for span in windows]
            for bay in p.doors:
                row[bay] = row[bay]._replace(low=0.12, glazed=False)
    return [[opening] for opening in row]


def _facade(params: BuildingParams) -> list[Asset]:
    """Both parts of the front with frames, panes, doors and sills."""
    p = params
    top = eaves(p)
    upper, ground = _upper_openings(p), _ground_openings(p)
    parts = [quad(upright(-p.width / 2, p.width / 2, 0, top, RECESS), p.frame, "paint")]
    parts += pierced_wall(p.width, (0, p.ground), ground, *p.ground_wall)
    parts += pierced_wall(p.width, (p.ground, top), upper, *p.wall)
    for (opening,) in ground:
        parts += fill(opening, p.panes if p.ground_floor == "doors" else (1, 1), p.accent)
    for opening in chain.from_iterable(upper):
        parts += fill(opening, p.panes, p.accent)
        if p.sills:
            left, right, low = opening.left - 0.08, opening.right + 0.08, opening.low
            parts.append(quad(upright(left, right, low - 0.12, low, -PROUD), p.frame, "plaster"))
    return parts


def _ledge(span: tuple[float, float], out: float, base: float, color: Color) -> Asset:
    """A slab of concrete that stands out of the facade and is let into it."""
    (left, right), let_in = span, 0.05
    size = (right - left, out + let_in, 0.14)
    return box(size, ((left + right) / 2, (let_in - out) / 2, base), color, "concrete")


def _shop_front(params: BuildingParams) -> list[Asset]:
    """Signboard with lettering over the windows, perhaps an awning below it."""
    p = params
    low, high, front = 0.77 * p.ground, 0.97 * p.ground, -0.17
    board = box((0.96 * p.width, 0.25, high - low), (0, front + 0.125, low), p.accent, "paint")
    red, green, blue = (0.5 if c < 0.25 else 0.04 for c in p.accent)
    letters = upright(-0.25 * p.width, 0.2 * p.width, low + 0.2, high - 0.2, front - PROUD)
    parts = [board, quad(letters, (red, green, blue), "paint")]
    if p.hood:
        half, edge = 0.46 * p.width, 0.64 * p.ground
        slope = [(-half, -p.hood, edge), (half, -p.hood, edge),
                 (half, front - 0.03, low), (-half, front - 0.03, low)]  # fmt: skip
        parts.append(quad(slope, p.frame, "cloth"))
        parts.append(quad(upright(-half, half, edge - 0.2, edge, -p.hood), p.accent, "cloth"))
    return parts


def _hoods(params: BuildingParams) -> list[Asset]:
    """A slab over each door."""
    p = params
    spans = bays(p.width, p.bays, p.window[0] + 0.15)
    return [_ledge(spans[bay], p.hood, 0.84 * p.ground, p.frame) for bay in p.doors]


def _balconies(params: BuildingParams) -> list[Asset]:
    """A slab with a solid railing before each glass door."""
    p = params
    parts = []
    for bay, storey in product(p.balconies, range(p.storeys)):
        span, floor = bays(p.width, p.bays, 0.9)[bay], p.ground + storey * p.storey
        railing = upright(*span, floor + 0.2, floor + 0.95, -0.53)
        parts += [_ledge(span, 0.55, floor - 0.06, p.frame), quad(railing, p.accent, "metal")]
    return parts


def _sides(params: BuildingParams) -> list[Asset]:
    """Back and side walls, the latter with their windows."""
    p = params
    top, half = eaves(p), p.width / 2
    parts = [quad(upright(-half, half, 0, top, p.depth), *p.wall)]
    middles = (np.arange(p.side_windows) + 0.5) / max(p.side_windows, 1) * p.depth
    for x in (-half, half):
        corners = [(x, 0, 0), (x, p.depth, 0), (x, p.depth, top), (x, 0, top)]
        parts.append(quad(corners, *p.wall))
        for storey, middle in product(range(p.storeys), middles):
            low = p.ground + (storey + 0.3) * p.storey
            parts += side_window(x, middle, low, low + 0.5 * p.storey, p.frame)
    return parts


def _top(params: BuildingParams) -> list[Asset]:
    """The roof and its chimneys: the first at the left end, the second at the right."""
    p = params
    plan = (p.width, p.depth)
    if p.roof == "flat":
        roof = flat(plan, eaves(p), p.rise, p.frame, p.wall)
    else:
        roof = pitched(plan, eaves(p), p.rise, p.roof, p.roof_color, p.wall)
    reach, y = p.width / 2 - 0.6, p.depth / 2 + 0.4
    places = [(x, y, eaves(p)) for x in (-reach, reach)]
    stacks = [chimney(place, p.rise + 0.9, p.chimney) for place in places[: p.chimneys]]
    return [roof, *stacks]


def building(params: BuildingParams) -> Asset:
    """Build the building."""
    p = params
    parts = [*_facade(p), *_sides(p), *_top(p), *_balconies(p)]
    if p.ground_floor == "shop":
        parts += _shop_front(p)
    elif p.ground_floor == "doors" and p.hood:
        parts += _hoods(p)
    return merge(*parts)
