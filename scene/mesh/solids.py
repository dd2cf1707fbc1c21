"""The solids from which assets are built: metres, linear RGB, one material each."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from scene.look.materials import material_id
from scene.mesh.asset import Asset, Color, Point, solid
from scene.mesh.mesh import Mesh, circle, cross, frozen, icosphere, twice_areas, unit


def box(size: Point, base: Point, color: Color, material: str = "plain") -> Asset:
    """A box of ``size`` (x, y, z) whose bottom face is centred on ``base``; 12 faces."""
    x, y, z = (side / 2 for side in size)
    corners = np.array([[i, j, k] for i in (-x, x) for j in (-y, y) for k in (0, 2 * z)])
    return solid(corners + base, _BOX, color, material)


_BOX = np.array([
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
    [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
])  # fmt: skip


def block(low: Point, high: Point, color: Color, material: str = "plain") -> Asset:
    """The box with opposite corners ``low`` and ``high``; 12 faces."""
    x, y, z = ((a + b) / 2 for a, b in zip(low, high, strict=True))
    size = (high[0] - low[0], high[1] - low[1], high[2] - low[2])
    return box(size, (x, y, z - size[2] / 2), color, material)


def quads(corners: np.ndarray, colors: Sequence[Color], materials: Sequence[str]) -> Asset:
    """Flat four-cornered faces [n, 4, 3], each with a colour and a material; 2 faces each."""
    first = 4 * np.arange(len(corners))[:, None, None]
    return Asset(
        Mesh(np.reshape(corners, (-1, 3)).astype(float), (first + _fan(4)).reshape(-1, 3)),
        np.array(colors, np.float32).repeat(2, axis=0),
        np.array([material_id(m) for m in materials], np.uint8).repeat(2),
    )


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
    axis = unit(end_ - start_)
    u = unit(cross(axis, _X if abs(axis[2]) > 0.9 else _Z))
    cos, sin = circle(sides)
    ring = cos[:, None] * u + sin[:, None] * cross(axis, u)
    top = radius if end_radius is None else end_radius
    vertices = np.concatenate([start_ + radius * ring, end_ + top * ring, [start_, end_]])
    return solid(vertices, _tube_faces(sides, caps), color, material)


_X, _Z = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])


@lru_cache
def _tube_faces(sides: int, caps: bool) -> np.ndarray:
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = [np.stack([i, j, j + sides], 1), np.stack([i, j + sides, i + sides], 1)]
    if caps:
        faces += [
            np.stack([np.full(sides, 2 * sides), j, i], 1),
            np.stack([np.full(sides, 2 * sides + 1), i + sides, j + sides], 1),
        ]
    return frozen(np.concatenate(faces))


def extrude(
    profile: list[tuple[float, float]] | np.ndarray,
    width: float,
    color: Color,
    material: str = "plain",
) -> Asset:
    """Extrude a star-shaped x-z outline along y, centred on y = 0."""
    outline = np.asarray(profile, float)
    n = len(outline)
    half = np.full(n, width / 2)
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
    vertices, faces = icosphere(subdivisions)
    return solid(vertices * radii + centre, faces, color, material)


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
    mesh = Mesh(flat.mesh.vertices, flat.mesh.faces[keep])
    return Asset(mesh, flat.color[keep], flat.material[keep])


def polygon(corners: list[Point] | np.ndarray, color: Color, material: str = "plain") -> Asset:
    """A flat convex face of n corners in order around its edge; n - 2 faces."""
    return solid(np.asarray(corners), _fan(len(corners)), color, material)


@lru_cache
def _fan(corners: int) -> np.ndarray:
    last = np.arange(2, corners)
    return frozen(np.column_stack([np.zeros_like(last), last - 1, last]))


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
    vertices, faces = sections.reshape(-1, 3), loft_faces(count, points, closed, caps)
    return solid(vertices, faces[twice_areas(vertices, faces) > 2e-9], color, material)


def turned(
    stations: Sequence[tuple[float, float]],
    color: Color,
    material: str,
    sides: int = 10,
    *,
    at: tuple[float, float] = (0.0, 0.0),
    phase: float = 0.0,
) -> Asset:
    """A body of revolution around the upright at ``at`` (x, y).

    Args:
        stations: (z, radius) from one end to the other.
        color: linear RGB.
        material: name of its material.
        sides: corners of each ring.
        at: place of the upright.
        phase: by how much of a side the first corner is turned from the x axis.
    """
    turn = (np.arange(sides) + phase) * 2 * np.pi / sides
    rings = [
        np.column_stack([at[0] + r * np.cos(turn), at[1] + r * np.sin(turn), np.full(sides, z)])
        for z, r in stations
    ]
    return loft(np.array(rings), color, material)


@lru_cache
def loft_faces(count: int, points: int, closed: bool = True, caps: bool = True) -> np.ndarray:
    """Triangles over ``count`` sections: [band, side, 2], then both ends (read-only)."""
    i = np.arange(points if closed else points - 1)
    first = points * np.arange(count - 1)[:, None]
    a, b = first + i, first + (i + 1) % points
    faces = [np.stack([a, b, b + points, a, b + points, a + points], -1).reshape(-1, 3)]
    if caps:
        k = np.arange(1, points - 1)
        fan = np.column_stack([np.zeros_like(k), k, k + 1])
        faces += [fan[:, ::-1], fan + points * (count - 1)]
    return frozen(np.concatenate(faces))


def triangles(corners: np.ndarray, color: Color, material: str = "plain") -> Asset:
    """Loose triangles from corners [n, 3, 3] (leaves, twigs, wires)."""
    vertices = np.asarray(corners, float).reshape(-1, 3)
    return solid(vertices, np.arange(len(vertices)), color, material)
