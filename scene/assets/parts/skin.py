"""Curved surfaces of vehicles: sheets over grids of points, welded so that shading is smooth."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from scene.look.materials import material_id
from scene.mesh.asset import Asset, Color, merge, solid
from scene.mesh.mesh import Mesh, frozen, twice_areas
from scene.mesh.solids import block, loft

Span = tuple[float, float]
"""Two positions, or shares of a length: from and to."""
_WELD = 1e4
"""Welding merges points that agree to 1 / _WELD metres."""


def in_plane(x: float, outline: np.ndarray) -> np.ndarray:
    """Put points f64[n, 2] (y, z) into the plane ``x``; f64[n, 3]."""
    return np.column_stack([np.full(len(outline), x), outline])


def sheet(points: np.ndarray, color: Color, material: str = "paint") -> Asset:
    """Cover a grid of points f64[n, m, 3]; cell (i, j) has the faces 2 (i (m - 1) + j) and the next one."""
    return solid(points.reshape(-1, 3), _cells(*points.shape[:2]), color, material)


@lru_cache
def _cells(n: int, m: int) -> np.ndarray:
    """Return the triangles i64[2 (n - 1) (m - 1), 3] of a grid of n by m points (read-only)."""
    first = (np.arange(n - 1)[:, None] * m + np.arange(m - 1)).ravel()
    a, b, c, d = first, first + 1, first + m + 1, first + m
    return frozen(np.stack([a, b, c, a, c, d], 1).reshape(-1, 3))


def twin_sheets(points: np.ndarray, color: Color, material: str = "paint") -> Asset:
    """Cover a grid and its mirror image on the other side of the x-z plane, as one solid."""
    left = points.reshape(-1, 3)
    vertices = np.concatenate([left, left * _MIRROR])
    return solid(vertices, _twin_cells(*points.shape[:2]), color, material)


@lru_cache
def _twin_cells(n: int, m: int) -> np.ndarray:
    faces = _cells(n, m)
    return frozen(np.concatenate([faces, faces[:, ::-1] + n * m]))


def paint_cells(points: np.ndarray, paints: list[tuple[Color, str]], cells: np.ndarray) -> Asset:
    """Cover a grid, its cell (i, j) in ``paints[cells[i, j]]``, a colour and a material."""
    skin = sheet(points, (0, 0, 0))
    paint = np.repeat(cells.ravel(), 2)
    color = np.array([c for c, _ in paints], np.float32)[paint]
    material = np.array([material_id(m) for _, m in paints], np.uint8)[paint]
    return skin._replace(color=color, material=material)


def weld(*parts: Asset) -> Asset:
    """Merge parts into one asset, points at the same place into one vertex, and drop faces without area."""
    merged = merge(*parts)
    vertices = merged.mesh.vertices
    key = np.round(vertices * _WELD).astype(np.int64)
    # The three coordinates of a point on a vehicle fit one integer, which sorts faster than rows do.
    key = (key[:, 0] * 2**21 + key[:, 1]) * 2**21 + key[:, 2]
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    faces = inverse[merged.mesh.faces]
    points = vertices[first]
    keep = twice_areas(points, faces) > 2e-7
    return Asset(Mesh(points, faces[keep]), merged.color[keep], merged.material[keep])


def mirrored(asset: Asset) -> Asset:
    """Mirror an asset to the other side of the x-z plane."""
    faces = np.ascontiguousarray(asset.mesh.faces[:, ::-1])
    return asset._replace(mesh=Mesh(asset.mesh.vertices * _MIRROR, faces))


_MIRROR = np.array([1.0, -1.0, 1.0])


def pair(asset: Asset) -> Asset:
    """Merge an asset with its mirror image."""
    return merge(asset, mirrored(asset))


def cuboid(
    x: Span, half: float, z: Span, color: Color,
    material: str = "plain", *, at: float = 0.0,
) -> Asset:  # fmt: skip
    """Build a box from x[0] to x[1], z[0] to z[1], and ``half`` m to either side of y = ``at``; 12 faces."""
    return block((x[0], at - half, z[0]), (x[1], at + half, z[1]), color, material)


def revolve(
    profile: list[tuple[float, float]], color: Color, material: str, *, sides: int = 18
) -> Asset:
    """Build a surface of revolution about the y axis from (radius, y) points, m."""
    angle = np.arange(sides + 1) * 2 * np.pi / sides
    radius, y = np.array(profile).T
    rings = np.outer(radius, np.cos(angle)), y[:, None] + 0 * angle, np.outer(radius, np.sin(angle))
    return weld(sheet(np.stack(rings, axis=-1), color, material))


_ROUND = np.linspace(0, np.pi / 2, 4)


def rounded_body(
    stations: list[tuple[float, float, float, float]], color: Color, material: str
) -> Asset:
    """Build a rounded body along x from (x, half width, low, high) sections, narrower above."""
    rings = []
    for x, half, low, high in _smooth(stations):
        middle = low + 0.45 * (high - low)
        arc = [
            (half * (0.45 + 0.55 * np.cos(a)), middle + (high - middle) * np.sin(a)) for a in _ROUND
        ]
        left = [(0.8 * half, low), (half, low + 0.15 * (high - low)), *arc]
        rings.append([(x, y, z) for y, z in left] + [(x, -y, z) for y, z in left[::-1]])
    return loft(np.array(rings), color, material)


def _smooth(stations: list[tuple[float, float, float, float]]) -> np.ndarray:
    """Add two stations in every gap, on a smooth curve through all."""
    knots = np.array(stations)
    t = np.arange(len(knots))
    fine = np.linspace(0, len(knots) - 1, 3 * (len(knots) - 1) + 1)
    slope = np.gradient(knots, axis=0)
    low = np.minimum(fine.astype(int), len(knots) - 2)
    u = (fine - t[low])[:, None]
    a, b, da, db = knots[low], knots[low + 1], slope[low], slope[low + 1]
    return (
        (2 * u**3 - 3 * u**2 + 1) * a
        + (u**3 - 2 * u**2 + u) * da
        + (3 * u**2 - 2 * u**3) * b
        + (u**3 - u**2) * db
    )
