"""What the sun reaches, by few rays: most of a picture lies well inside of light or shadow.

One ray goes out for every second pixel each way. Between rays that start on one surface and agree, the
others are known; all others are cast as well. At the edge of a shadow every sample of a pixel casts its own.
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
"""Pixels of a tile, whose rays go together."""


def sunlight(bvh: SceneBVH, seen: Visible, sun: np.ndarray, settings: RenderSettings) -> np.ndarray:
    """Share f32[m] of the sunlight that reaches each spot; 0 where none could.

    Args:
        bvh: what may be in the way.
        seen: the samples and their spots.
        sun: f32[3] towards the sun.
        settings: size and samples.
    """
    spots = seen.spots
    lit = _unknown(seen.side)
    of_spot = seen.hits.instance[spots.sample] if settings.samples > 1 else seen.hits.instance
    where = (of_spot, seen.flat, seen.side, settings.width, settings.height)
    direction = np.ascontiguousarray(sun[None], f32)
    for asked in (_some, _others):
        spot, starts = _begin(asked(spots.first, lit, *where), seen.points, seen.flat, seen.side)
        lit[spot] = free(bvh, starts, direction, np.arange(len(spot)))
    if settings.samples > 1:
        edge = _edges(spots.first, spots.share, lit, *where)
        spot, starts = _every_sample(edge, seen, settings.samples, settings.width)
        found = free(bvh, starts, direction, np.arange(len(spot)))
        _average(edge, spot, found, lit)
    return lit


@njit(cache=True)
def _unknown(side: np.ndarray) -> np.ndarray:
    """0 where no ray begins, else ``UNKNOWN``."""
    lit = np.empty(side.shape[0], np.float32)
    for i in range(side.shape[0]):
        lit[i] = f32(0) if side[i] == 0 else UNKNOWN
    return lit


@njit(cache=True)
def _begin(
    spot: np.ndarray, points: np.ndarray, flat: np.ndarray, side: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The spots themselves, and where f32[k, 3] their rays begin."""
    starts = np.empty((len(spot), 3), np.float32)
    for n in range(len(spot)):
        for k in range(3):
            starts[n, k] = points[spot[n], k] + f32(side[spot[n]]) * f32(OFFSET) * flat[spot[n], k]
    return spot, starts


@njit(cache=True, inline="always")
def _alike(a: int, b: int, instance: np.ndarray, flat: np.ndarray, side: np.ndarray) -> bool:
    """Whether two spots, one of which may be lit, lie on about the same surface."""
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
    """First spots i32[k] of every second pixel each way, where the sun is not ruled out."""
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
    """Spots i32[k] that must be asked as well; the light of those between ``_some`` is filled in."""
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
                        known = value == lit[b] and _alike(one, a, instance, flat, side)
                        known = known and _alike(one, b, instance, flat, side)
                        if known and up < down and west < east:
                            a, b = first[up * columns + east], first[down * columns + west]
                            known = value == lit[a] and value == lit[b]
                            known = known and _alike(one, a, instance, flat, side)
                            known = known and _alike(one, b, instance, flat, side)
                        if known:
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
    """First spots i32[k] of pixels that lie at the edge of a shadow and hold several samples."""
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
    edge: np.ndarray, seen: Visible, samples: int, columns: int
) -> tuple[np.ndarray, np.ndarray]:
    """Of each sample of the spots: which of them i32[k] it belongs to, and where its ray begins."""
    first, owner, flat, side = seen.spots.first, seen.spots.owner, seen.flat, seen.side
    origin, directions, distance = seen.rays.origin, seen.rays.directions, seen.hits.distance
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
def _average(edge: np.ndarray, which: np.ndarray, found: np.ndarray, lit: np.ndarray) -> None:
    """Give each spot the mean of what its samples found."""
    total, count = np.zeros(len(edge), np.float32), np.zeros(len(edge), np.float32)
    for n in range(len(which)):
        total[which[n]] += found[n]
        count[which[n]] += f32(1)
    for n in range(len(edge)):
        lit[edge[n]] = total[n] / count[n]
