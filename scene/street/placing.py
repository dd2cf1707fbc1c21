"""Assets that stand in a street."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from scene.assets import catalogue
from scene.classes import TrainId
from scene.ground.extent import GROUND_START, STRIP_END
from scene.ground.ground import Ground, ground_height
from scene.ground.path import (
    STRAIGHT,
    Path,
    heading_at,
    height_at,
    nearest,
    place_at,
    slope_at,
    to_world,
)
from scene.street.camera import DRIVE, SEARCH
from scene.street.room import own_rectangle

FAR = 35.0
"""Metres from every camera beyond which trees have fewer, larger leaves and twigs."""
FIRST_INSTANCE = 4
"""Instances 1-3 are road, sidewalk and terrain (see ``ground/build.py``); 0 is the sky."""
LAID = frozenset({"slab", "land", "paving"})
"""Families that lie on the ground: one may drive over them."""

TILTED = frozenset(
    {
        *("car", "bus", "truck", "train", "bicycle", "motorcycle", "rider"),
        *("fence", "wall", "slab", "land", "paving"),
    }
)
"""Families that lean with the slope of the road; all else stands upright."""
MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])
"""Swaps left and right in an asset's own frame."""
CLEAR = 1.5
"""Metres that a house may come nearer to the road than its front, before it is left out."""

Standing = tuple[str, int | str, np.ndarray]
"""An asset and its pose: family, index or name, f64[4, 4]."""


class Placement(NamedTuple):
    """One asset standing in the street."""

    family: str
    asset: int | str  # index in its family, or what ``library.scan`` calls a user's own
    train_id: int
    instance: int
    pose: np.ndarray  # f64[4, 4] asset frame -> world; of some buses with a reflection
    far: bool = False  # no camera comes near: fewer, larger leaves will do


def placed(
    objects: Iterable[Standing], first: int = FIRST_INSTANCE, path: Path = STRAIGHT
) -> list[Placement]:
    """Objects under instance ids from ``first`` on; the camera drives along ``path``."""
    found = []
    drive = to_world(path, np.arange(0.0, DRIVE + SEARCH, 5.0), 0.0)
    for instance, (family, ref, pose) in enumerate(objects, first):
        train_id = int(catalogue.FAMILIES[family].train_id)
        far = train_id == TrainId.VEGETATION and _away(path, drive, pose)
        found.append(Placement(family, ref, train_id, instance, pose, far))
    return found


def _away(path: Path, drive: np.ndarray, pose: np.ndarray) -> bool:
    """Whether an object is ``FAR`` from the places f64[n, 2] where the camera drives."""
    if path.straight:
        return bool(pose[0, 3] > DRIVE + SEARCH + FAR or abs(pose[1, 3]) > FAR)
    return bool(np.hypot(*(drive - pose[:2, 3]).T).min() > FAR)


def pose_at(ground: Ground, x: float, y: float, yaw: float) -> np.ndarray:
    """Pose f64[4, 4] in the world of an object that stands upright on the ground at (x, y) of the road.

    Args:
        ground: of the street.
        x: metres along the road.
        y: metres left of its centre line.
        yaw: radians left of the road's direction there.
    """
    if ground.path.straight:
        z = ground_height(ground, y, x)
    else:
        place = place_at(ground.path, x, y)
        z = ground_height(ground, y, x, place)
        x, y, yaw = place.east, place.north, yaw + place.heading
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1]])


def doors_at_the_kerb(objects: list[Standing], drive: float) -> list[Standing]:
    """Objects with buses mirrored where traffic keeps left (``drive`` 1): their doors are on the right.

    A user's own buses stay as they are.
    """
    if drive < 0:
        return objects
    return [
        (family, ref, pose @ MIRROR if family == "bus" and isinstance(ref, int) else pose)
        for family, ref, pose in objects
    ]


def settled(ground: Ground, objects: list[Standing], front: float = 0.0) -> list[Standing]:
    """Objects as they stand on a road that bends and slopes.

    What drives leans with the slope; houses go down to the lowest ground below their corners, and are
    left out where in a bend they would reach across the road.

    Args:
        ground: of the street.
        objects: upright, see ``pose_at``.
        front: metres from the centre line to the facades.
    """
    if ground.path.straight:
        return objects
    path = ground.path
    at = np.array([pose[:2, 3] for _, _, pose in objects]).reshape(-1, 2)
    corners = footprints(objects)
    own, _ = nearest(path, at, GROUND_START, STRIP_END)
    x, away = nearest(path, corners.reshape(-1, 2), GROUND_START, STRIP_END)
    across = away.reshape(-1, 4).min(axis=1) < front - CLEAR
    sunk = np.minimum(height_at(path, x).reshape(-1, 4).min(axis=1) - height_at(path, own), 0.0)
    # Parts of one object share their pose.
    tilted = {id(pose): k for k, (family, _, pose) in enumerate(objects) if family in TILTED}
    leaning = _leaning(path, [objects[k][2] for k in tilted.values()], own[[*tilted.values()]])
    poses = dict(zip(tilted, leaning, strict=True))
    found: list[Standing] = []
    for k, (family, ref, pose) in enumerate(objects):
        if family == "building" and across[k]:
            continue
        stands = pose
        if family in TILTED:
            stands = poses[id(pose)]
        elif family == "building":
            stands = pose.copy()
            stands[2, 3] += sunk[k]
        found.append((family, ref, stands))
    return found


def footprints(objects: list[Standing]) -> np.ndarray:
    """Corners f64[n, 4, 2] in the world of the rectangles that objects stand on."""
    if not objects:
        return np.zeros((0, 4, 2))
    own = np.stack([catalogue.bounds(family, ref)[:, :2] for family, ref, _ in objects])
    poses = np.stack([pose for _, _, pose in objects])
    low, high = own[:, 0], own[:, 1]
    corners = np.stack([low, np.stack([high[:, 0], low[:, 1]], 1), high,
                        np.stack([low[:, 0], high[:, 1]], 1)], axis=1)  # fmt: skip
    return np.einsum("nij,nkj->nki", poses[:, :2, :2], corners) + poses[:, None, :2, 3]


def _leaning(path: Path, poses: list[np.ndarray], x: np.ndarray) -> np.ndarray:
    """Poses f64[n, 4, 4] turned by the slope of the road ``x`` f64[n] metres along it."""
    if not poses:
        return np.zeros((0, 4, 4))
    rise = [math.atan(slope) for slope in slope_at(path, x).tolist()]
    headings = heading_at(path, x).tolist()
    cross = np.zeros((len(poses), 3, 3))
    # Rodrigues: by ``rise`` about the axis to the right of the road, so that what lies ahead goes up.
    cross[:, 0, 2] = [math.cos(heading) for heading in headings]
    cross[:, 1, 2] = [math.sin(heading) for heading in headings]
    cross[:, 2, :2] = -cross[:, :2, 2]
    s, c = (np.array([f(angle) for angle in rise])[:, None, None] for f in (math.sin, math.cos))
    leaning = np.stack(poses)
    leaning[:, :3, :3] = (np.eye(3) - s * cross + (1 - c) * cross @ cross) @ leaning[:, :3, :3]
    return leaning


def bounds(placements: list[Placement]) -> np.ndarray:
    """World axis-aligned boxes f64[placements, 2, 3] (low, high corner)."""
    if not placements:
        return np.zeros((0, 2, 3))
    own = np.stack([catalogue.bounds(p.family, p.asset) for p in placements])
    poses = np.stack([p.pose for p in placements])
    centre, half = own.mean(axis=1), (own[:, 1] - own[:, 0]) / 2
    rotation = poses[:, :3, :3]
    middle = np.einsum("nij,nj->ni", rotation, centre) + poses[:, :3, 3]
    reach = np.einsum("nij,nj->ni", np.abs(rotation), half)
    return np.stack([middle - reach, middle + reach], axis=1)


def taken(placements: list[Placement]) -> np.ndarray:
    """What placements take of the ground, f64[n, 6] rows as ``Rectangle``, but for what is driven over."""
    solid = [p for p in placements if p.family not in LAID]
    if not solid:
        return np.zeros((0, 6))
    own = np.array([own_rectangle(p.family, p.asset) for p in solid])
    poses = np.array([p.pose[:2] for p in solid])
    middle = np.einsum("nij,nj->ni", poses[:, :, :2], own[:, :2]) + poses[:, :, 3]
    ahead = poses[:, :, 0] / np.hypot(*poses[:, :, 0].T)[:, None]
    return np.concatenate([middle, ahead, own[:, 2:]], axis=1)
