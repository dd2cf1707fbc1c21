"""Ground of a street that is not straight, level and alone: bent surfaces, and the land around them.

Near the road all surfaces follow it, corner by corner. Farther away the inner side of a bend would fold
over, so there lies open land of its own, a little lower, which smooths the heights of the road and
rises to hills far away.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from scene.ground.extent import GROUND_START, KERB_HEIGHT, STRIP, STRIP_END
from scene.ground.junction import Junction
from scene.ground.path import Array, Path, course, height_at, nearest, to_world
from scene.mesh.quads import Quads

CHORD = 2.0
"""Longest face along a bent road, metres."""
LOWER = 0.6
"""Metres that the open land lies below the strip along the road."""
NEAR_CELL, FAR_CELL = 16.0, 70.0
"""Sides of the open land's cells, metres."""
MARGIN, SIDE = 70.0, 420.0
"""Metres around the road with near cells, and all the open land."""
HILLS_FROM, HILLS_TO = 90.0, 320.0
"""Metres from the road between which hills rise."""
RASTER = 4.0
"""Side of the cells in which the height below a point is looked up, metres."""


def bent(part: Quads, path: Path) -> Quads:
    """Faces in road coordinates, in the world."""
    x, y, z = np.moveaxis(part.corners, -1, 0)
    corners = np.empty_like(part.corners)
    corners[..., :2] = to_world(path, x, y)
    corners[..., 2] = z + height_at(path, x)
    return part._replace(corners=corners)


def above_road(part: Quads, path: Path) -> Quads:
    """Faces in the world, each corner as high as it lies above the nearest place of the road."""
    if not path.slopes:
        return part
    corners = part.corners.copy()
    corners[..., 2] -= road_height(path, corners.reshape(-1, 3)).reshape(corners.shape[:-1])
    return part._replace(corners=corners)


def pieces(parts: list[Quads]) -> Quads:
    """Faces cut so that no edge runs more than ``CHORD`` along the road, which then can bend."""
    part = Quads(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
    edge = np.abs(part.corners - np.roll(part.corners, -1, axis=1))[..., 0]
    counts = np.stack([np.maximum(edge[:, 0], edge[:, 2]), np.maximum(edge[:, 1], edge[:, 3])], 1)
    counts = np.maximum(np.ceil(counts / CHORD - 1e-6), 1).astype(int)
    found = []
    for n, m in np.unique(counts, axis=0):
        chosen = (counts == (n, m)).all(axis=1)
        a, b, c, d = np.moveaxis(part.corners[chosen], 1, 0)[:, :, None, None]
        u, v = np.linspace(0, 1, n + 1)[:, None, None], np.linspace(0, 1, m + 1)[:, None]
        lattice = (1 - u) * ((1 - v) * a + v * d) + u * ((1 - v) * b + v * c)
        low, high = lattice[:, :-1], lattice[:, 1:]
        cells = np.stack([low[:, :, :-1], high[:, :, :-1], high[:, :, 1:], low[:, :, 1:]], axis=3)
        many = n * m
        found.append(
            Quads(
                cells.reshape(-1, 4, 3),
                part.color[chosen].repeat(many, axis=0),
                part.material[chosen].repeat(many),
            )
        )
    return Quads(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))


def open_lines(path: Path) -> tuple[Array, Array]:
    """Where the cells of the open land meet, east f64[n] and north f64[m]: fine near the road."""
    line = course(path)
    part = (line.x >= GROUND_START) & (line.x <= STRIP_END)
    found = []
    for values in (line.east[part], line.north[part]):
        low, high = values.min() - MARGIN, values.max() + MARGIN
        near = np.linspace(low, high, round((high - low) / NEAR_CELL) + 1)
        far = np.linspace(0, SIDE - MARGIN, round((SIDE - MARGIN) / FAR_CELL) + 1)[1:]
        found.append(np.concatenate([low - far[::-1], near, high + far]))
    return found[0], found[1]


def land_height(path: Path, points: Array, junction: Junction | None = None) -> Array:
    """Height f64[n] of the open land at world points f64[n, 2], but for hills.

    The heights of the road and its arms, the nearer the more: sum h / d^6 over sum 1 / d^6 for places
    along them.
    """
    places, heights = _known(path, junction)
    away = ((points[:, None] - places) ** 2).sum(axis=2)
    weight = (away + 25.0) ** -3
    return weight @ heights / weight.sum(axis=1) + KERB_HEIGHT - LOWER


@lru_cache(maxsize=8)
def _known(path: Path, junction: Junction | None) -> tuple[Array, Array]:
    """Places f64[n, 2] along the road and its arms, and their heights f64[n]."""
    x = np.arange(GROUND_START, STRIP_END, 8.0)
    y = np.zeros_like(x)
    if junction:
        x, y = np.append(x, junction.line[:, 0]), np.append(y, junction.line[:, 1])
    return to_world(path, x, y), height_at(path, x)


def rise(path: Path, points: Array, junction: Junction | None = None) -> Array:
    """How far from 0 to 1 hills have risen at world points f64[n, 2]."""
    _, away = nearest(path, points, GROUND_START, STRIP_END)
    if junction:
        arms = to_world(path, *junction.line.T)
        apart = np.linalg.norm(points[:, None] - arms, axis=2).min(axis=1)
        away = np.minimum(away, apart + HILLS_FROM / 2)
    share = np.clip((away - HILLS_FROM) / (HILLS_TO - HILLS_FROM), 0, 1)
    return share**1.3


class _Raster(NamedTuple):
    """Heights of the road nearest to the corners of a raster, NaN where nobody has asked yet."""

    east: Array  # of its rows, metres
    north: Array  # of its columns
    heights: Array  # f32[rows, columns]


@lru_cache(maxsize=8)
def _raster(path: Path) -> _Raster:
    line = course(path)
    part = (line.x >= GROUND_START) & (line.x <= STRIP_END)
    ends = [(v.min() - STRIP, v.max() + STRIP) for v in (line.east[part], line.north[part])]
    east, north = (np.arange(low, high + RASTER, RASTER) for low, high in ends)
    return _Raster(east, north, np.full((len(east), len(north)), np.nan, np.float32))


def road_height(path: Path, points: Array) -> Array:
    """Height f32[n] of the carriageway nearest to world points f32[n, >= 2], to some centimetres."""
    east, north, heights = _raster(path)
    # A number of Python's own keeps f32; one of an array would not.
    u = np.clip((points[:, 0] - float(east[0])) / RASTER, 0, heights.shape[0] - 1.001)
    v = np.clip((points[:, 1] - float(north[0])) / RASTER, 0, heights.shape[1] - 1.001)
    i, j = u.astype(int), v.astype(int)
    wanted = np.zeros(heights.shape, bool)
    for below in (i, i + 1):
        for left in (j, j + 1):
            wanted[below, left] = True
    rows, columns = np.nonzero(wanted & np.isnan(heights))
    x, _ = nearest(path, np.stack([east[rows], north[columns]], axis=1), GROUND_START, STRIP_END)
    heights[rows, columns] = height_at(path, x)
    u, v = u - i, v - j
    low = (1 - v) * heights[i, j] + v * heights[i, j + 1]
    high = (1 - v) * heights[i + 1, j] + v * heights[i + 1, j + 1]
    return ((1 - u) * low + u * high).astype(np.float32)
