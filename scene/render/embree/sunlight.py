"""Find sunlit spots with few rays, since most of an image is well inside of light or shadow.

One ray is cast for every second pixel along each axis. Between rays that start on one surface and agree,
spots get the same value; all others cast a ray as well. At shadow edges, every sample of a pixel casts its
own.
"""

from __future__ import annotations

import numpy as np

from scene.compiled import njit
from scene.render.buffers import Visible
from scene.render.embree.api import SceneBVH
from scene.render.embree.rays import free
from scene.render.protocol import RenderSettings
from scene.render.visibility import OFFSET

f32 = np.float32
ALIKE = f32(0.9)
"""Least cosine between normals of spots on about the same surface."""
UNKNOWN = f32(-1)
WIDE, HIGH = 4, 2
"""Size in pixels of a tile, whose rays form a packet."""


def sunlight(bvh: SceneBVH, view: Visible, sun: np.ndarray, settings: RenderSettings) -> np.ndarray:
    """Share f32[m] of the sunlight that reaches each spot; 0 on surfaces that face away.

    Args:
        bvh: objects that block light.
        view: the samples and their spots.
        sun: f32[3] towards the sun.
        settings: size and samples.
    """
    spots = view.spots
    lit = np.where(view.side == 0, f32(0), UNKNOWN)  # 0 where there is no ray
    of_spot = view.hits.instance[spots.sample] if settings.samples > 1 else view.hits.instance
    where = (of_spot, view.flat, view.side, settings.width, settings.height)
    direction = np.ascontiguousarray(sun[None], f32)
    for choose in (_some, _others):
        spot, starts = _begin(choose(spots.first, lit, *where), view.points, view.flat, view.side)
        lit[spot] = free(bvh, starts, direction, np.arange(len(spot)))
    if settings.samples > 1:
        edge = _edges(spots.first, spots.share, lit, *where)
        spot, starts = _every_sample(edge, view, settings.samples, settings.width)
        reached = free(bvh, starts, direction, np.arange(len(spot)))
        _average(edge, spot, reached, lit)
    return lit


@njit(cache=True)
def _begin(
    spot: np.ndarray, points: np.ndarray, flat: np.ndarray, side: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The spots, and the starts f32[k, 3] of their rays."""
    starts = np.empty((len(spot), 3), np.float32)
    for n in range(len(spot)):
        for k in range(3):
            starts[n, k] = points[spot[n], k] + f32(side[spot[n]]) * f32(OFFSET) * flat[spot[n], k]
    return spot, starts


@njit(cache=True, inline="always")
def _alike(a: int, b: int, instance: np.ndarray, flat: np.ndarray, side: np.ndarray) -> bool:
    """Whether two spots, one of which may be lit, are on about the same surface."""
    if instance[a] != instance[b] or side[a] != side[b]:
        return False
    return (
        flat[a, 0] * flat[b, 0] + flat[a, 1] * flat[b, 1] + flat[a, 2] * flat[b, 2] > ALIKE
    )  # fmt: skip


@njit(cache=True)
def _some(
    first: np.ndarray, lit: np.ndarray, instance: np.ndarray, flat: np.ndarray, side: np.ndarray,
    columns: int, rows: int,
) -> np.ndarray:  # fmt: skip
    """First spots i32[k] of every second pixel along each axis that may be lit."""
    spot = np.empty((columns + 1) // 2 * ((rows + 1) // 2), np.int32)
    count = 0
    for top in range(0, rows, 2 * HIGH):
        for left in range(0, columns, 2 * WIDE):
            for row in range(top, min(top + 2 * HIGH, rows), 2):
                for column in range(left, min(left + 2 * WIDE, columns), 2):
                    spot[count] = first[row * columns + column]
                    count += side[spot[count]] != 0
    return spot[:count]


@njit(cache=True)
def _others(
    first: np.ndarray, lit: np.ndarray, instance: np.ndarray, flat: np.ndarray, side: np.ndarray,
    columns: int, rows: int,
) -> np.ndarray:  # fmt: skip
    """Spots i32[k] that need a ray, too; fills in the light of those between rays of ``_some``."""
    spot = np.empty(lit.shape[0], np.int32)
    count = 0
    for top in range(0, rows, HIGH):
        for left in range(0, columns, WIDE):
            for row in range(top, min(top + HIGH, rows)):
                for column in range(left, min(left + WIDE, columns)):
                    p = row * columns + column
                    one = first[p]
                    if (row | column) & 1 and lit[one] == UNKNOWN:
                        up, west = row & ~1, column & ~1
                        down = up + 2 if row > up and up + 2 < rows else up
                        east = west + 2 if column > west and west + 2 < columns else west
                        a, b = first[up * columns + west], first[down * columns + east]
                        value = lit[a]
                        agrees = value == lit[b] and _alike(one, a, instance, flat, side)
                        agrees = agrees and _alike(one, b, instance, flat, side)
                        if agrees and up < down and west < east:
                            a, b = first[up * columns + east], first[down * columns + west]
                            agrees = value == lit[a] and value == lit[b]
                            agrees = agrees and _alike(one, a, instance, flat, side)
                            agrees = agrees and _alike(one, b, instance, flat, side)
                        if agrees:
                            lit[one] = value
                    for i in range(one, first[p + 1]):
                        if lit[i] == UNKNOWN:
                            spot[count] = i
                            count += 1
    return spot[:count]


@njit(cache=True)
def _edges(
    first: np.ndarray, share: np.ndarray, lit: np.ndarray, instance: np.ndarray, flat: np.ndarray,
    side: np.ndarray, columns: int, rows: int,
) -> np.ndarray:  # fmt: skip
    """First spots i32[k] with several samples at the edge of a shadow."""
    spot = np.empty(columns * rows, np.int32)
    count = 0
    for row in range(rows):
        for column in range(columns):
            one = first[row * columns + column]
            if (share[one] < 2) | (side[one] == 0):
                continue
            differs = False
            for y, x in (
                (row - 1, column),
                (row + 1, column),
                (row, column - 1),
                (row, column + 1),
            ):
                if 0 <= y < rows and 0 <= x < columns:
                    other = first[y * columns + x]
                    if lit[other] != lit[one] and _alike(one, other, instance, flat, side):
                        differs = True
            spot[count] = one
            count += differs
    return spot[:count]


@njit(cache=True)
def _every_sample(
    edge: np.ndarray, view: Visible, samples: int, columns: int
) -> tuple[np.ndarray, np.ndarray]:
    """For each sample of the spots: the spot i32[k] that it belongs to, and the start of its ray."""
    first, owner, flat, side = view.spots.first, view.spots.owner, view.flat, view.side
    origin, directions, distance = view.rays.origin, view.rays.directions, view.hits.distance
    most = len(edge) * samples * samples
    which, starts = np.empty(most, np.int32), np.empty((most, 3), np.float32)
    count, pixel = 0, 0
    for n in range(len(edge)):
        one = edge[n]
        while first[pixel + 1] <= one:
            pixel += 1
        corner = pixel // columns * samples * columns * samples + pixel % columns * samples
        for row in range(samples):
            for column in range(samples):
                i = corner + row * columns * samples + column
                if owner[i] == one:
                    which[count] = n
                    for k in range(3):
                        away = f32(side[one]) * f32(OFFSET) * flat[one, k]
                        starts[count, k] = origin[k] + distance[i] * directions[i, k] + away
                    count += 1
    return which[:count], starts[:count]


@njit(cache=True)
def _average(edge: np.ndarray, which: np.ndarray, reached: np.ndarray, lit: np.ndarray) -> None:
    """Set each spot to the mean of its samples."""
    total, count = np.zeros(len(edge), np.float32), np.zeros(len(edge), np.float32)
    for n in range(len(which)):
        total[which[n]] += reached[n]
        count[which[n]] += f32(1)
    for n in range(len(edge)):
        lit[edge[n]] = total[n] / count[n]
