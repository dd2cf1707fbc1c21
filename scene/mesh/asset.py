"""Assets, and operations on them.

An asset has its own frame: x forward (the way the car drives), y left, z up, metres, standing on
z = 0. Colours are linear RGB in [0, 1], one per face, as is the material (see ``look/materials.py``).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from scene.look.materials import material_id
from scene.mesh.mesh import Mesh, unit

Color = tuple[float, float, float]
Point = tuple[float, float, float]


class Asset(NamedTuple):
    """A mesh with a colour and a material on each face."""

    mesh: Mesh
    color: np.ndarray  # f32[faces, 3] linear RGB
    material: np.ndarray  # u8[faces] index into MATERIALS
    ignored: np.ndarray | None = None  # bool[faces] ignored in labels; None: no face


Parts = Iterable[Asset]
"""Parts of one asset, in the order in which ``merge`` takes them."""


def solid(vertices: np.ndarray, faces: np.ndarray, color: Color, material: str) -> Asset:
    """An asset of one colour and material from vertices [v, 3] and triangles [f, 3]."""
    faces = np.ascontiguousarray(faces, np.int64).reshape(-1, 3)
    colors = np.empty((len(faces), 3), np.float32)
    colors[:] = color
    mesh = Mesh(np.ascontiguousarray(vertices, np.float64), faces)
    return Asset(mesh, colors, np.full(len(faces), material_id(material), np.uint8))


def merge(*parts: Asset) -> Asset:
    """Merge ``parts`` into one asset, in order."""
    meshes = [p.mesh for p in parts]
    sizes = [len(m.vertices) for m in meshes]
    first = np.cumsum([0, *sizes[:-1]]).repeat([len(m.faces) for m in meshes])
    ignored = None
    if any(p.ignored is not None for p in parts):
        ignored = np.concatenate(
            [np.zeros(len(p.color), bool) if p.ignored is None else p.ignored for p in parts]
        )
    return Asset(
        Mesh(
            np.concatenate([m.vertices for m in meshes]),
            np.concatenate([m.faces for m in meshes]) + first[:, None],
        ),
        np.concatenate([p.color for p in parts]),
        np.concatenate([p.material for p in parts]),
        ignored,
    )


def ignore(asset: Asset) -> Asset:
    """The asset with all its faces ignored in labels, for what its class does not include."""
    return asset._replace(ignored=np.ones(len(asset.color), bool))


def reshaped(asset: Asset, vertices: np.ndarray) -> Asset:
    """The asset with new ``vertices`` [v, 3]."""
    return asset._replace(mesh=Mesh(np.ascontiguousarray(vertices, np.float64), asset.mesh.faces))


def transform(asset: Asset, matrix: np.ndarray) -> Asset:
    """The asset moved by a 4x4 matrix."""
    return reshaped(asset, asset.mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3])


def translate(asset: Asset, offset: Point | np.ndarray) -> Asset:
    """The asset moved by ``offset`` metres."""
    return reshaped(asset, asset.mesh.vertices + offset)


def rotate(asset: Asset, angle: float, axis: Point, about: Point = (0, 0, 0)) -> Asset:
    """The asset turned by ``angle`` radians about the line through ``about`` along ``axis``."""
    x, y, z = along = unit(np.array(axis, float))
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sin, cos = np.sin(angle), np.cos(angle)
    matrix = np.eye(4)
    # The formula of Rodrigues.
    matrix[:3, :3] = np.diag([cos] * 3) + np.outer(along, along) * (1 - cos) + cross * sin
    matrix[:3, 3] = about - matrix[:3, :3] @ np.array(about, float)
    return transform(asset, matrix)


def repaint(asset: Asset, faces: np.ndarray, color: Color, material: str) -> Asset:
    """The asset with the chosen ``faces`` (mask or indexes) in another colour and material."""
    colors, materials = asset.color.copy(), asset.material.copy()
    colors[faces] = color
    materials[faces] = material_id(material)
    return asset._replace(color=colors, material=materials)


def shade(asset: Asset, factor: np.ndarray) -> Asset:
    """The asset with each face's colour multiplied by ``factor`` [faces], kept within [0, 1]."""
    color = np.clip(asset.color * np.asarray(factor)[:, None], 0, 1)
    return asset._replace(color=color.astype(np.float32))


def vary(rng: np.random.Generator, color: Color, amount: float = 0.15) -> Color:
    """A colour near ``color``: brightness off by up to ``amount``, hue by a quarter of that."""
    factor = rng.uniform(1 - amount, 1 + amount) * rng.uniform(1 - amount / 4, 1 + amount / 4, 3)
    red, green, blue = (np.array(color) * factor).clip(0, 1).tolist()
    return red, green, blue
