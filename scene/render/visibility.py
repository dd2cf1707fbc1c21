"""What lies at each hit and what light can reach it: normals, points, and the rays that ask.

Everything here is compiled and alike for all renderers; they only answer the rays. A compiled function calls
only functions of its own file: the compiler's cache does not notice changes elsewhere.
"""

from __future__ import annotations

import math

import numpy as np
from numba import carray, njit

from scene.geometry import ROW
from scene.render.address import float_pointer

OFFSET = 1e-2
"""Metres along the normal from a surface to the start of its next ray."""
DARKEST = 0.05
"""Share of the sky's light that reaches a surface from which no sky is seen."""

Array = np.ndarray
f32 = np.float32
ZERO, ONE = f32(0), f32(1)
"""Compiled code computes in doubles as soon as a plain number comes near; these keep it single."""


@njit(cache=True, fastmath=True)
def look(
    origin: Array,
    directions: Array,
    distance: Array,
    instance: Array,
    face: Array,
    u: Array,
    v: Array,
    surfaces: Array,
    pose: Array,
    flat: Array,
    smooth: Array,
    points: Array,
) -> None:
    """What lies at each hit: the face's own normal, the smoothed one, both towards the viewer, the point.

    Misses get an upward normal and the ray's origin.
    """
    for i in range(face.shape[0]):
        f = face[i]
        if f < 0:
            for k in range(3):
                flat[i, k] = smooth[i, k] = 1.0 if k == 2 else 0.0
                points[i, k] = origin[k]
            continue
        m = pose[instance[i]]
        w = ONE - u[i] - v[i]
        row = carray(float_pointer(surfaces[instance[i]]), (f + 1, ROW))[f]
        a, b, c = row[0], row[1], row[2]
        p = w * row[3] + u[i] * row[6] + v[i] * row[9]
        q = w * row[4] + u[i] * row[7] + v[i] * row[10]
        r = w * row[5] + u[i] * row[8] + v[i] * row[11]
        shrink = ONE / f32(math.sqrt(max(p * p + q * q + r * r, f32(1e-12))))
        toward_flat, toward_smooth = ZERO, ZERO
        for k in range(3):
            flat[i, k] = m[k, 0] * a + m[k, 1] * b + m[k, 2] * c
            smooth[i, k] = shrink * (m[k, 0] * p + m[k, 1] * q + m[k, 2] * r)
            toward_flat += flat[i, k] * directions[i, k]
            toward_smooth += smooth[i, k] * directions[i, k]
            points[i, k] = origin[k] + distance[i] * directions[i, k]
        # At a silhouette the smoothed normal may lean away; then it is the flat one.
        agree = toward_flat * toward_smooth > ZERO
        turn_flat = -ONE if toward_flat > ZERO else ONE
        for k in range(3):
            flat[i, k] *= turn_flat
            smooth[i, k] = turn_flat * smooth[i, k] if agree else flat[i, k]


@njit(cache=True, fastmath=True)
def sun_rays(
    face: Array,
    instance: Array,
    flat: Array,
    smooth: Array,
    points: Array,
    sun_direction: Array,
    surfaces: Array,
    rows: Array,
    starts: Array,
    wanted: Array,
) -> None:
    """Where each sample's ray to the sun begins, and whether it needs one.

    It begins on the viewer's side, but for leaves, which the sun shines through, on the sun's own.
    What faces away from the sun is dark without asking.
    """
    for i in range(face.shape[0]):
        f = face[i]
        wanted[i] = 0
        for k in range(3):
            starts[i, k] = points[i, k]
        if f < 0:
            continue
        by_face, by_normal = 0.0, 0.0
        for k in range(3):
            by_face += flat[i, k] * sun_direction[k]
            by_normal += smooth[i, k] * sun_direction[k]
        sign = 1.0
        row = carray(float_pointer(surfaces[instance[i]]), (f + 1, ROW))[f]
        if rows[int(row[15]), 2] > 0:
            sign = 1.0 if by_face >= 0 else -1.0
        elif by_face <= 0 or by_normal <= 0:
            continue
        wanted[i] = 1
        for k in range(3):
            starts[i, k] += sign * OFFSET * flat[i, k]


@njit(cache=True, fastmath=True)
def sky_rays(
    face: Array,
    flat: Array,
    points: Array,
    columns: int,
    height: int,
    width: int,
    starts: Array,
    directions: Array,
    wanted: Array,
) -> None:
    """One cosine-distributed ray for every second sample each way, stratified over 4 x 4 of them."""
    for y in range(height):
        for x in range(width):
            j, i = y * width + x, 2 * y * columns + 2 * x
            wanted[j] = face[i] >= 0
            # Low-discrepancy pair over the 16 cells of a block.
            cell = (x & 3) + 4 * (y & 3)
            s = (cell + 0.5) / 16.0
            radius, angle = math.sqrt(s), 6.2831853 * (cell * 0.618034 % 1.0)
            a, b, c = flat[i, 0], flat[i, 1], flat[i, 2]
            # A basis that turns smoothly with the normal, most of all around walls and bodies:
            # neighbours then share out the same 16 directions, and their mean is even.
            if abs(c) < 0.9:
                shrink = 1 / math.sqrt(a * a + b * b)
                p, q, r = -b * shrink, a * shrink, 0.0
            else:
                shrink = 1 / math.sqrt(a * a + c * c)
                p, q, r = c * shrink, 0.0, -a * shrink
            dx, dy, dz = radius * math.cos(angle), radius * math.sin(angle), math.sqrt(1.0 - s)
            directions[j, 0] = dx * p + dy * (b * r - c * q) + dz * a
            directions[j, 1] = dx * q + dy * (c * p - a * r) + dz * b
            directions[j, 2] = dx * r + dy * (a * q - b * p) + dz * c
            for k in range(3):
                starts[j, k] = points[i, k] + OFFSET * flat[i, k]


@njit(cache=True, fastmath=True)
def spread_open(
    seen_open: Array,
    face: Array,
    smooth: Array,
    distance: Array,
    rows: int,
    columns: int,
    out: Array,
) -> None:
    """From one yes or no at every second sample to the share of open sky at each.

    First the mean over 4 x 4 rays that lie on about the same surface, then between the four nearest
    means, again only across the same surface.
    """
    height, width = (rows + 1) // 2, (columns + 1) // 2
    mean = np.empty(height * width, np.float32)
    for y in range(height):
        for x in range(width):
            j, i = y * width + x, 2 * y * columns + 2 * x
            if face[i] < 0:
                mean[j] = 1.0
                continue
            total, count = seen_open[j], np.float32(1)
            bound = f32(0.06) * distance[i]
            for dy in range(-2, 2):
                yy = y + dy
                if yy < 0 or yy >= height:
                    continue
                for dx in range(-2, 2):
                    xx = x + dx
                    if xx < 0 or xx >= width or (dx == 0 and dy == 0):
                        continue
                    n = 2 * yy * columns + 2 * xx
                    if face[n] < 0 or abs(distance[n] - distance[i]) > bound:
                        continue
                    alike = (
                        smooth[i, 0] * smooth[n, 0]
                        + smooth[i, 1] * smooth[n, 1]
                        + smooth[i, 2] * smooth[n, 2]
                    )
                    if alike > f32(0.8):
                        total += seen_open[yy * width + xx]
                        count += 1
            mean[j] = total / count
    for row in range(rows):
        for column in range(columns):
            i = row * columns + column
            if face[i] < 0:
                out[i] = 1.0
                continue
            y, x = row >> 1, column >> 1
            if not (row & 1 or column & 1):
                out[i] = f32(DARKEST) + f32(1 - DARKEST) * mean[y * width + x]
                continue
            total, weight = np.float32(0), np.float32(0)
            for yy in range(y, min(y + (row & 1), height - 1) + 1):
                for xx in range(x, min(x + (column & 1), width - 1) + 1):
                    n = 2 * yy * columns + 2 * xx
                    if face[n] < 0:
                        continue
                    near = np.float32(1e-3)
                    if abs(distance[n] - distance[i]) < f32(0.06) * distance[i]:
                        alike = (
                            smooth[i, 0] * smooth[n, 0]
                            + smooth[i, 1] * smooth[n, 1]
                            + smooth[i, 2] * smooth[n, 2]
                        )
                        if alike > f32(0.8):
                            near = np.float32(1)
                    total += near * mean[yy * width + xx]
                    weight += near
            value = total / weight if weight > 0 else ONE
            out[i] = f32(DARKEST) + f32(1 - DARKEST) * value
