"""What gives way to a junction: objects of lines and background in its carriageways or its houses."""

from __future__ import annotations

import math

import numpy as np

from scene.ground.ground import Ground
from scene.ground.junction import ARM_END, Junction
from scene.ground.path import heading_at, to_world
from scene.street.placing import Standing, footprints

VEHICLES = ("car", "truck", "bus")
"""Families of the traffic."""
WALKING = frozenset({"person"})
"""Families that may stand between the kerbs of a junction."""
SOLID = frozenset({"building", "train", "fence", "wall"})
"""Families that may not reach over an arm."""


def cleared(ground: Ground, objects: list[Standing], own: list[Standing]) -> list[Standing]:
    """Objects but for those that would stand in a junction, or where its own houses do.

    Args:
        ground: of the street.
        objects: of the lines and the background.
        own: of the junction.
    """
    junction = ground.junction
    if junction is None:
        return objects
    low, high = boxes(ground, objects)
    middle = (low + high) / 2
    solid = np.array([stand[0] in SOLID for stand in objects], bool)[:, None]
    first, last = np.where(solid, low, middle), np.where(solid, high, middle)
    inside = np.zeros(len(objects), bool)  # but a crown may reach over a roof
    for begin, end in zip(*boxes(ground, [s for s in own if s[0] == "building"]), strict=True):
        inside |= ((first < end) & (last > begin)).all(axis=1)
    return [
        stand
        for k, stand in enumerate(objects)
        if not inside[k] and not _in_the_way(junction, stand[0], first[k], last[k])
    ]


def boxes(ground: Ground, objects: list[Standing]) -> tuple[np.ndarray, np.ndarray]:
    """Low and high corners f64[n, 2] of what objects stand on, from the junction's middle along the road."""
    at = ground.junction.x if ground.junction else 0.0
    heading = float(heading_at(ground.path, at))
    c, s = math.cos(heading), math.sin(heading)
    corners = (footprints(objects) - to_world(ground.path, at, 0.0)) @ np.array([[c, -s], [s, c]])
    return corners.min(axis=1), corners.max(axis=1)


def _in_the_way(junction: Junction, family: str, low: np.ndarray, high: np.ndarray) -> bool:
    """Whether an object on a rectangle, from the junction's middle, has to go."""
    x, y = (low + high) / 2
    if family in VEHICLES and abs(y) < junction.road_half_width:
        return bool(abs(x) < junction.half_width + 3.5)
    if math.copysign(1.0, y) not in junction.arms or abs(y) > ARM_END:
        return False
    if family in SOLID:
        reach = junction.outer + 0.3 if family == "building" else junction.corner
        return bool(low[0] < reach and high[0] > -reach)
    if abs(x) < junction.corner and abs(y) < junction.road_half_width + 0.4:
        return family not in WALKING
    return junction.paved(x + junction.x, y, 0.5)
