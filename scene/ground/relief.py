"""Surfaces along the road: kerb stones, the sidewalk, and the land up to the hills on the horizon."""

from __future__ import annotations

import numpy as np

from scene.ground.arms import LAP, LIP, turned
from scene.ground.extent import (
    GROUND_END,
    GROUND_SIDE,
    GROUND_START,
    KERB_WIDTH,
    STRIP,
    TUCK,
    stations,
    wavy,
)
from scene.ground.ground import Ground, along
from scene.ground.junction import REACH, Junction
from scene.ground.land import land_height, open_lines, rise
from scene.ground.litter import leaves
from scene.ground.verge import NO_SIDES
from scene.mesh.quads import Quads, flat, grid, quads, rectangles

DROPPED = 0.025
"""Height of a dropped kerb, metres."""
RAMP = 0.5
"""Length of the ramp to a dropped kerb, metres."""
WALKED = 1.8
"""Metres to each side of a crossing without a verge."""
DRIVE_LIFT = 0.006
"""Height of driveways above the land in front of a house."""
FLAT_SIDE, FLAT_END = 100.0, 330.0
"""Distances beyond which the land may rise, metres to each side and along the road."""
FIELDS = ((0.05, 0.085, 0.025), (0.10, 0.105, 0.04), (0.03, 0.05, 0.018), (0.13, 0.11, 0.06))
"""Colours of distant fields and woods."""


def sidewalk_quads(ground: Ground, rng: np.random.Generator) -> list[Quads]:
    """Kerb stones, paving and leaves on both sides."""
    parts = [part for side in (-1.0, 1.0) for part in _one_side(ground, side, rng)]
    return parts + leaves(ground, rng, road=False)


def _drops(ground: Ground, side: float) -> list[tuple[float, float]]:
    """Stretches with a dropped kerb: start and end, metres along the road."""
    return [(x - 1.8, x + 1.8) for x, s in ground.driveways if s == side] + [
        (x - 5.0, x + 5.0) for x, s in ground.side_streets if s == side
    ]


def _one_side(ground: Ground, side: float, rng: np.random.Generator) -> list[Quads]:
    stones, drops = along(ground, 1.8), _drops(ground, side)
    # In a bend, paving and ramp must share their corners.
    bays = None if ground.shaped or ground.side(side).green else stations(4.5)
    parts = _footway(ground, side, stones, bays, drops, rng)
    places = list(ground.crosswalks)
    if ground.junction and ground.junction.crossings[1] != "none":
        away = ground.junction.road_crossing
        places += [ground.junction.x - away, ground.junction.x + away]
    parts += [_blisters(ground, x, side) for x in places]
    parts += [_drive(ground, x, side) for x, s in ground.driveways if s == side]
    return parts


def arm_sides(ground: Ground, junction: Junction, rng: np.random.Generator) -> list[Quads]:
    """Kerb stones and paving along the arms of a junction; the kerb drops at their crossings."""
    arm = ground._replace(half_width=junction.half_width, footway=junction.footway, sides=NO_SIDES)
    stones = np.append(np.arange(junction.mouth - LAP, REACH - 1, 1.8), REACH)
    crossing = junction.crossings[0] != "none"
    drops = [(junction.arm_crossing - 0.9, junction.arm_crossing + 0.9)] if crossing else []
    parts = []
    for side in junction.arms:
        for hand in (-1.0, 1.0):
            pieces = _footway(arm, hand, stones, None, drops, rng)
            if crossing:
                pieces.append(_blisters(arm, junction.arm_crossing, hand))
            parts += [turned(part, junction, side) for part in pieces]
    return parts


def _footway(
    ground: Ground,
    side: float,
    stones: np.ndarray,
    bays: np.ndarray | None,
    drops: list[tuple[float, float]],
    rng: np.random.Generator,
) -> list[Quads]:
    """Kerb, ramp and paving on one side.

    Args:
        ground: widths and coats.
        side: 1 left, -1 right.
        stones: joints of kerb stones, metres along the street.
        bays: joints of the paving's cells; None: those of the stones.
        drops: stretches with a dropped kerb, start and end.
        rng: consumed.
    """
    x = np.unique(np.concatenate([stones, np.ravel(drops), _breaks(drops)]))
    if bays is None:
        bays = x
    high = ground.kerb_height
    free = ~_green_cells(ground, side, bays, drops)
    top = np.full(len(x), high + 0.005)
    for start, end in drops:
        top[(x >= start - 1e-9) & (x <= end + 1e-9)] = DROPPED
    inner = ground.half_width + KERB_WIDTH
    y = side * np.array([ground.half_width, ground.half_width + 0.02, inner])
    back = np.minimum(top, high) if ground.shaped else top
    kerb = grid(x, y, np.stack([np.zeros_like(top), top, back], axis=1))
    stone = (rng.uniform(0.82, 1.1, len(x) - 1)[:, None] * [0.8, 1.0]).reshape(-1, 1)
    parts = [quads(kerb, stone * np.asarray(ground.kerb), "concrete")]

    ramp = grid(x, side * np.array([inner, inner + RAMP]),
                np.stack([np.minimum(top, high), np.full(len(x), high)], axis=1))  # fmt: skip
    coat, base, roadside = ground.sidewalk, np.asarray(ground.sidewalk.color), ground.side(side)
    edge = (1 + 0.05 * wavy(rng, x[:-1], 9.0))[:, None] * base * ground.strip
    at_kerb = (
        roadside.green is not None and roadside.verge[0] <= inner
    )  # the verge replaces the ramp
    paved = free if at_kerb else np.ones(len(edge), bool)
    parts.append(quads(ramp[paved], edge[paved], coat.material))

    ends = {inner + RAMP, (inner + RAMP + ground.outer) / 2, ground.outer, *roadside.verge}
    across = np.array(sorted(y for y in ends if y >= inner + RAMP))
    columns = len(across) - 1
    shade = 1 + 0.05 * wavy(rng, bays[:-1], 9.0)[:, None]
    shade = shade + rng.uniform(-0.02, 0.02, (len(bays) - 1, columns))
    shade = (shade * np.linspace(1.0, 0.93, columns))[..., None] * base
    level = np.full((len(bays), columns + 1), high)
    cells = grid(bays, side * across, level)
    middle = (across[1:] + across[:-1]) / 2
    green = (middle > roadside.verge[0]) & (middle < roadside.verge[1])
    paved = (free[:, None] | ~green).ravel()
    parts.append(quads(cells[paved], shade.reshape(-1, 3)[paved], coat.material))
    rear = ground.rear(side)
    if roadside.court:
        court = grid(bays, side * np.array([ground.outer, rear]), level[:, :2])
        color = rng.uniform(0.95, 1.03, (len(court), 1)) * np.asarray(roadside.court.color)
        parts.append(quads(court, color, roadside.court.material))
    if ground.shaped:  # the land is a little lower
        lip = grid(bays, side * np.array([rear, rear]), level[:, :2] - [0, LIP])
        parts.append(quads(lip, 0.93 * base, coat.material))
    return parts


def _breaks(drops: list[tuple[float, float]]) -> list[float]:
    """Places where the kerb starts to fall to a dropped one, and where it is at full height again."""
    return [b + d for drop in drops for b, d in zip(drop, (-0.6, 0.6), strict=True)]


def _green_cells(
    ground: Ground, side: float, x: np.ndarray, drops: list[tuple[float, float]]
) -> np.ndarray:
    """bool[n - 1]: whether a verge is between places ``x`` f64[n]; not at crossings and driveways."""
    middle = (x[1:] + x[:-1]) / 2
    green = np.full(len(middle), ground.side(side).green is not None)
    walked = [(place - WALKED, place + WALKED) for place in ground.crosswalks]
    for start, end in [*((a - 0.6, b + 0.6) for a, b in drops), *walked]:
        green &= (middle < start) | (middle > end)
    return green


def _verge(ground: Ground, side: float, rng: np.random.Generator) -> list[Quads]:
    """The strip of grass or earth along the sidewalk of one side."""
    roadside = ground.side(side)
    if roadside.green is None:
        return []
    drops = _drops(ground, side)
    x = np.unique(np.concatenate([along(ground, 1.8), np.ravel(drops), _breaks(drops)]))
    cells = grid(x, side * np.array(roadside.verge), np.full((len(x), 2), ground.kerb_height))
    shade = 1 + 0.12 * wavy(rng, x[:-1], 5.0) + rng.uniform(-0.05, 0.05, len(x) - 1)
    keep = _green_cells(ground, side, x, drops)
    color = shade[keep, None] * np.asarray(roadside.green.color)
    return [quads(cells[keep], color, roadside.green.material)]


def _blisters(ground: Ground, x: float, side: float) -> Quads:
    """Tactile paving at a crossing."""
    inner = ground.half_width + KERB_WIDTH
    y0, y1 = sorted((side * inner, side * (inner + 0.8)))
    outline = rectangles(*np.array([x - 1.2, x + 1.2, y0, y1]))
    return flat(outline, ground.kerb_height + 0.003, np.array([0.24, 0.17, 0.11]), "tactile")


def _drive(ground: Ground, x: float, side: float) -> Quads:
    """A driveway over the sidewalk to the house."""
    roadside = ground.side(side)
    begin = ground.half_width + KERB_WIDTH + RAMP
    y0, y1 = sorted((side * begin, side * max(roadside.drive_end, ground.outer)))
    outline = rectangles(*np.array([x - 1.6, x + 1.6, y0, y1]))
    coat = roadside.drive or ground.sidewalk._replace(material="concrete")
    return flat(
        outline, ground.kerb_height + DRIVE_LIFT, 0.85 * np.asarray(coat.color), coat.material
    )


def terrain_quads(ground: Ground, rng: np.random.Generator) -> list[Quads]:
    """Land on both sides in patches of similar shades, and distant hills of fields and woods."""
    if ground.shaped:
        strips = [_strip(ground, side, rng) for side in (-1.0, 1.0)]
        return strips + [part for side in (-1.0, 1.0) for part in _verge(ground, side, rng)]
    base = np.asarray(ground.terrain.color)
    x = stations(8.0)
    parts = []
    for side in (-1.0, 1.0):
        # Wide streets omit cells that they cover.
        y = side * np.array([ground.rear(side), *_beyond(ground, side), 26.0, 50.0, FLAT_SIDE])
        shape = (len(x) - 1, len(y) - 1)
        shade = 1 + 0.12 * wavy(rng, x[:-1], 20.0)[:, None] + rng.uniform(-0.06, 0.06, shape)
        land = grid(x, y, np.full((len(x), len(y)), ground.kerb_height))
        parts.append(quads(land, shade.reshape(-1, 1) * base, ground.terrain.material))
        outer = side * np.array([FLAT_SIDE, 150.0, 220.0, 310.0, GROUND_SIDE])
        along = np.linspace(GROUND_START, GROUND_END, 17)
        rise = np.array([0.0, 0.15, 0.45, 0.8, 1.0])
        parts.append(_hills(ground, along, outer, rise[None, :], rng))
        parts += _verge(ground, side, rng)
    ahead = np.array([FLAT_END, 380.0, 440.0, 520.0, GROUND_END])
    across = np.linspace(-FLAT_SIDE, FLAT_SIDE, 9)
    parts.append(_hills(ground, ahead, across, np.array([[0.0, 0.2, 0.5, 0.85, 1.0]]).T, rng))
    return parts


def _beyond(ground: Ground, side: float) -> list[float]:
    """Those of 11 and 16 metres from the centre line that are clear of paving."""
    return [y for y in (11.0, 16.0) if y > ground.rear(side) + 0.4]


def _strip(ground: Ground, side: float, rng: np.random.Generator) -> Quads:
    """The land along a road that bends or slopes, up to the open land."""
    x = along(ground, 8.0)
    y = np.array([ground.rear(side) - TUCK, *_beyond(ground, side), STRIP, STRIP + 0.5])
    z = np.full((len(x), len(y)), ground.kerb_height)
    z[:, 0] -= 0.01  # it starts below the sidewalk
    z[:, -1] -= 3.0
    shape = (len(x) - 1, len(y) - 1)
    shade = 1 + 0.12 * wavy(rng, x[:-1], 20.0)[:, None] + rng.uniform(-0.06, 0.06, shape)
    color = shade.reshape(-1, 1) * np.asarray(ground.terrain.color)
    return quads(grid(x, side * y, z), color, ground.terrain.material)


def open_land(ground: Ground, rng: np.random.Generator) -> list[Quads]:
    """Land around a road that bends or slopes, in world coordinates, with distant hills."""
    east, north = open_lines(ground.path)
    points = np.stack(np.meshgrid(east, north, indexing="ij"), axis=-1).reshape(-1, 2)
    share = rise(ground.path, points, ground.junction)
    height = land_height(ground.path, points, ground.junction)
    height += ground.hills * share * rng.uniform(0.6, 1.0, len(points))
    cells = grid(east, north, height.reshape(len(east), len(north)))
    shape = (len(east), len(north))
    wild = share.reshape(shape)[:-1, :-1].ravel() > 0
    field = np.array(FIELDS)[rng.integers(len(FIELDS), size=len(cells))]
    near = rng.uniform(0.85, 1.15, (len(cells), 1)) * np.asarray(ground.terrain.color)
    return [
        quads(cells[~wild], near[~wild], ground.terrain.material),
        quads(cells[wild], field[wild], "long grass"),
    ]


def _hills(
    ground: Ground, x: np.ndarray, y: np.ndarray, rise: np.ndarray, rng: np.random.Generator
) -> Quads:
    """Slopes that rise away from the street by up to ``ground.hills`` metres."""
    height = ground.hills * rise * rng.uniform(0.6, 1.0, (len(x), len(y)))
    cells = (len(x) - 1) * (len(y) - 1)
    field = np.array(FIELDS)[rng.integers(len(FIELDS), size=cells)]
    return quads(grid(x, y, ground.kerb_height + 0.01 + height), field, "long grass")
