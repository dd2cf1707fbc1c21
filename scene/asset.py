"""What an asset is, and the solids that asset families are put together from.

An asset lives in its own frame: x forward (the way the car drives), y left, z up, metres, standing on
z = 0. Colours are linear RGB in [0, 1], one per face, as is the material (see ``materials.py``).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import trimesh

from scene.materials import material_id

Color = tuple[float, float, float]
Point = tuple[float, float, float]


class Asset(NamedTuple):
    """A mesh with a colour and a material on each face."""

    mesh: trimesh.Trimesh
    color: np.ndarray  # f32[faces, 3] linear RGB
    material: np.ndarray  # u8[faces] index into MATERIALS


def solid(vertices: np.ndarray, faces: np.ndarray, color: Color, material: str) -> Asset:
    """An asset of one colour and material from vertices [v, 3] and triangles [f, 3]."""
    faces = np.asarray(faces, np.int64).reshape(-1, 3)
    mesh = trimesh.Trimesh(np.asarray(vertices, np.float64), faces, process=False)
    return Asset(
        mesh,
        np.tile(np.asarray(color, np.float32), (len(faces), 1)),
        np.full(len(faces), material_id(material), np.uint8),
    )


def merge(*parts: Asset) -> Asset:
    """One asset of all ``parts``, in order."""
    offsets = np.cumsum([0] + [len(p.mesh.vertices) for p in parts[:-1]])
    mesh = trimesh.Trimesh(
        np.concatenate([p.mesh.vertices for p in parts]),
        np.concatenate([p.mesh.faces + o for p, o in zip(parts, offsets, strict=True)]),
        process=False,
    )
    color = np.concatenate([p.color for p in parts])
    return Asset(mesh, color, np.concatenate([p.material for p in parts]))


def transform(asset: Asset, matrix: np.ndarray) -> Asset:
    """The asset moved by a 4x4 matrix."""
    vertices = asset.mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return asset._replace(mesh=trimesh.Trimesh(vertices, asset.mesh.faces, process=False))


def translate(asset: Asset, offset: Point) -> Asset:
    """The asset moved by ``offset`` metres."""
    return transform(asset, trimesh.transformations.translation_matrix(offset))


def rotate(asset: Asset, angle: float, axis: Point, about: Point = (0, 0, 0)) -> Asset:
    """The asset turned by ``angle`` radians about the line through ``about`` along ``axis``."""
    return transform(asset, trimesh.transformations.rotation_matrix(angle, axis, about))


def box(size: Point, base: Point, color: Color, material: str = "plain") -> Asset:
    """A box of ``size`` (x, y, z) whose bottom face is centred on ``base``; 12 faces."""
    x, y, z = np.asarray(size) / 2
    corners = np.array([[i, j, k] for i in (-x, x) for j in (-y, y) for k in (0, 2 * z)])
    faces = [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]  # fmt: skip
    return solid(corners + np.asarray(base), np.array(faces), color, material)


def block(low: Point, high: Point, color: Color, material: str = "plain") -> Asset:
    """The box with opposite corners ``low`` and ``high``; 12 faces."""
    x, y, z = ((a + b) / 2 for a, b in zip(low, high, strict=True))
    size = (high[0] - low[0], high[1] - low[1], high[2] - low[2])
    return box(size, (x, y, z - size[2] / 2), color, material)


def quad(corners: list[Point] | np.ndarray, color: Color, material: str = "plain") -> Asset:
    """A flat four-cornered face, corners in order around its edge; 2 faces."""
    return solid(np.asarray(corners), np.array([[0, 1, 2], [0, 2, 3]]), color, material)


def tube(
    start: Point,
    end: Point,
    radius: float,
    color: Color,
    material: str = "plain",
    *,
    end_radius: float | None = None,
    sides: int = 6,
    caps: bool = True,
) -> Asset:
    """A cylinder or cone frustum from ``start`` to ``end``; 2 faces per side, 2 more with caps."""
    start_, end_ = np.asarray(start, float), np.asarray(end, float)
    axis = end_ - start_
    axis /= np.linalg.norm(axis)
    helper = np.array([1.0, 0, 0]) if abs(axis[2]) > 0.9 else np.array([0, 0, 1.0])
    u = np.cross(axis, helper)
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    angle = np.arange(sides) * 2 * np.pi / sides
    ring = np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v
    top = radius if end_radius is None else end_radius
    vertices = np.concatenate([start_ + radius * ring, end_ + top * ring, [start_, end_]])
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = [np.stack([i, j, j + sides], 1), np.stack([i, j + sides, i + sides], 1)]
    if caps:
        faces += [
            np.stack([np.full(sides, 2 * sides), j, i], 1),
            np.stack([np.full(sides, 2 * sides + 1), i + sides, j + sides], 1),
        ]
    return solid(vertices, np.concatenate(faces), color, material)


def extrude(
    profile: list[tuple[float, float]] | np.ndarray,
    width: float,
    color: Color,
    material: str = "plain",
    *,
    top_width: float | None = None,
) -> Asset:
    """Extrude a star-shaped x-z outline along y, centred on y = 0.

    With ``top_width`` the body narrows linearly from ``width`` at the lowest point of the outline to
    ``top_width`` at its highest (the tumblehome of a car).
    """
    outline = np.asarray(profile, float)
    low, high = outline[:, 1].min(), outline[:, 1].max()
    share = (outline[:, 1] - low) / max(high - low, 1e-9)
    half = (width + ((width if top_width is None else top_width) - width) * share) / 2
    n = len(outline)
    left = np.column_stack([outline[:, 0], half, outline[:, 1]])
    right = left * [1, -1, 1]
    vertices = np.concatenate([left, right, [left.mean(0)], [right.mean(0)]])
    i = np.arange(n)
    j = (i + 1) % n
    faces = np.concatenate(
        [
            np.stack([i, j, j + n], 1),
            np.stack([i, j + n, i + n], 1),
            np.stack([i, j, np.full(n, 2 * n)], 1),
            np.stack([j + n, i + n, np.full(n, 2 * n + 1)], 1),
        ]
    )
    return solid(vertices, faces, color, material)


def ellipsoid(
    centre: Point, radii: Point, color: Color, material: str = "plain", *, subdivisions: int = 1
) -> Asset:
    """An ellipsoid; 20 faces at 0 subdivisions, 80 at 1."""
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions)
    vertices = np.asarray(sphere.vertices) * np.asarray(radii) + np.asarray(centre)
    return solid(vertices, sphere.faces, color, material)


def ring(
    centre: Point,
    radius: float,
    thickness: float,
    color: Color,
    material: str = "rubber",
    *,
    sides: int = 12,
) -> Asset:
    """An open hoop standing in the x-z plane (a bicycle tyre), square in section; 8 faces a side."""
    angle = np.arange(sides) * 2 * np.pi / sides
    circle = np.column_stack([np.cos(angle), np.zeros(sides), np.sin(angle)])
    half = thickness / 2
    rings = [
        circle * (radius + dr) + [0, dy, 0]
        for dr, dy in ((half, -half), (half, half), (-half, half), (-half, -half))
    ]
    vertices = np.concatenate(rings) + np.asarray(centre)
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = []
    for k in range(4):
        a, b = k * sides, ((k + 1) % 4) * sides
        faces += [np.stack([i + a, j + b, j + a], 1), np.stack([i + a, i + b, j + b], 1)]
    return solid(vertices, np.concatenate(faces), color, material)


def disc(
    centre: Point,
    radius: float,
    color: Color,
    material: str = "plain",
    *,
    axis: Point = (-1, 0, 0),
    sides: int = 12,
) -> Asset:
    """A flat disc facing ``axis`` (a sign face); one face per side."""
    normal = np.asarray(axis, float)
    thin = 1e-4 * normal / np.linalg.norm(normal)
    flat = tube(
        tuple(np.asarray(centre) - thin), tuple(np.asarray(centre)), radius, color, material,
        sides=sides,
    )  # fmt: skip
    keep = slice(3 * sides, 4 * sides)
    mesh = trimesh.Trimesh(flat.mesh.vertices, flat.mesh.faces[keep], process=False)
    return Asset(mesh, flat.color[keep], flat.material[keep])


def polygon(corners: list[Point] | np.ndarray, color: Color, material: str = "plain") -> Asset:
    """A flat convex face of n corners in order around its edge; n - 2 faces."""
    last = np.arange(2, len(corners))
    faces = np.column_stack([np.zeros_like(last), last - 1, last])
    return solid(np.asarray(corners), faces, color, material)


def loft(
    rings: list[np.ndarray] | np.ndarray,
    color: Color,
    material: str = "plain",
    *,
    closed: bool = True,
    caps: bool = True,
) -> Asset:
    """A skin over cross-sections [rings, points, 3]; faces without area are left out.

    Each section is a convex loop, or with ``closed=False`` an open line; ``caps`` fill the ends.
    """
    sections = np.asarray(rings, float)
    count, points = sections.shape[:2]
    i = np.arange(points if closed else points - 1)
    first = points * np.arange(count - 1)[:, None]
    a, b = first + i, first + (i + 1) % points
    faces = [np.stack([a, b, b + points, a, b + points, a + points], -1).reshape(-1, 3)]
    if caps:
        k = np.arange(1, points - 1)
        fan = np.column_stack([np.zeros_like(k), k, k + 1])
        faces += [fan[:, ::-1], fan + points * (count - 1)]
    vertices = sections.reshape(-1, 3)
    triangles = np.concatenate(faces)
    p, q, r = (vertices[triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(q - p, r - p), axis=1) / 2
    return solid(vertices, triangles[area > 1e-9], color, material)


def recolor(asset: Asset, color: Color) -> Asset:
    """The asset with every face in one colour."""
    return asset._replace(color=np.tile(np.asarray(color, np.float32), (len(asset.color), 1)))


def repaint(asset: Asset, faces: np.ndarray, color: Color, material: str) -> Asset:
    """The asset with the chosen ``faces`` (mask or indexes) in another colour and material."""
    colors, materials = asset.color.copy(), asset.material.copy()
    colors[faces] = color
    materials[faces] = material_id(material)
    return asset._replace(color=colors, material=materials)


def triangles(corners: np.ndarray, color: Color, material: str = "plain") -> Asset:
    """Loose triangles from corners [n, 3, 3] (leaves, twigs, wires)."""
    vertices = np.asarray(corners, float).reshape(-1, 3)
    return solid(vertices, np.arange(len(vertices)), color, material)


def shade(asset: Asset, factor: np.ndarray) -> Asset:
    """The asset with each face's colour multiplied by ``factor`` [faces], kept within [0, 1]."""
    color = np.clip(asset.color * np.asarray(factor)[:, None], 0, 1)
    return asset._replace(color=color.astype(np.float32))


def vary(rng: np.random.Generator, color: Color, amount: float = 0.15) -> Color:
    """A colour near ``color``: brightness off by up to ``amount``, hue by a quarter of that."""
    factor = rng.uniform(1 - amount, 1 + amount) * rng.uniform(1 - amount / 4, 1 + amount / 4, 3)
    red, green, blue = np.clip(np.asarray(color) * factor, 0, 1)
    return float(red), float(green), float(blue)
