"""Every asset family, and the way from (family, index) to a mesh.

The catalogue is open-ended: any index gives an asset, its kind ``index % len(kinds)``, the rest drawn
from a generator seeded by family and index, so the same (family, index) is the same asset anywhere. A
user's own assets stand beside them, named by the path of their file.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import PurePath
from typing import Any, NamedTuple

import numpy as np

from scene.assets import (
    bicycle,
    building,
    bus,
    bush,
    car,
    fence,
    lamp,
    library,
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
from scene.assets.redrawn import REDRAWN
from scene.classes import CLASS_NAMES, TrainId
from scene.look.surfaces import ROADS, SIDEWALKS, TERRAINS
from scene.mesh.asset import Asset
from scene.sky.weather import SKIES


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

USES = ("both", "own", "built-in")
"""Values of ``AssetPool.use``."""


class AssetPool(NamedTuple):
    """The assets a street may draw from: consecutive indices of every family, and a user's own."""

    first: int = 0
    size: int | None = None  # built-in ones of every family; None: as many as ``COUNTS`` says
    fraction: float = 1.0  # share that is used, of built-in and own ones (the half-asset study)
    own: str = ""  # folder of own assets, see ``library``
    use: str = "both"  # which ones: "both", "own" or "built-in"


def check_pool(pool: AssetPool, named: str = "asset ") -> AssetPool:
    """The pool itself.

    Args:
        pool: the pool.
        named: how the names of its fields begin in errors; on a command line, ``--asset-``.

    Raises:
        ValueError: a field out of range, by name.
        LibraryError: the folder of own assets is wanted and not named, or cannot be used; see ``library``.
    """
    if pool.use not in USES:
        raise ValueError(f"{named}use {pool.use!r} is unknown; known: {', '.join(USES)}")
    if not 0 < pool.fraction <= 1:
        raise ValueError(f"{named}fraction must lie in (0, 1], not {pool.fraction}")
    if pool.first < 0:
        raise ValueError(f"the first asset must be 0 or more, not {pool.first}")
    if pool.size is not None and pool.size < 1:
        raise ValueError(f"{named}count must be 1 or more, not {pool.size}")
    if pool.use == "own" and not pool.own:
        raise library.LibraryError(f"{named}use 'own' needs a folder of own assets")
    if pool.own:
        library.check(pool.own)
    return pool


def pick(pool: AssetPool, family: str, rng: np.random.Generator) -> int | str | None:
    """Draw one asset of ``family``: an index, or the path of an own one; None where there is none.

    With both in use, every asset is as likely as any other. Always takes one number from ``rng``.
    """
    share = rng.random()
    size = COUNTS[family] if pool.size is None else pool.size
    count = 0 if pool.use == "own" else max(1, round(size * pool.fraction))
    own = own_assets(pool, family)
    if count + len(own) == 0:
        return None
    drawn = int(share * (count + len(own)))
    return pool.first + drawn if drawn < count else own[drawn - count]


def own_assets(pool: AssetPool, family: str) -> tuple[str, ...]:
    """Paths of the own assets that a pool offers for a family, in a fixed order."""
    if not pool.own or pool.use == "built-in":
        return ()
    found = library.scan(pool.own).get(family, ())
    return found[: max(1, round(len(found) * pool.fraction))]


def absent(pool: AssetPool) -> tuple[str, ...]:
    """Families of which a pool has no asset, so that their places in a street stay empty."""
    if pool.use != "own":
        return ()
    return tuple(family for family in FAMILIES if not own_assets(pool, family))


@lru_cache(maxsize=256)  # what is drawn often is kept by the renderers, as arrays
def asset(family: str, ref: int | str) -> Asset:
    """The built-in asset of a family with an index, or the own asset at a path.

    Files are read once in a process; what changes on disk later is not seen.

    Raises:
        ValueError: unknown family or negative index.
        LibraryError: the file cannot be used.
    """
    if family not in FAMILIES:
        raise ValueError(f"unknown asset family {family!r}; known: {', '.join(FAMILIES)}")
    if isinstance(ref, str):
        return library.load(family, ref)
    if ref < 0:
        raise ValueError(f"asset index of {family} must be 0 or more, not {ref}")
    return draw(family, ref, REDRAWN.get(family, {}).get(ref, 0))


def draw(family: str, index: int, redraws: int = 0) -> Asset:
    """An asset of a family and index, the first one or, after ``redraws``, a later one of its kind."""
    seed = [zlib.crc32(family.encode()), index]
    rng = np.random.default_rng([*seed, redraws] if redraws else seed)
    entry = FAMILIES[family]
    return entry.build(entry.sample(rng, kind(family, index)))


@lru_cache(maxsize=4096)
def bounds(family: str, ref: int | str) -> np.ndarray:
    """Low and high corner f64[2, 3] of an asset in its own frame (read-only)."""
    vertices = asset(family, ref).mesh.vertices
    corners = np.stack([vertices.min(axis=0), vertices.max(axis=0)])
    corners.setflags(write=False)
    return corners


def kind(family: str, ref: int | str) -> str:
    """The kind of a built-in asset, or the file name of an own one."""
    if isinstance(ref, str):
        return PurePath(ref).name
    kinds = FAMILIES[family].kinds
    return kinds[ref % len(kinds)]


def families_of(name: str) -> tuple[str, ...]:
    """The families of a class, or the one family called ``name``.

    Raises:
        ValueError: neither a class with assets nor a family.
    """
    found = tuple(f for f, row in FAMILIES.items() if CLASS_NAMES[row.train_id] == name)
    if not found and name not in FAMILIES:
        known = dict.fromkeys([CLASS_NAMES[row.train_id] for row in FAMILIES.values()])
        raise ValueError(
            f"no assets of class {name!r}; known: {', '.join(known | dict.fromkeys(FAMILIES))}"
        )
    return found or (name,)


def surfaces() -> dict[str, tuple[str, ...]]:
    """Names of what covers the ground and the sky, by class."""
    return {
        "road": tuple(row.name for row in ROADS),
        "sidewalk": tuple(row.name for row in SIDEWALKS),
        "terrain": tuple(row.name for row in TERRAINS),
        "sky": tuple(row.name for row in SKIES),
    }
