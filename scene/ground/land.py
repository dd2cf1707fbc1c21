"""Ground of a street that bends, slopes or has a junction: bent surfaces, and the land around them.

Near the road, all surfaces follow it corner by corner. Farther away, the inner side of a bend would fold
over, so a separate open land, a little lower, smooths the heights of the road and rises to hills in the
distance.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from scene.compiled import njit
from scene.ground.extent import GROUND_START, KERB_HEIGHT, STRIP, STRIP_END
from scene.ground.junction import Junction
from scene.ground.path import Array, Course, Path, course, height_at, nearest, on_line, to_world
from scene.mesh.quads import Quads, joined

CHORD = 2.0
"""Longest face along a bent road, metres."""
LOWER = 0.6
"""Metres by which the open land is below the strip along the road."""
NEAR_CELL, FAR_CELL = 16.0, 70.0
"""Sides of the open land's cells, metres."""
MARGIN, SIDE = 70.0, 420.0
"""Metres around the road with near cells, and of the whole open land."""
HILLS_FROM, HILLS_TO = 90.0, 320.0
"""Range of distances from the road in which hills rise, metres."""
RASTER = 4.0
"""Side of the cells for looking up heights, metres."""


def bent(part: Quads, path: Path) -> Quads:
    """Convert faces from road to world coordinates."""
    return part._replace(corners=_bent(part.corners.reshape(-1, 3), course(path)).reshape(-1, 4, 3))


@njit(cache=True)
def _bent(points: Array, line: Course) -> Array:
    """Convert points f64[n, 3] from road to world coordinates."""
    out = np.empty_like(points)
    for n in range(len(points)):
        at, y = on_line(line, points[n, 0]), points[n, 1]
        out[n, 0], out[n, 1] = (
            at.east - y * math.sin(at.heading),
            at.north + y * math.cos(at.heading),
        )
        out[n, 2] = points[n, 2] + at.height
    return out


def above_road(part: Quads, path: Path) -> Quads:
    """World faces whose corners have their height above the nearest place of the road."""
    if not path.slopes:
        return part
    corners = part.corners.copy()
    corners[..., 2] -= road_height(path, corners.reshape(-1, 3)).reshape(corners.shape[:-1])
    return part._replace(corners=corners)


def pieces(parts: list[Quads]) -> Quads:
    """Cut faces so that no edge extends more than ``CHORD`` along the road, which can then bend."""
    part = joined(parts)
    corners, source = _cut(part.corners)
    return Quads(corners, part.color[source], part.material[source])


@njit(cache=True)
def _cut(corners: Array) -> tuple[Array, Array]:
    """Cut faces f64[n, 4, 3] into pieces f64[k, 4, 3]; also returns the face i64[k] of each piece."""
    n = len(corners)
    counts = np.empty((2, n), np.int64)
    for i in range(n):
        for side in range(2):
            edge = max(
                abs(corners[i, side, 0] - corners[i, side + 1, 0]),
                abs(corners[i, side + 2, 0] - corners[i, (side + 3) % 4, 0]),
            )
            counts[side, i] = max(math.ceil(edge / CHORD - 1e-6), 1)
    total = (counts[0] * counts[1]).sum()
    out, source = np.empty((total, 4, 3)), np.empty(total, np.int64)
    at = 0
    for i in np.argsort(counts[0] * 2**20 + counts[1], kind="mergesort"):
        rows, columns = counts[0, i], counts[1, i]
        for row in range(rows):
            for column in range(columns):
                for k, (r, c) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
                    u, v = (row + r) / rows, (column + c) / columns
                    for d in range(3):
                        near = (1 - v) * corners[i, 0, d] + v * corners[i, 3, d]
                        far = (1 - v) * corners[i, 1, d] + v * corners[i, 2, d]
                        out[at, k, d] = (1 - u) * near + u * far
                source[at] = i
                at += 1
    return out, source


def open_lines(path: Path) -> tuple[Array, Array]:
    """Grid lines of the open land, east f64[n] and north f64[m]; fine near the road."""
    line = course(path)
    part = (line.x >= GROUND_START) & (line.x <= STRIP_END)
    lines = []
    for values in (line.east[part], line.north[part]):
        low, high = values.min() - MARGIN, values.max() + MARGIN
        near = np.linspace(low, high, round((high - low) / NEAR_CELL) + 1)
        far = np.linspace(0, SIDE - MARGIN, round((SIDE - MARGIN) / FAR_CELL) + 1)[1:]
        lines.append(np.concatenate([low - far[::-1], near, high + far]))
    return lines[0], lines[1]


def land_height(path: Path, points: Array, junction: Junction | None = None) -> Array:
    """Height f64[n] of the open land at world points f64[n, 2], without hills.

    The heights of the road and its arms, weighted by distance: sum h / d^6 over sum 1 / d^6 for places along
    them.
    """
    return _land_height(np.asarray(points, float), *_anchors(path, junction))


@njit(cache=True, fastmath=True, error_model="numpy")
def _land_height(points: Array, places: Array, heights: Array) -> Array:
    out = np.empty(len(points))
    for n in range(len(points)):
        total = weights = 0.0
        for k in range(len(places)):
            x, y = points[n, 0] - places[k, 0], points[n, 1] - places[k, 1]
            away = x * x + y * y + 25.0
            weight = 1 / (away * away * away)
            total += weight * heights[k]
            weights += weight
        out[n] = total / weights + (KERB_HEIGHT - LOWER)
    return out


@lru_cache(maxsize=8)
def _anchors(path: Path, junction: Junction | None) -> tuple[Array, Array]:
    """Places f64[n, 2] along the road and its arms, and their heights f64[n]."""
    x = np.arange(GROUND_START, STRIP_END, 8.0)
    y = np.zeros_like(x)
    if junction:
        x, y = np.append(x, junction.line[:, 0]), np.append(y, junction.line[:, 1])
    return to_world(path, x, y), height_at(path, x)


def rise(path: Path, points: Array, junction: Junction | None = None) -> Array:
    """Share of the hills' height at world points f64[n, 2], from 0 near the road to 1 far away."""
    _, away = nearest(path, points, GROUND_START, STRIP_END)
    if junction:
        arms = to_world(path, *junction.line.T)
        apart = np.sqrt(((points[:, None] - arms) ** 2).sum(axis=2).min(axis=1))
        away = np.minimum(away, apart + HILLS_FROM / 2)
    share = np.clip((away - HILLS_FROM) / (HILLS_TO - HILLS_FROM), 0, 1)
    return share**1.3


class _Raster(NamedTuple):
    """Heights of the road nearest to the corners of a raster, NaN where not computed yet."""

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
    """Height f32[n] of the carriageway nearest to world points f32[n, >= 2], accurate to centimetres."""
    raster = _raster(path)
    rows, columns = _unknown(points, raster)
    if len(rows):
        places = np.stack([raster.east[rows], raster.north[columns]], axis=1)
        x, _ = nearest(path, places, GROUND_START, STRIP_END)
        raster.heights[rows, columns] = height_at(path, x)
    return _looked_up(points, raster)


@njit(cache=True, inline="always")
def _cell(points: Array, n: int, raster: _Raster) -> tuple[float, float]:
    """Row and column of a point in a raster, with their fractions."""
    single = points.dtype.type  # f32 in, f32 out
    u = (points[n, 0] - single(raster.east[0])) / single(RASTER)
    v = (points[n, 1] - single(raster.north[0])) / single(RASTER)
    most_u, most_v = single(len(raster.east) - 1.001), single(len(raster.north) - 1.001)
    return min(max(u, single(0)), most_u), min(max(v, single(0)), most_v)


@njit(cache=True)
def _unknown(points: Array, raster: _Raster) -> tuple[Array, Array]:
    """Rows and columns i64[k] of the corners around points that are not computed yet."""
    requested = np.zeros(raster.heights.shape, np.bool_)
    cells = np.empty((2, requested.size), np.int64)
    count = 0
    for n in range(len(points)):
        u, v = _cell(points, n, raster)
        i, j = int(u), int(v)
        for row in range(i, i + 2):
            for column in range(j, j + 2):
                if np.isnan(raster.heights[row, column]) and not requested[row, column]:
                    requested[row, column] = True
                    cells[0, count], cells[1, count] = row, column
                    count += 1
    return cells[0, :count], cells[1, :count]


@njit(cache=True)
def _looked_up(points: Array, raster: _Raster) -> Array:
    """Interpolate heights f32[n] of points between the corners of a raster."""
    heights = raster.heights
    out = np.empty(len(points), np.float32)
    for n in range(len(points)):
        u, v = _cell(points, n, raster)
        i, j = int(u), int(v)
        right, down = float(u) - i, float(v) - j
        low = (1 - down) * heights[i, j] + down * heights[i, j + 1]
        high = (1 - down) * heights[i + 1, j] + down * heights[i + 1, j + 1]
        out[n] = (1 - right) * low + right * high
    return out
