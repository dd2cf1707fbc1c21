"""What lies at each spot and what light can reach it: normals, points, and the rays that ask.

Everything here is compiled and alike for all renderers; they only answer the rays. A compiled function calls
only functions of its own file: the compiler's cache does not notice changes elsewhere.
"""

from __future__ import annotations

import math

import numpy as np
from numba import carray, njit

from scene.render.address import float_pointer
from scene.render.geometry import ROW

OFFSET = 1e-2
"""Metres along the normal from a surface to the start of its next ray."""
REACH = 5.0
"""Metres within which a surface takes sky light away."""
LEVEL = 0.02
"""Metres above the street from which on rays that fall meet it."""
DARKEST = 0.05
"""Share of the sky's light that reaches a surface from which no sky is seen."""

Array = np.ndarray
f32 = np.float32
ZERO, ONE = f32(0), f32(1)
"""Compiled code computes in doubles as soon as a plain number comes near; these keep it single."""
ALIKE_NORMAL, ALIKE_DISTANCE = f32(0.8), f32(0.06)
"""Least cosine between normals, and most distance in distances, of samples on about the same surface."""
NEARBY = f32(0.2)
"""What samples about as far away count that lie on another surface."""
FAR_OFF = f32(1e9)
"""Metres to the sky, as far as occlusion goes."""


@njit(cache=True, fastmath=True, error_model="numpy")
def look(
    origin: Array,
    directions: Array,
    distance: Array,
    sample: Array,
    instance: Array,
    face: Array,
    u: Array,
    v: Array,
    surfaces: Array,
    pose: Array,
    rows: Array,
    sun_direction: Array,
    flat: Array,
    smooth: Array,
    points: Array,
    side: Array,
) -> None:
    """What each spot is: the face's own normal, the smoothed one, both towards the viewer, the point.

    Misses get an upward normal and the ray's origin. ``side`` says on which side of the face a ray to the
    sun begins: 1 the viewer's, -1 the other (leaves, which the sun shines through), 0 where none is
    needed: in the sky, and where a surface faces away from the sun.
    """
    sun0, sun1, sun2 = sun_direction[0], sun_direction[1], sun_direction[2]
    for i in range(sample.shape[0]):
        f = face[sample[i]]
        if f < 0:
            for k in range(3):
                flat[i, k] = smooth[i, k] = ONE if k == 2 else ZERO
                points[i, k] = origin[k]
            side[i] = 0
            continue
        j = instance[sample[i]]
        row = carray(float_pointer(surfaces[j]), (f + 1, ROW))[f]
        second, third = u[sample[i]], v[sample[i]]
        w = ONE - second - third
        a, b, c = row[0], row[1], row[2]
        p = w * row[3] + second * row[6] + third * row[9]
        q = w * row[4] + second * row[7] + third * row[10]
        r = w * row[5] + second * row[8] + third * row[11]
        shrink = ONE / f32(math.sqrt(max(p * p + q * q + r * r, f32(1e-12))))
        p, q, r = shrink * p, shrink * q, shrink * r
        fx = pose[j, 0, 0] * a + pose[j, 0, 1] * b + pose[j, 0, 2] * c
        fy = pose[j, 1, 0] * a + pose[j, 1, 1] * b + pose[j, 1, 2] * c
        fz = pose[j, 2, 0] * a + pose[j, 2, 1] * b + pose[j, 2, 2] * c
        sx = pose[j, 0, 0] * p + pose[j, 0, 1] * q + pose[j, 0, 2] * r
        sy = pose[j, 1, 0] * p + pose[j, 1, 1] * q + pose[j, 1, 2] * r
        sz = pose[j, 2, 0] * p + pose[j, 2, 1] * q + pose[j, 2, 2] * r
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        toward_flat = fx * dx + fy * dy + fz * dz
        toward_smooth = sx * dx + sy * dy + sz * dz
        if toward_flat * toward_smooth <= ZERO:
            # At a silhouette the smoothed normal may lean away; then it is the flat one.
            sx, sy, sz = fx, fy, fz
        turn = -ONE if toward_flat > ZERO else ONE
        fx, fy, fz, sx, sy, sz = turn * fx, turn * fy, turn * fz, turn * sx, turn * sy, turn * sz
        t = distance[i]
        flat[i, 0], flat[i, 1], flat[i, 2] = fx, fy, fz
        smooth[i, 0], smooth[i, 1], smooth[i, 2] = sx, sy, sz
        points[i, 0] = origin[0] + t * dx
        points[i, 1] = origin[1] + t * dy
        points[i, 2] = origin[2] + t * dz
        by_face = fx * sun0 + fy * sun1 + fz * sun2
        by_normal = sx * sun0 + sy * sun1 + sz * sun2
        if rows[int(row[15]), 2] > ZERO:
            side[i] = 1 if by_face >= ZERO else -1
        else:
            side[i] = 1 if (by_face > ZERO) & (by_normal > ZERO) else 0


@njit(cache=True, fastmath=True, error_model="numpy")
def sky_rays(
    first: Array,
    sample: Array,
    face: Array,
    flat: Array,
    points: Array,
    columns: int,
    step: int,
    height: int,
    width: int,
    starts: Array,
    directions: Array,
    wanted: Array,
) -> None:
    """One cosine-distributed ray for every ``step``-th pixel each way, stratified over 4 x 4 of them.

    Rays that soon fall on the street are not wanted: no sky is there.
    """
    local = np.empty((16, 3), np.float32)
    for cell in range(16):
        # Low-discrepancy pair over the 16 cells of a block.
        s = (cell + 0.5) / 16.0
        radius, angle = math.sqrt(s), 6.2831853 * (cell * 0.618034 % 1.0)
        local[cell, 0], local[cell, 1] = radius * math.cos(angle), radius * math.sin(angle)
        local[cell, 2] = math.sqrt(1.0 - s)
    for y in range(height):
        for x in range(width):
            j, i = y * width + x, first[step * (y * columns + x)]
            wanted[j] = face[sample[i]] >= 0
            a, b, c = flat[i, 0], flat[i, 1], flat[i, 2]
            # A basis that turns smoothly with the normal, most of all around walls and bodies:
            # neighbours then share out the same 16 directions, and their mean is even.
            p, q, r = ZERO, ZERO, ZERO
            if abs(c) < f32(0.9):
                shrink = ONE / f32(math.sqrt(a * a + b * b))
                p, q = -b * shrink, a * shrink
            else:
                shrink = ONE / f32(math.sqrt(a * a + c * c))
                p, r = c * shrink, -a * shrink
            cell = (x & 3) + 4 * (y & 3)
            dx, dy, dz = local[cell, 0], local[cell, 1], local[cell, 2]
            directions[j, 0] = dx * p + dy * (b * r - c * q) + dz * a
            directions[j, 1] = dx * q + dy * (c * p - a * r) + dz * b
            directions[j, 2] = dx * r + dy * (a * q - b * p) + dz * c
            for k in range(3):
                starts[j, k] = points[i, k] + f32(OFFSET) * flat[i, k]
            if f32(LEVEL) < starts[j, 2] < -f32(REACH) * directions[j, 2]:
                wanted[j] = 0


@njit(cache=True, fastmath=True, error_model="numpy")
def spread_open(
    seen_open: Array,
    first: Array,
    sample: Array,
    face: Array,
    smooth: Array,
    distance: Array,
    rows: int,
    columns: int,
    step: int,
    out: Array,
) -> None:
    """From one yes or no at every ``step``-th pixel to the share of open sky at each spot.

    First the mean over 4 x 4 rays that lie on about the same surface, then between the four nearest
    means, again only across the same surface.
    """
    height, width = (rows + step - 1) // step, (columns + step - 1) // step
    grid = np.empty((4, height, width), np.float32)  # normal and distance of these pixels
    for y in range(height):
        for x in range(width):
            i = first[step * (y * columns + x)]
            grid[0, y, x], grid[1, y, x], grid[2, y, x] = smooth[i, 0], smooth[i, 1], smooth[i, 2]
            grid[3, y, x] = distance[i] if face[sample[i]] >= 0 else FAR_OFF
    mean = _mean_open(seen_open.reshape(height, width), grid)
    for row in range(rows):
        y0 = row // step
        y1 = min(y0 + int(row % step > 0), height - 1)
        for column in range(columns):
            x0 = column // step
            x1 = min(x0 + int(column % step > 0), width - 1)
            p = row * columns + column
            even = mean[y0, x0]
            if (mean[y0, x1] == even) & (mean[y1, x0] == even) & (mean[y1, x1] == even):
                for i in range(first[p], first[p + 1]):
                    out[i] = even if face[sample[i]] >= 0 else ONE
                continue
            for i in range(first[p], first[p + 1]):
                if face[sample[i]] < 0:
                    out[i] = ONE
                    continue
                a, b, c, t = smooth[i, 0], smooth[i, 1], smooth[i, 2], distance[i]
                bound = ALIKE_DISTANCE * t
                total, weight = ZERO, ZERO
                for yy in range(y0, y1 + 1):
                    for xx in range(x0, x1 + 1):
                        alike = a * grid[0, yy, xx] + b * grid[1, yy, xx] + c * grid[2, yy, xx]
                        same = (alike > ALIKE_NORMAL) & (abs(grid[3, yy, xx] - t) < bound)
                        close = abs(grid[3, yy, xx] - t) < bound
                        near = ONE if same else (NEARBY if close else f32(1e-3))
                        near = near if grid[3, yy, xx] < FAR_OFF else ZERO
                        total += near * mean[yy, xx]
                        weight += near
                out[i] = total / weight if weight > ZERO else ONE


@njit(cache=True, fastmath=True, error_model="numpy")
def _mean_open(free: Array, grid: Array) -> Array:
    """Share of open sky from the 4 x 4 rays around each, of those on about the same surface.

    Others as far away count a little: among leaves hardly two rays start on one surface. One neighbour at a
    time for a whole row, which processors do many columns at a time.
    """
    height, width = free.shape
    mean = np.empty((height, width), np.float32)
    count = np.empty(width, np.float32)
    for y in range(height):
        total = mean[y]
        total[:] = free[y]
        count[:] = ONE
        for yy in range(max(y - 2, 0), min(y + 2, height)):
            for dx in range(-2, 2):
                if yy == y and dx == 0:
                    continue
                for x in range(max(0, -dx), min(width, width - dx)):
                    alike = (
                        grid[0, y, x] * grid[0, yy, x + dx]
                        + grid[1, y, x] * grid[1, yy, x + dx]
                        + grid[2, y, x] * grid[2, yy, x + dx]
                    )
                    apart = abs(grid[3, yy, x + dx] - grid[3, y, x])
                    weight = ONE if alike > ALIKE_NORMAL else NEARBY
                    weight = weight if apart <= ALIKE_DISTANCE * grid[3, y, x] else ZERO
                    total[x] += weight * free[yy, x + dx]
                    count[x] += weight
        for x in range(width):
            total[x] = f32(DARKEST) + f32(1 - DARKEST) * total[x] / count[x]
    return mean
