"""Lines of objects along both sides of the road, each at a distance and with a spacing of its own.

Lines may interpenetrate and are never moved apart: finding attributes that keep them apart is the search
problem. Source: section 3 of the paper.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from scene.assets import catalogue
from scene.assets.catalogue import AssetPool, in_season, pick
from scene.assets.families import FAMILIES
from scene.attributes import StreetParams
from scene.ground.ground import Ground
from scene.streams import seeded
from scene.street.placing import Standing, pose_at

LINE_START, LINE_END = -15.0, 150.0
"""Where every line of objects begins and ends, metres along the road."""
JITTER = 0.25
"""Objects leave their slot's middle by up to this share of the interval."""
STEP = 0.0437
"""Metres that neighbouring facades stand apart in depth, or they would lie in one plane where they
overlap. It is no round number, since walls have relief in whole centimetres."""
RUN, OVERLAP = 0.8, 0.98
"""Share of an interval that a run of panels may fill; shift from panel to panel in lengths of one."""
OWN_POST = 0.1
"""A user's own sign that reaches this low, metres, has a post of its own."""

LINES: dict[str, dict[str, float]] = {}
"""Line -> family -> its share of the line's objects."""
for _row in FAMILIES.values():
    if _row.line is not None:
        LINES.setdefault(_row.line[0], {})[_row.name] = _row.line[1]


class Setting(NamedTuple):
    """What all lines of a street have in common."""

    params: StreetParams
    ground: Ground
    pool: AssetPool
    drive: float  # the side, 1 left or -1 right, whose traffic goes forward


def line_objects(
    line: str, side: float, street: Setting, rng: np.random.Generator
) -> Iterator[Standing]:
    """Fill one line on one side (1 left, -1 right) of the road, slot by slot; consumes ``rng``."""
    distance = getattr(street.params, f"{line}_position")
    interval = getattr(street.params, f"{line}_interval")
    probability = getattr(street.params, f"{line}_probability", 1.0)
    families = list(LINES[line])
    shares = list(accumulate(LINES[line].values()))
    start = LINE_START + rng.uniform(0, interval)
    for slot in range(math.ceil((LINE_END - start) / interval)):
        x = start + (slot + rng.uniform(-JITTER, JITTER)) * interval
        family = families[bisect_right(shares, rng.random() * shares[-1])]
        ref = pick(street.pool, family, rng)
        seed = int(rng.integers(2**31))
        yaw = _yaw(FAMILIES[family].facing, side, side == street.drive, rng)
        filled = rng.random() < probability
        if not filled or ref is None:
            continue
        if family == "tree":
            season_rng = seeded(seed)
            ref = in_season(family, ref, street.params.bare_tree_share, street.pool, season_rng)
        step = STEP * (slot % 3) if FAMILIES[family].front == "right" else 0.0
        for shift in _panels(family, ref, interval):
            pose = pose_at(street.ground, x + shift, side * (distance + step), yaw)
            for part, part_ref in parts_of(family, ref, seed, street.pool):
                yield part, part_ref, pose


def _panels(family: str, ref: int | str, interval: float) -> list[float]:
    """Where along the road the copies of an object stand, from its place: fences and walls run on."""
    if not FAMILIES[family].runs:
        return [0.0]
    low, high = catalogue.bounds(family, ref)
    length = OVERLAP * float(high[0] - low[0])
    count = int(np.clip(RUN * interval / length, 1, 3))
    return [(k - (count - 1) / 2) * length for k in range(count)]


def parts_of(
    family: str, ref: int | str, seed: int, pool: AssetPool
) -> list[tuple[str, int | str]]:
    """The assets that make up one object: a rider's machine and a sign's post have their own class.

    Where a pool of own assets has no post for a sign or light, a built-in one stands there; an own rider
    goes without a machine. What would hang in the air, since a pool is without its family, is left out.
    """
    row = FAMILIES[family]
    whole = isinstance(ref, str) and row.front == "back"
    if not row.on or (whole and catalogue.bounds(family, ref)[0, 2] < OWN_POST):
        return [(family, ref)]
    rng = seeded(seed)
    base = row.on
    if not isinstance(base, str):  # a user's own rider says not what it rides
        kind = ref if isinstance(ref, int) else int(rng.integers(len(row.kinds)))
        base = row.base(row.kinds[kind % len(row.kinds)])
    below = pick(pool, base, rng)
    if below is None and row.front == "back":
        below = pick(pool._replace(use="built-in"), base, rng)
    if below is not None:
        return [(family, ref), (base, below)]
    return [(family, ref)] if isinstance(ref, str) and row.front != "back" else []


def _yaw(facing: str, side: float, forward: bool, rng: np.random.Generator) -> float:
    """The heading of an object, radians left of the driving direction; see ``Family.facing``."""
    turned, wobble, free = rng.random(), rng.normal(), rng.uniform(-math.pi, math.pi)
    if facing == "road":
        return 0.0 if side > 0 else math.pi
    if facing == "lane":
        return (0.0 if forward else math.pi) + 0.02 * wobble
    if facing == "either":
        return free if turned > 0.85 else (math.pi if turned > 0.45 else 0.0) + 0.15 * wobble
    if facing == "camera":
        return 0.1 * wobble
    return free
