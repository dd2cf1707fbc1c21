"""Lines of objects along both sides of the road, each with its own distance and spacing.

As in the paper (section 3), lines may overlap: the search has to find attributes that keep them apart. If
streets avoid overlaps (``AssetPool.overlap``), the objects of a line do not overlap, and an object that would
overlap another one is moved a little or left out.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from scene.assets.catalogue import asset_at, in_season, parts_of
from scene.assets.families import FAMILIES
from scene.streams import stream
from scene.street.instances import WHEELED, Stand, footprint
from scene.street.plot import LINE_END, LINE_START, Setting

JITTER = 0.25
"""Largest distance of objects from the middle of their slot, as a share of the interval."""
STEP = 0.0437
"""Depth offset of neighbouring facades in metres, since overlapping ones must not share a plane. It is not a
round number, since walls have relief in whole centimetres."""
RUN, LAP = 0.8, 0.04
"""Share of an interval that a run of panels may fill; overlap of panels in metres."""
KERB = {"pole": 0.45, "bicycle": 0.55}
"""Least distance of a line's objects from the kerb if overlaps are avoided, metres."""
NARROW = 0.5
"""Largest half width in metres of objects that are moved off a kerb."""
ORDER = ("building", "car", "fence", "tree", "pole", "bicycle", "person")
"""Order of the lines if overlaps are avoided."""
TOWARDS, ASIDE = 0.7, 0.25
"""Moves of an object that overlaps another one: metres towards the road, once and twice, and share of its
interval along it, in both directions."""

LINES: dict[str, dict[str, float]] = {}
"""Line -> family -> its share of the line's objects."""
for _row in FAMILIES.values():
    if _row.line is not None:
        LINES.setdefault(_row.line[0], {})[_row.name] = _row.line[1]
LINE_OF = {family: line for line, shares in LINES.items() for family in shares}


def _line(
    line: str, side: float, street: Setting, rng: np.random.Generator, apart: bool
) -> list[Stand]:
    """One line on one side (1 left, -1 right) of the road, slot by slot; consumes ``rng``.

    ``apart``: whether its objects avoid each other.
    """
    params, pool = street.params, street.pool
    distance = getattr(params, f"{line}_position")
    interval = getattr(params, f"{line}_interval")
    probability = getattr(params, f"{line}_probability", 1.0)
    families = list(LINES[line])
    shares = list(accumulate(LINES[line].values()))
    start = LINE_START + rng.uniform(0, interval)
    count = math.ceil((LINE_END - start) / interval)
    draws = rng.random((count, 8)).tolist()
    wobbles = rng.standard_normal(count).tolist()
    if apart and line in KERB:
        distance = max(distance, street.ground.half_width + KERB[line])
    stands: list[Stand] = []
    late = 0.0
    for slot in range(count):
        filled, which, share, jitter, season, chance, turned, free = draws[slot]
        family = families[bisect_right(shares, which * shares[-1])]
        ref = asset_at(pool, family, share)
        if filled >= probability or ref is None:
            continue
        row = FAMILIES[family]
        ref = in_season(family, ref, params.bare_tree_share, pool, season)
        forward = side == street.drive
        yaw = _yaw(row.facing, side, forward, turned, free, wobbles[slot])
        long, wide = (2 * half for half in footprint((family, ref))[2:])
        panels = _panels(long, interval) if row.in_rows else [0.0]
        step = STEP * (slot % 3) if row.front == "right" else 0.0
        across = distance + step
        if family not in WHEELED:
            reach = (abs(math.sin(yaw)) * long + abs(math.cos(yaw)) * wide) / 2
            across = _off_the_kerb(across, street.ground.half_width, reach)
        shift = (2 * jitter - 1) * JITTER * interval
        if apart:
            reach = abs(math.cos(yaw)) * long * len(panels) + abs(math.sin(yaw)) * wide
            spare = max(interval - reach, 0.0) / 2
            shift = min(max(shift, -spare), spare)
            more = max(reach - interval, 0.0)
            late += more / 2
        x = start + slot * interval + shift + late
        if apart:
            late += more / 2
            if x > LINE_END:
                break
        for panel in panels:
            for k, part in enumerate(parts_of(family, ref, chance, pool)):
                stands.append(Stand(*part, x + panel, side * across, yaw, part=k > 0))
    return stands


def lines_of(street: Setting, seed: int, is_open: Sequence[float], apart: bool) -> list[Stand]:
    """All lines on both sides in their order, without houses on open sides."""
    names, stands = list(LINES), []
    for line in ORDER if apart else names:
        for k, side in enumerate((1.0, -1.0)):
            # Each line has its own streams, so that moving one does not change the others.
            rng = stream(seed, "line", 2 * names.index(line) + k)
            if line != "building" or side not in is_open:
                stands += _line(line, side, street, rng, apart)
    return stands


def moves(street: Setting, stands: Sequence[Stand]) -> np.ndarray:
    """Moves to try for objects of lines, f64[tries, objects, 2]; see ``Plot.admit``.

    Objects stay in place, move towards the road, or along it; houses only stay in place.
    """
    first = [stand for stand in stands if not stand.part]
    lines = [LINE_OF[stand.family] for stand in first]
    inwards = np.array([-math.copysign(TOWARDS, stand.y) for stand in first])
    along = np.array([ASIDE * getattr(street.params, f"{line}_interval") for line in lines])
    house = np.array([line == "building" for line in lines], bool)
    inwards[house] = along[house] = 0.0
    still = np.zeros_like(along)
    tries = [
        (still, still),
        (still, inwards),
        (along, still),
        (-along, still),
        (still, 2 * inwards),
    ]
    return np.array(tries).transpose(0, 2, 1)


def _off_the_kerb(distance: float, kerb: float, reach: float) -> float:
    """The nearest distance from the centre line at which a narrow object stands on one side of the kerb.

    ``reach`` is how far it extends across the road from its middle, metres.
    """
    away = distance - kerb
    return distance if abs(away) >= reach or reach > NARROW else kerb + math.copysign(reach, away)


def _panels(long: float, interval: float) -> list[float]:
    """Positions along the road of the copies of a panel, since fences and walls are continuous."""
    pitch = long - LAP
    count = int(np.clip(RUN * interval / pitch, 1, 3))
    return [(k - (count - 1) / 2) * pitch for k in range(count)]


def _yaw(
    facing: str, side: float, forward: bool, turned: float, free: float, wobble: float
) -> float:
    """The heading of an object, radians left of the driving direction; see ``Family.facing``.

    ``turned`` and ``free`` are uniform draws from [0, 1), ``wobble`` is one from the standard normal.
    """
    anyhow = (2 * free - 1) * math.pi
    if facing == "road":
        return 0.0 if side > 0 else math.pi
    if facing == "lane":
        return (0.0 if forward else math.pi) + 0.02 * wobble
    if facing == "either":
        return anyhow if turned > 0.85 else (math.pi if turned > 0.45 else 0.0) + 0.15 * wobble
    if facing == "camera":
        return 0.1 * wobble
    return anyhow
