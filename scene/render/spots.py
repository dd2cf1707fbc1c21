"""Group the samples of a pixel into as few spots as possible, since light and shading cost time per spot.

With several samples per pixel, all samples of most pixels hit one flat surface. Shaded once, at their centre,
they look the same as shaded one by one.
"""

from __future__ import annotations

import math

import numpy as np
from numba import carray

from scene.compiled import njit
from scene.render.address import float_pointer
from scene.render.buffers import Hits, Spots
from scene.render.geometry import ROW

f32 = np.float32
ALIKE = f32(0.97)
"""Least cosine between the normals of faces that are shaded as one."""
FLAT = f32(0.2)
"""Largest height above a plane of points that belong to it, relative to their distance."""
THICK = f32(0.005)
"""Height in metres above a plane that always belongs to it."""


def group(
    hits: Hits,
    directions: np.ndarray,
    surfaces: np.ndarray,
    pose: np.ndarray,
    columns: int,
    samples: int,
) -> Spots:
    """Group ``samples`` x ``samples`` samples per pixel into spots; with one, each is a spot.

    Args:
        hits: the hits of the samples.
        directions: f32[n, 3], see ``Rays``.
        surfaces: u64[instances], see ``Geometry``.
        pose: f32[instances, 3, 4], see ``Geometry``.
        columns: samples in a row.
        samples: samples per pixel along each axis.
    """
    n = len(hits.face)
    if samples == 1:
        numbers = np.arange(n + 1, dtype=np.int32)
        return Spots(
            numbers, numbers[:-1], np.ones(n, f32), directions, hits.distance, numbers[:-1]
        )
    first, sample, owner = (np.empty(k, np.int32) for k in (n // samples**2 + 1, n, n))
    share, middle, away = np.empty(n, f32), np.empty((n, 3), f32), np.empty(n, f32)
    m = _group(
        hits, directions, surfaces, pose, columns, samples,
        Spots(first, sample, share, middle, away, owner),
    )  # fmt: skip
    return Spots(first, sample[:m], share[:m], middle[:m], away[:m], owner)


@njit(cache=True, fastmath=True, error_model="numpy")
def _group(
    hits: Hits,
    directions: np.ndarray,
    surfaces: np.ndarray,
    pose: np.ndarray,
    columns: int,
    samples: int,
    out: Spots,
) -> int:
    """Fill the spots, see ``group``; returns their number."""
    face, instance, distance = hits.face, hits.instance, hits.distance
    first, sample, share, owner = out.first, out.sample, out.share, out.owner
    middle, away = out.directions, out.distance
    wide, per_pixel = columns // samples, samples * samples
    left = np.empty(per_pixel, np.int64)
    count = 0
    for p in range(first.shape[0] - 1):
        first[p] = count
        corner = (p // wide) * samples * columns + (p % wide) * samples
        left[0] = corner + samples // 2 * (columns + 1)
        f, j, same = face[left[0]], instance[left[0]], True
        x, y, z = f32(0), f32(0), f32(0)
        for row in range(samples):
            for i in range(corner + row * columns, corner + row * columns + samples):
                same &= (face[i] == f) & (instance[i] == j)
                t = distance[i] if f >= 0 else f32(1)
                x += t * directions[i, 0]
                y += t * directions[i, 1]
                z += t * directions[i, 2]
        if same:  # the most frequent case
            for row in range(samples):
                for i in range(corner + row * columns, corner + row * columns + samples):
                    owner[i] = count
            length = f32(math.sqrt(x * x + y * y + z * z))
            sample[count], share[count] = left[0], per_pixel
            middle[count, 0], middle[count, 1], middle[count, 2] = (
                x / length,
                y / length,
                z / length,
            )
            away[count] = length / f32(per_pixel) if f >= 0 else distance[left[0]]
            count += 1
            continue
        k = 1
        for row in range(samples):
            for column in range(samples):
                i = corner + row * columns + column
                if i != left[0]:
                    left[k] = i
                    k += 1
        waiting = per_pixel
        while waiting > 0:
            # Remove all that are like the first one; the others keep their order.
            one, rest, members = left[0], 0, 1
            owner[one] = count
            ground = distance[one] if face[one] >= 0 else f32(1)
            x = ground * directions[one, 0]
            y = ground * directions[one, 1]
            z = ground * directions[one, 2]
            for k in range(1, waiting):
                i = left[k]
                if _alike(face, instance, distance, directions, surfaces, pose, one, i):
                    t = distance[i] if face[i] >= 0 else f32(1)
                    x += t * directions[i, 0]
                    y += t * directions[i, 1]
                    z += t * directions[i, 2]
                    members += 1
                    owner[i] = count
                else:
                    left[rest] = i
                    rest += 1
            waiting = rest
            length = f32(math.sqrt(x * x + y * y + z * z))
            sample[count], share[count] = one, members
            middle[count, 0], middle[count, 1], middle[count, 2] = (
                x / length,
                y / length,
                z / length,
            )
            away[count] = length / f32(members) if face[one] >= 0 else distance[one]
            count += 1
    first[first.shape[0] - 1] = count
    return count


@njit(cache=True, fastmath=True, error_model="numpy", inline="always")
def _alike(
    face: np.ndarray,
    instance: np.ndarray,
    distance: np.ndarray,
    directions: np.ndarray,
    surfaces: np.ndarray,
    pose: np.ndarray,
    a: int,
    b: int,
) -> bool:
    """Whether samples ``a`` and ``b`` hit one face, or two of one colour in about the same plane."""
    if instance[a] != instance[b]:
        return False
    if face[a] == face[b]:
        return True
    rows = carray(float_pointer(surfaces[instance[a]]), (max(face[a], face[b]) + 1, ROW))
    one, other = rows[face[a]], rows[face[b]]
    if (
        (one[12] != other[12]) | (one[13] != other[13])
        | (one[14] != other[14]) | (one[15] != other[15])
    ):  # fmt: skip
        return False
    if abs(one[0] * other[0] + one[1] * other[1] + one[2] * other[2]) < ALIKE:
        return False
    turn = pose[instance[a]]
    height = apart = f32(0)
    for k in range(3):
        normal = turn[k, 0] * one[0] + turn[k, 1] * one[1] + turn[k, 2] * one[2]
        step = distance[b] * directions[b, k] - distance[a] * directions[a, k]
        height += normal * step
        apart += step * step
    return bool(height * height < max(THICK * THICK, FLAT * FLAT * apart))
