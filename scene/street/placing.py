"""Assets that stand in a street."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from scene.assets import catalogue
from scene.classes import TrainId
from scene.ground.ground import Ground, ground_height
from scene.street.camera import DRIVE, SEARCH

FAR = 35.0
"""Metres from every camera beyond which trees have fewer, larger leaves and twigs."""
FIRST_INSTANCE = 4
"""Instances 1-3 are road, sidewalk and terrain (see ``ground/build.py``); 0 is the sky."""
CROWN = 0.4
"""Share of a crown, from its middle, that is in the way of a lens: the rest is mostly air."""

Standing = tuple[str, int | str, np.ndarray]
"""An asset and its pose: family, index or path, f64[4, 4]."""


class Placement(NamedTuple):
    """One asset standing in the street."""

    family: str
    asset: int | str  # index of the asset in its family, or the path of a user's own
    train_id: int
    instance: int
    pose: np.ndarray  # f64[4, 4] asset frame -> world
    far: bool = False  # no camera comes near: fewer, larger leaves will do


def placed(objects: Iterable[Standing], first: int = FIRST_INSTANCE) -> list[Placement]:
    """Objects under instance ids from ``first`` on."""
    found = []
    for instance, (family, ref, pose) in enumerate(objects, first):
        train_id = int(catalogue.FAMILIES[family].train_id)
        x, y = pose[0, 3], abs(pose[1, 3])
        far = train_id == TrainId.VEGETATION and (x > DRIVE + SEARCH + FAR or y > FAR)
        found.append(Placement(family, ref, train_id, instance, pose, bool(far)))
    return found


def pose_at(ground: Ground, x: float, y: float, yaw: float) -> np.ndarray:
    """Pose f64[4, 4] of an object that stands on the ground at (x, y)."""
    c, s = math.cos(yaw), math.sin(yaw)
    z = ground_height(ground, y)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1]])


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


def obstacles(placements: list[Placement]) -> np.ndarray:
    """Boxes f64[placements, 2, 3] that a lens should keep out of."""
    boxes = bounds(placements)
    trees = np.array([p.train_id == TrainId.VEGETATION for p in placements], bool)
    centre = boxes.mean(axis=1, keepdims=True)
    boxes[trees] = centre[trees] + CROWN * (boxes[trees] - centre[trees])
    return boxes
