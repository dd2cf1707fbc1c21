"""Every asset family, and the way from (family, index) to a mesh.

The catalogue is open-ended: any index gives an asset, its kind ``index % len(kinds)``, the rest drawn
from a generator seeded by family and index, so the same (family, index) is the same asset anywhere.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from scene.asset import Asset
from scene.assets import (
    bicycle,
    building,
    bus,
    bush,
    car,
    fence,
    lamp,
    motorcycle,
    person,
    rider,
    signpost,
    traffic_light,
    traffic_sign,
    train,
    tree,
    truck,
    wall,
)
from scene.classes import TrainId


class Family(NamedTuple):
    """One asset family: its class, its kinds and its two functions."""

    train_id: TrainId
    kinds: tuple[str, ...]
    sample: Callable[[np.random.Generator, str], Any]  # (rng, kind) -> params
    build: Callable[[Any], Asset]  # params -> asset, pure


FAMILIES: dict[str, Family] = {
    "building": Family(
        TrainId.BUILDING, building.KINDS, building.sample_building, building.building
    ),
    "train": Family(TrainId.TRAIN, train.KINDS, train.sample_train, train.train),
    "fence": Family(TrainId.FENCE, fence.KINDS, fence.sample_fence, fence.fence),
    "wall": Family(TrainId.WALL, wall.KINDS, wall.sample_wall, wall.wall),
    "tree": Family(TrainId.VEGETATION, tree.KINDS, tree.sample_tree, tree.tree),
    "bush": Family(TrainId.VEGETATION, bush.KINDS, bush.sample_bush, bush.bush),
    "bicycle": Family(TrainId.BICYCLE, bicycle.KINDS, bicycle.sample_bicycle, bicycle.bicycle),
    "motorcycle": Family(
        TrainId.MOTORCYCLE, motorcycle.KINDS, motorcycle.sample_motorcycle, motorcycle.motorcycle
    ),
    "person": Family(TrainId.PERSON, person.KINDS, person.sample_person, person.person),
    "rider": Family(TrainId.RIDER, rider.KINDS, rider.sample_rider, rider.rider),
    "lamp": Family(TrainId.POLE, lamp.KINDS, lamp.sample_lamp, lamp.lamp),
    "signpost": Family(TrainId.POLE, signpost.KINDS, signpost.sample_signpost, signpost.signpost),
    "traffic sign": Family(
        TrainId.TRAFFIC_SIGN,
        traffic_sign.KINDS,
        traffic_sign.sample_traffic_sign,
        traffic_sign.traffic_sign,
    ),
    "traffic light": Family(
        TrainId.TRAFFIC_LIGHT,
        traffic_light.KINDS,
        traffic_light.sample_traffic_light,
        traffic_light.traffic_light,
    ),
    "car": Family(TrainId.CAR, car.KINDS, car.sample_car, car.car),
    "bus": Family(TrainId.BUS, bus.KINDS, bus.sample_bus, bus.bus),
    "truck": Family(TrainId.TRUCK, truck.KINDS, truck.sample_truck, truck.truck),
}


COUNTS: dict[str, int] = {
    "building": 106,
    "train": 8,
    "fence": 16,
    "wall": 16,
    "tree": 24,
    "bush": 16,
    "bicycle": 18,
    "motorcycle": 18,
    "person": 200,
    "rider": 30,
    "lamp": 16,
    "signpost": 16,
    "traffic sign": 40,
    "traffic light": 10,
    "car": 195,
    "bus": 28,
    "truck": 39,
}
"""Assets of the full catalogue; any larger index works, too."""


class AssetPool(NamedTuple):
    """The assets a street may draw from: consecutive indices of every family."""

    first: int = 0
    size: int | None = None  # of every family; None: as many as ``COUNTS`` says
    fraction: float = 1.0  # share of them that is used (the half-asset study)


def pick(pool: AssetPool, family: str, rng: np.random.Generator) -> int:
    """Draw the index of one asset of ``family``."""
    size = COUNTS[family] if pool.size is None else pool.size
    return pool.first + int(rng.integers(max(1, round(size * pool.fraction))))


@lru_cache(maxsize=4096)
def asset(family: str, index: int) -> Asset:
    """The ``index``-th asset of a family.

    Raises:
        ValueError: unknown family or negative index.
    """
    if family not in FAMILIES:
        raise ValueError(f"unknown asset family {family!r}; known: {', '.join(FAMILIES)}")
    if index < 0:
        raise ValueError(f"asset index of {family} must be 0 or more, not {index}")
    entry = FAMILIES[family]
    rng = np.random.default_rng([zlib.crc32(family.encode()), index])
    return entry.build(entry.sample(rng, entry.kinds[index % len(entry.kinds)]))


@lru_cache(maxsize=4096)
def bounds(family: str, index: int) -> np.ndarray:
    """Low and high corner f64[2, 3] of an asset in its own frame (read-only)."""
    vertices = asset(family, index).mesh.vertices
    corners = np.stack([vertices.min(axis=0), vertices.max(axis=0)])
    corners.setflags(write=False)
    return corners
