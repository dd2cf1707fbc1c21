"""Clear junctions and camera positions of objects of lines and background."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from scene.ground.extent import GROUND_START, STRIP_END
from scene.ground.ground import Ground
from scene.ground.junction import ARM_END
from scene.ground.path import Path, nearest
from scene.street.clearance import Rectangle, Rectangles
from scene.street.instances import (
    FLAT,
    Stand,
    footprint,
    objects,
    rectangles,
    spans,
    turned_out,
    world_corners,
)

VEHICLES = ("car", "truck", "bus")
"""Families of the traffic."""
WALKING = frozenset({"person"})
"""Families that may stand between the kerbs of a junction."""
SOLID = frozenset({"building", "train", "fence", "wall"})
"""Families that must not reach across an arm."""
CLEAR = 1.5
"""Metres by which a house may be nearer to the road than the house fronts before it is left out."""
FARTHEST, PACE = 16.0, 0.25
"""Largest distance and step of moves out of the camera's way, metres."""
MOVES = np.array(
    [
        move
        for metres in np.arange(PACE, FARTHEST + PACE / 2, PACE).tolist()
        for move in ((0.0, metres), (metres, 0.0), (-metres, 0.0))
    ]
)
"""Moves to try, f64[n, 2] metres along the road and away from its centre line; short ones first."""


def cleared(ground: Ground, stands: Sequence[Stand], houses: Sequence[Stand]) -> list[Stand]:
    """Leave out objects that would be in a junction or in its houses.

    Args:
        ground: ground of the street.
        stands: objects of the lines and the background.
        houses: houses of the junction.
    """
    junction = ground.junction
    if junction is None or not stands:
        return list(stands)
    low, high = spans(ground.path, stands, junction.x)
    middle = (low + high) / 2
    families = [stand.family for stand in stands]
    solid, vehicle, house, walks = (
        np.array([family in kinds for family in families], bool)
        for kinds in (SOLID, VEHICLES, ("building",), WALKING)
    )
    first, last = (np.where(solid[:, None], end, middle) for end in (low, high))
    (x, y), away = (first + last).T / 2, np.abs(first + last).T / 2
    on_arm = np.isin(np.sign(y), junction.arms) & (away[1] <= ARM_END)
    reach = np.where(house, junction.outer + 0.3, junction.corner)
    across = (first[:, 0] < reach) & (last[:, 0] > -reach)
    inner = (away[0] < junction.corner) & (away[1] < junction.road_half_width + 0.4)
    paved = junction.paved(x + junction.x, y, 0.5)
    bad = on_arm & np.where(solid, across, np.where(inner, ~walks, paved))
    on_road = vehicle & (away[1] < junction.road_half_width)
    bad = np.where(on_road, away[0] < junction.half_width + 3.5, bad)
    # A tree crown may overlap a roof.
    for begin, end in zip(*spans(ground.path, houses, junction.x), strict=True):
        bad |= ((first < end) & (last > begin)).all(axis=1)
    return _whole(stands, bad)


def clear_of_camera(path: Path, stands: Sequence[Stand], room: np.ndarray) -> list[Stand]:
    """Move objects out of the camera's way, as little as possible: along the road or away from it.

    Objects without a free place within ``FARTHEST`` metres are left out.

    Args:
        path: path of the road.
        stands: objects with their parts.
        room: f64[n, 6] areas that the camera keeps free, see ``camera_room``.
    """
    if not len(room) or not stands:
        return list(stands)
    reserved = Rectangles()
    reserved.extend(room)
    clear: list[Stand] = []
    for parts, row in zip(objects(stands), rectangles(path, stands), strict=True):
        if parts[0].family in FLAT or not reserved.meet(Rectangle(*row), 0.0):
            clear += parts
            continue
        first = parts[0]
        size = np.array([footprint(*(part[:2] for part in parts))])
        shifts = MOVES * [1.0, math.copysign(1.0, first.y)]
        x, y = (first[2:4] + shifts).T
        rows = turned_out(path, np.repeat(size, len(x), axis=0), x, y, np.full(len(x), first.yaw))
        free = (k for k, row in enumerate(rows) if not reserved.meet(Rectangle(*row), 0.0))
        k = next(free, None)
        if k is not None:
            dx, dy = shifts[k].tolist()
            clear += [part._replace(x=part.x + dx, y=part.y + dy) for part in parts]
    return clear


def off_the_road(ground: Ground, stands: Sequence[Stand], front: float) -> list[Stand]:
    """Leave out houses that would reach across the road in a bend.

    Args:
        ground: ground of the street.
        stands: houses and other objects.
        front: metres from the centre line to the facades.
    """
    houses = [k for k, stand in enumerate(stands) if stand.family == "building"]
    bad = np.zeros(len(stands), bool)
    if ground.path.bends and houses:
        corners = world_corners(ground.path, [stands[k] for k in houses])
        _, away = nearest(ground.path, corners.reshape(-1, 2), GROUND_START, STRIP_END)
        bad[houses] = away.reshape(-1, 4).min(axis=1) < front - CLEAR
    return _whole(stands, bad)


def _whole(stands: Sequence[Stand], bad: np.ndarray) -> list[Stand]:
    """Leave out bad objects bool[n] with their parts."""
    remaining: list[Stand] = []
    stays = True
    for stand, leaves in zip(stands, bad.tolist(), strict=True):
        stays = stays if stand.part else not leaves
        if stays:
            remaining.append(stand)
    return remaining
