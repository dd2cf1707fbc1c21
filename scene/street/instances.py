"""Assets placed on the road, and their poses and footprints in the world."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from scene.assets import catalogue
from scene.assets.families import FAMILIES
from scene.assets.own_class import FAMILY
from scene.classes import OWN, TrainId
from scene.ground.extent import STRIP
from scene.ground.ground import Ground, ground_heights, kerb_heights
from scene.ground.path import Path, heading_at, height_at, slope_at, to_world
from scene.street.camera import DRIVE, SEARCH

FAR = 35.0
"""Metres from every camera beyond which trees have fewer, larger leaves and twigs."""
FIRST_INSTANCE = 4
"""The first instance of objects; 1-3 are road, sidewalk and terrain (``ground/build.py``), 0 is the sky."""
STEM = 0.3
"""Half the width in metres of the stems of trees, lamps and signs; other objects may be below the rest."""
EAVES = 0.35
"""Metres by which roofs of houses overlap, so that the walls of a row touch."""
HELD = frozenset({TrainId.VEGETATION, TrainId.POLE, TrainId.TRAFFIC_SIGN, TrainId.TRAFFIC_LIGHT})
"""Classes with only a stem on the ground."""
TILTED = frozenset(
    {
        *("car", "bus", "truck", "train", "bicycle", "motorcycle", "rider"),
        *("fence", "wall", "slab", "land", "paving", FAMILY),
    }
)
"""Families that tilt with the slope of the road; all others stay upright."""
WHEELED = frozenset({"car", "bus", "truck", "bicycle", "motorcycle", "rider"})
"""Families with wheels: they tilt if these are on both sides of a kerb."""
IN_LINE = frozenset({"bicycle", "motorcycle", "rider"})
"""Families with two wheels in line."""
CONTACT = 0.6, 0.78
"""Position of wheels and feet: shares of half the length and half the width of a footprint."""
FLAT = frozenset({"slab", "land", "paving"})
"""Families of flat tiles, on which objects and traffic may be placed."""


TRAIN_IDS = {name: int(family.train_id) for name, family in FAMILIES.items()} | {FAMILY: OWN}


class Stand(NamedTuple):
    """One asset and its place on the road."""

    family: str
    ref: int | str  # index in its family, or the name of a user's own in ``library.scan``
    x: float  # metres along the road
    y: float  # metres left of its centre line
    yaw: float  # radians left of the road's direction there
    lift: float = 0.0  # metres above the ground
    part: bool = False  # whether it is a part of the previous object and shares its place


class Placement(NamedTuple):
    """One asset placed in the street."""

    family: str
    asset: int | str  # index in its family, or the name of a user's own in ``library.scan``
    train_id: int
    instance: int
    pose: np.ndarray  # f64[4, 4] asset frame -> world; some buses are reflected
    far: bool = False  # whether it is far from all cameras, so that it gets fewer, larger leaves


def objects(stands: Sequence[Stand]) -> Iterator[list[Stand]]:
    """Group stands into objects with their parts."""
    parts: list[Stand] = []
    for stand in stands:
        if parts and not stand.part:
            yield parts
            parts = []
        parts.append(stand)
    if parts:
        yield parts


def placed(ground: Ground, stands: Sequence[Stand]) -> list[Placement]:
    """Place stands in the world, with ids from ``FIRST_INSTANCE`` on; parts share their object's pose."""
    path = ground.path
    world = poses(ground, stands)
    drive = to_world(path, np.arange(0.0, DRIVE + SEARCH, 5.0), 0.0)
    away = ((world[:, None, :2, 3] - drive) ** 2).sum(axis=2).min(axis=1) > FAR**2
    placements: list[Placement] = []
    for k, (stand, distant) in enumerate(zip(stands, away.tolist(), strict=True)):
        own_class = stand.family == FAMILY
        train_id = OWN if own_class else catalogue.train_id(stand.family, stand.ref)
        pose = placements[-1].pose if stand.part else world[k]
        far = distant and train_id == TrainId.VEGETATION
        placements.append(
            Placement(stand.family, stand.ref, train_id, FIRST_INSTANCE + k, pose, far)
        )
    return placements


def poses(ground: Ground, stands: Sequence[Stand]) -> np.ndarray:
    """Poses f64[n, 4, 4], asset frame -> world.

    Vehicles and flat objects tilt with the slope. Vehicles also tilt over a kerb; other objects are lowered
    to its lower side, and houses to the lowest ground below them. The doors of built-in buses face the kerb.
    """
    path = ground.path
    x, y, yaw, lift = _numbers(stands)
    world = np.zeros((len(stands), 4, 4))
    world[:, 2, 2] = world[:, 3, 3] = 1.0
    world[:, :2, 3] = to_world(path, x, y) if path.bends else np.stack([x, y], axis=1)
    world[:, 2, 3] = ground_heights(ground, x, y) + lift
    heading = yaw + heading_at(path, x) if path.bends else yaw
    world[:, 0, 0] = world[:, 1, 1] = np.cos(heading)
    world[:, 1, 0] = np.sin(heading)
    world[:, 0, 1] = -world[:, 1, 0]
    _over_kerbs(ground, stands, world)
    if path.slopes:
        families = [stand.family for stand in stands]
        tilted = np.array([family in TILTED for family in families], bool)
        world[tilted] = _leaning(path, world[tilted], x[tilted])
        houses = [k for k, family in enumerate(families) if family == "building"]
        if houses:
            reach = _corners([stands[k] for k in houses])[:, :, 0]
            low = height_at(path, reach).min(axis=1) - height_at(path, x[houses])
            world[houses, 2, 3] += np.minimum(low, 0.0)
    if ground.drive > 0:  # traffic keeps left, so assets for right-hand traffic are mirrored
        buses = [k for k, s in enumerate(stands) if s.family == "bus" and isinstance(s.ref, int)]
        world[buses, :, 1] *= -1.0
    return world


def _numbers(stands: Sequence[Stand]) -> np.ndarray:
    """x, y, yaw and lift f64[4, n]."""
    return np.array([stand[2:6] for stand in stands]).reshape(-1, 4).T


def _over_kerbs(ground: Ground, stands: Sequence[Stand], world: np.ndarray) -> None:
    """Tilt wheeled objects on both sides of a kerb, and lower all others to its lower side.

    A vehicle gets the plane closest to the ground at its four wheels. Parts follow their object.

    Args:
        ground: the ground.
        stands: the objects, with their parts.
        world: their poses f64[n, 4, 4], changed in place.
    """
    first = [k for k, stand in enumerate(stands) if not stand.part]
    grouped = list(objects(stands))
    on_ground = [
        parts[0].family not in FLAT and not parts[0].lift and abs(parts[0].y) < STRIP
        for parts in grouped
    ]
    grouped = [parts for parts, on in zip(grouped, on_ground, strict=True) if on]
    if not grouped:
        return
    at = np.array(first)[on_ground]
    families = [parts[0].family for parts in grouped]
    wheeled = np.array([family in WHEELED for family in families])
    in_line = np.array([family in IN_LINE for family in families])
    footprints = np.array([footprint(*(part[:2] for part in parts)) for parts in grouped])
    x, y, yaw, _ = _numbers([parts[0] for parts in grouped])
    long = CONTACT[0] * footprints[:, 2]
    wide = np.where(in_line, 0.0, np.where(wheeled, CONTACT[1], CONTACT[0]) * footprints[:, 3])
    u = footprints[:, :1] + long[:, None] * [1, 1, -1, -1]
    v = footprints[:, 1:2] + wide[:, None] * [1, -1, 1, -1]
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    places = x[:, None] + c * u - s * v, y[:, None] + s * u + c * v
    height = kerb_heights(ground, places[0].ravel(), places[1].ravel()).reshape(-1, 4)
    centre = kerb_heights(ground, x, y)
    low = np.flatnonzero(~wheeled & (height.min(axis=1) < centre))
    world[at[low], 2, 3] -= centre[low]
    tilts = np.flatnonzero(wheeled & (height != centre[:, None]).any(axis=1))
    height, at, footprints = height[tilts], at[tilts], footprints[tilts]
    pitch = height @ [0.25, 0.25, -0.25, -0.25] / long[tilts]
    roll = height @ [0.25, -0.25, 0.25, -0.25] / np.where(in_line, np.inf, wide)[tilts]
    world[at, 2, 3] += (
        height.mean(axis=1) - footprints[:, 0] * pitch - footprints[:, 1] * roll - centre[tilts]
    )
    ahead = world[at, :3, 0] + pitch[:, None] * [0, 0, 1]
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    left = world[at, :3, 1] + roll[:, None] * [0, 0, 1]
    left -= (left * ahead).sum(axis=1, keepdims=True) * ahead
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    world[at, :3, :3] = np.stack([ahead, left, np.cross(ahead, left)], axis=2)


def _leaning(path: Path, world: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Tilt poses f64[n, 4, 4] by the slope of the road at ``x`` f64[n] metres."""
    rise, heading = np.arctan(slope_at(path, x)), heading_at(path, x)
    cross = np.zeros((len(world), 3, 3))
    # Rodrigues' rotation by ``rise`` about the axis to the right of the road, which lifts the front.
    cross[:, 0, 2], cross[:, 1, 2] = np.cos(heading), np.sin(heading)
    cross[:, 2, :2] = -cross[:, :2, 2]
    s, c = np.sin(rise)[:, None, None], np.cos(rise)[:, None, None]
    world[:, :3, :3] = (np.eye(3) - s * cross + (1 - c) * cross @ cross) @ world[:, :3, :3]
    return world


def _corners(stands: Sequence[Stand]) -> np.ndarray:
    """Corners f64[n, 4, 2] of the areas below assets, in coordinates of a straight road."""
    if not stands:
        return np.zeros((0, 4, 2))
    x, y, yaw, _ = _numbers(stands)
    outlines = np.array([_outline(stand.family, stand.ref) for stand in stands])
    u, v = outlines[:, (0, 2, 2, 0)], outlines[:, (1, 1, 3, 3)]
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    return np.stack([x[:, None] + c * u - s * v, y[:, None] + s * u + c * v], axis=2)


@lru_cache(maxsize=4096)
def _outline(family: str, ref: int | str) -> tuple[float, float, float, float]:
    """Low x, y and high x, y of an asset in its own frame, metres."""
    (left, back, _), (right, front, _) = catalogue.bounds(family, ref).tolist()
    return left, back, right, front


@lru_cache(maxsize=4096)
def top(family: str, ref: int | str) -> float:
    """The height of an asset's top, metres."""
    return float(catalogue.bounds(family, ref)[1, 2])


def length(family: str, ref: int | str) -> float:
    """The length of an asset along its x axis, metres."""
    left, _, right, _ = _outline(family, ref)
    return right - left


def spans(path: Path, stands: Sequence[Stand], at: float) -> tuple[np.ndarray, np.ndarray]:
    """Low and high corners f64[n, 2] of the areas below assets, along and across the road at ``at``.

    The origin is the centre line there.
    """
    corners = world_corners(path, stands)
    heading = float(heading_at(path, at))
    c, s = math.cos(heading), math.sin(heading)
    corners = (corners - to_world(path, at, 0.0)) @ np.array([[c, -s], [s, c]])
    return corners.min(axis=1), corners.max(axis=1)


def world_corners(path: Path, stands: Sequence[Stand]) -> np.ndarray:
    """Corners f64[n, 4, 2] of the areas below assets in the world."""
    corners = _corners(stands)
    if not path.bends or not stands:
        return corners
    x, y, _, _ = _numbers(stands)
    turn = heading_at(path, x)
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    u, v = corners[:, :, 0] - x[:, None], corners[:, :, 1] - y[:, None]
    turned = np.stack([c * u - s * v, s * u + c * v], axis=2)
    return turned + to_world(path, x, y)[:, None]


@lru_cache(maxsize=4096)
def footprint(*parts: tuple[str, int | str]) -> tuple[float, float, float, float]:
    """Centre x, y and half length and width, metres, of the footprint of an object of assets.

    Coordinates are in the object's frame; ``parts`` are families and references.
    """
    boxes = []
    for family, ref in parts:
        left, back, right, front = _outline(family, ref)
        if TRAIN_IDS[family] in HELD and family != "bush":
            left, back = max(left, -STEM), max(back, -STEM)
            right, front = min(right, STEM), min(front, STEM)
        if family == "building" and isinstance(ref, int):
            left, right, front = left + EAVES, right - EAVES, front - EAVES
        boxes.append((left, back, right, front))
    lefts, backs, rights, fronts = zip(*boxes, strict=True)
    left, back, right, front = min(lefts), min(backs), max(rights), max(fronts)
    return (left + right) / 2, (back + front) / 2, (right - left) / 2, (front - back) / 2


def rectangles(path: Path, stands: Sequence[Stand]) -> np.ndarray:
    """Footprints f64[objects, 6] of objects, with rows as ``clearance.Rectangle``."""
    grouped = list(objects(stands))
    if not grouped:
        return np.zeros((0, 6))
    footprints = np.array([footprint(*(part[:2] for part in parts)) for parts in grouped])
    x, y, yaw, _ = _numbers([parts[0] for parts in grouped])
    return turned_out(path, footprints, x, y, yaw)


def turned_out(
    path: Path, footprints: np.ndarray, x: np.ndarray, y: np.ndarray, yaw: np.ndarray
) -> np.ndarray:
    """Rectangles f64[n, 6] of footprints f64[n, 4] at places and headings f64[n] on the road."""
    heading = yaw + heading_at(path, x) if path.bends else yaw
    c, s = np.cos(heading), np.sin(heading)
    place = to_world(path, x, y) if path.bends else np.stack([x, y], axis=1)
    middle = np.stack(
        [c * footprints[:, 0] - s * footprints[:, 1], s * footprints[:, 0] + c * footprints[:, 1]],
        axis=1,
    )
    return np.column_stack([place + middle, c, s, footprints[:, 2:]])


def standing(placements: Sequence[Placement]) -> tuple[list[Placement], np.ndarray]:
    """The first part of each object, and the footprints f64[objects, 6] as in ``rectangles``.

    Flat tiles are left out.
    """
    grouped: list[list[Placement]] = []
    for p in placements:
        if grouped and grouped[-1][0].pose is p.pose:
            grouped[-1].append(p)
        elif p.family not in FLAT:
            grouped.append([p])
    first = [parts[0] for parts in grouped]
    if not first:
        return [], np.zeros((0, 6))
    footprints = np.array([footprint(*((p.family, p.asset) for p in parts)) for parts in grouped])
    world = np.stack([p.pose for p in first])
    ahead = world[:, :2, 0] / np.linalg.norm(world[:, :2, 0], axis=1, keepdims=True)
    middle = np.einsum("nij,nj->ni", world[:, :2, :2], footprints[:, :2]) + world[:, :2, 3]
    return first, np.column_stack([middle, ahead, footprints[:, 2:]])


def bounds(placements: Sequence[Placement]) -> np.ndarray:
    """World axis-aligned boxes f64[placements, 2, 3] (low, high corner)."""
    if not placements:
        return np.zeros((0, 2, 3))
    boxes = np.stack([catalogue.bounds(p.family, p.asset) for p in placements])
    world = np.stack([p.pose for p in placements])
    centre, half = boxes.mean(axis=1), (boxes[:, 1] - boxes[:, 0]) / 2
    rotation = world[:, :3, :3]
    middle = np.einsum("nij,nj->ni", rotation, centre) + world[:, :3, 3]
    reach = np.einsum("nij,nj->ni", np.abs(rotation), half)
    return np.stack([middle - reach, middle + reach], axis=1)
