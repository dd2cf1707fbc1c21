"""A street as flat arrays: every distinct mesh once, and where each instance of it stands.

Nothing is copied per instance: a renderer that knows instancing pays for an asset's triangles once,
and ``world`` merges them for one that does not.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit

from scene import catalogue
from scene.asset import Asset
from scene.classes import TrainId
from scene.ground import GROUND_INSTANCES, ground_assets
from scene.street import FIRST_INSTANCE, Placement, Street

SKY_INSTANCE = 0
CREASE = 40.0
"""Degrees between faces below which the surface is shaded as a curved one."""


class Shape(NamedTuple):
    """One mesh, ready to be placed; metres in its own frame."""

    vertices: np.ndarray  # f32[v, 3]
    faces: np.ndarray  # i32[f, 3]
    normal: np.ndarray  # f32[f, 3] unit, of the flat face
    corners: np.ndarray  # f32[f, 3, 3] unit, at each corner, smoothed where no edge is
    color: np.ndarray  # f32[f, 3] linear RGB albedo
    material: np.ndarray  # u8[f] index into MATERIALS


class Geometry(NamedTuple):
    """Triangles of a whole street; every distinct shape is there once."""

    vertices: np.ndarray  # f32[v, 3] in the frame of their shape
    faces: np.ndarray  # i32[f, 3]
    normal: np.ndarray  # f32[f, 3] unit, of the flat face
    corners: np.ndarray  # f32[f, 3, 3] unit, smoothed
    color: np.ndarray  # f32[f, 3] linear RGB albedo
    material: np.ndarray  # u8[f] index into MATERIALS
    first: np.ndarray  # i32[instances] first face of an instance's shape; of the sky: 0
    count: np.ndarray  # i32[instances] faces of an instance's shape; of the sky: 0
    pose: np.ndarray  # f32[instances, 3, 4] shape -> world
    train_id: np.ndarray  # u8[instances]; instance 0 is the sky

    @property
    def triangles(self) -> int:
        """Triangles that stand in the street, every instance counted."""
        return int(self.count.sum())


def shape_of(asset: Asset) -> Shape:
    """The arrays of an asset."""
    vertices = np.ascontiguousarray(asset.mesh.vertices, np.float32)
    faces = np.ascontiguousarray(asset.mesh.faces, np.int32)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    length = np.linalg.norm(area, axis=1, keepdims=True)
    normal = np.divide(area, length, out=np.zeros_like(area), where=length > 0)
    # Solids are merged part by part: corners that touch are found by their place.
    _, place = np.unique(np.round(vertices, 4), axis=0, return_inverse=True)
    order = np.argsort(place.ravel()[faces.ravel()], kind="stable")
    corners = np.empty((len(faces), 3, 3), np.float32)
    _smooth(place.ravel()[faces.ravel()], order, area, normal, np.cos(np.radians(CREASE)), corners)
    return Shape(vertices, faces, normal, corners, asset.color.astype(np.float32), asset.material)


@njit(cache=True)
def _smooth(
    place: np.ndarray,
    order: np.ndarray,
    area: np.ndarray,
    normal: np.ndarray,
    least: float,
    corners: np.ndarray,
) -> None:
    """Mean over the faces around each corner that bend less than the crease, by their area.

    Faces may be wound either way: a normal counts in the direction that agrees.
    """
    begin = 0
    while begin < len(order):
        end = begin
        while end < len(order) and place[order[end]] == place[order[begin]]:
            end += 1
        for i in range(begin, end):
            face, corner = order[i] // 3, order[i] % 3
            x, y, z = area[face, 0], area[face, 1], area[face, 2]
            for j in range(begin, end):
                other = order[j] // 3
                if other == face:
                    continue
                dot = (
                    normal[face, 0] * normal[other, 0]
                    + normal[face, 1] * normal[other, 1]
                    + normal[face, 2] * normal[other, 2]
                )
                if abs(dot) > least:
                    sign = 1.0 if dot > 0 else -1.0
                    x += sign * area[other, 0]
                    y += sign * area[other, 1]
                    z += sign * area[other, 2]
            length = max((x * x + y * y + z * z) ** 0.5, 1e-20)
            corners[face, corner, 0] = x / length
            corners[face, corner, 1] = y / length
            corners[face, corner, 2] = z / length
        begin = end


@lru_cache(maxsize=2048)
def asset_shape(family: str, asset: int) -> Shape:
    """The shape of a catalogue asset."""
    return shape_of(catalogue.asset(family, asset))


def build(street: Street) -> Geometry:
    """Collect a street's shapes and poses."""
    ground = {i: shape_of(asset) for i, asset in ground_assets(street.ground).items()}
    instances = FIRST_INSTANCE + len(street.placements)
    first, count = np.zeros(instances, np.int32), np.zeros(instances, np.int32)
    pose = np.zeros((instances, 3, 4), np.float32)
    pose[:FIRST_INSTANCE] = np.eye(3, 4)
    train_id = np.zeros(instances, np.uint8)
    train_id[SKY_INSTANCE] = TrainId.SKY
    shapes: list[Shape] = []
    starts: dict[tuple[str, int], int] = {}
    faces = 0

    def add(shape: Shape) -> int:
        nonlocal faces
        shapes.append(shape)
        faces += len(shape.faces)
        return faces - len(shape.faces)

    for instance, shape in ground.items():
        first[instance], count[instance] = add(shape), len(shape.faces)
        train_id[instance] = GROUND_INSTANCES[instance]
    for placement in street.placements:
        shape, key = asset_shape(*_key(placement)), _key(placement)
        if key not in starts:
            starts[key] = add(shape)
        first[placement.instance], count[placement.instance] = starts[key], len(shape.faces)
        pose[placement.instance] = placement.pose[:3]
        train_id[placement.instance] = placement.train_id
    vertices = np.cumsum([0] + [len(s.vertices) for s in shapes[:-1]]).astype(np.int32)
    return Geometry(
        vertices=np.concatenate([s.vertices for s in shapes]),
        faces=np.concatenate([s.faces + v for s, v in zip(shapes, vertices, strict=True)]),
        normal=np.concatenate([s.normal for s in shapes]),
        corners=np.concatenate([s.corners for s in shapes]),
        color=np.concatenate([s.color for s in shapes]),
        material=np.concatenate([s.material for s in shapes]),
        first=first,
        count=count,
        pose=pose,
        train_id=train_id,
    )


def _key(placement: Placement) -> tuple[str, int]:
    return placement.family, placement.asset


class World(NamedTuple):
    """All instances merged, in world metres."""

    vertices: np.ndarray  # f32[corners, 3], three for each face
    instance: np.ndarray  # i32[f]
    face: np.ndarray  # i32[f] index into the faces of the geometry


def world(geometry: Geometry) -> World:
    """Merge every instance's triangles, for renderers without instancing."""
    instance = np.repeat(np.arange(len(geometry.count), dtype=np.int32), geometry.count)
    starts = np.cumsum(geometry.count) - geometry.count
    face = np.arange(len(instance), dtype=np.int32) + (geometry.first - starts)[instance].astype(
        np.int32
    )
    vertices = np.empty((len(face), 3, 3), np.float32)
    _place(geometry.vertices, geometry.faces, geometry.pose, instance, face, vertices)
    return World(vertices.reshape(-1, 3), instance, face)


@njit(cache=True)
def _place(
    vertices: np.ndarray,
    faces: np.ndarray,
    pose: np.ndarray,
    instance: np.ndarray,
    face: np.ndarray,
    out: np.ndarray,
) -> None:
    for i in range(len(face)):
        m = pose[instance[i]]
        for k in range(3):
            v = vertices[faces[face[i], k]]
            for a in range(3):
                out[i, k, a] = m[a, 0] * v[0] + m[a, 1] * v[1] + m[a, 2] * v[2] + m[a, 3]
