"""A street as flat arrays: the mesh and material data that every renderer reads."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from scene import catalogue
from scene.asset import Asset
from scene.classes import TrainId
from scene.ground import GROUND_INSTANCES, ground_assets
from scene.street import FIRST_INSTANCE, Street

SKY_INSTANCE = 0


class Geometry(NamedTuple):
    """Triangles of a whole street, in world metres."""

    vertices: np.ndarray  # f32[v, 3]
    faces: np.ndarray  # i32[f, 3]
    normal: np.ndarray  # f32[f, 3] unit
    color: np.ndarray  # f32[f, 3] linear RGB albedo
    material: np.ndarray  # u8[f] index into MATERIALS
    instance: np.ndarray  # u16[f]
    train_id: np.ndarray  # u8[instances]: instance id -> train id; instance 0 is the sky


class _Arrays(NamedTuple):
    """One asset, ready to be placed."""

    vertices: np.ndarray
    faces: np.ndarray
    normal: np.ndarray
    color: np.ndarray
    material: np.ndarray


def _arrays(asset: Asset) -> _Arrays:
    vertices = np.asarray(asset.mesh.vertices, np.float32)
    faces = np.asarray(asset.mesh.faces, np.int32)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    return _Arrays(vertices, faces, normal, asset.color.astype(np.float32), asset.material)


@lru_cache(maxsize=4096)
def _asset_arrays(family: str, index: int) -> _Arrays:
    return _arrays(catalogue.asset(family, index))


def build(street: Street) -> Geometry:
    """Merge a street's ground and placements into one set of triangles."""
    train_id = np.zeros(FIRST_INSTANCE + len(street.placements), np.uint8)
    train_id[SKY_INSTANCE] = TrainId.SKY
    parts, instances = [], []
    for instance, asset in ground_assets(street.ground).items():
        parts.append(_arrays(asset))
        instances.append(instance)
        train_id[instance] = GROUND_INSTANCES[instance]
    for placement in street.placements:
        own = _asset_arrays(placement.family, placement.asset)
        rotation = placement.pose[:3, :3].astype(np.float32)
        offset = placement.pose[:3, 3].astype(np.float32)
        parts.append(
            own._replace(
                vertices=own.vertices @ rotation.T + offset, normal=own.normal @ rotation.T
            )
        )
        instances.append(placement.instance)
        train_id[placement.instance] = placement.train_id
    starts = np.cumsum([0] + [len(p.vertices) for p in parts[:-1]]).astype(np.int32)
    return Geometry(
        vertices=np.concatenate([p.vertices for p in parts]),
        faces=np.concatenate([p.faces + s for p, s in zip(parts, starts, strict=True)]),
        normal=np.concatenate([p.normal for p in parts]),
        color=np.concatenate([p.color for p in parts]),
        material=np.concatenate([p.material for p in parts]),
        instance=np.repeat(np.array(instances, np.uint16), [len(p.faces) for p in parts]),
        train_id=train_id,
    )
