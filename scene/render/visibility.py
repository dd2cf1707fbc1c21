"""Geometry of each spot, and the rays that find its light: normals, points, sky rays.

All of it is compiled and shared by all renderers, which only trace the rays.
"""

from __future__ import annotations

import math

import numpy as np
from numba import carray

from scene.compiled import njit
from scene.render.address import float_pointer
from scene.render.buffers import Segments, Visible
from scene.render.geometry import ROW

OFFSET = 1e-2
"""Offset in metres along the normal at which rays from a surface start."""
REACH = 5.0
"""Distance in metres within which a surface blocks sky light."""
LEVEL = 0.02
"""Height in metres above the street from which descending rays hit it."""
DARKEST = 0.05
"""Share of the sky's light that reaches a surface without visible sky."""

Array = np.ndarray
f32 = np.float32
ZERO, ONE = f32(0), f32(1)
"""Compiled code computes in doubles as soon as a plain number comes near; these keep it single."""
ALIKE_NORMAL, ALIKE_DISTANCE = f32(0.8), f32(0.06)
"""Least cosine between normals, and largest relative difference of distances, on about the same surface."""
NEARBY = f32(0.2)
"""Weight of samples at about the same distance on another surface."""
BATCH = 256
"""Spots that are processed together."""
FAR_OFF = f32(1e9)
"""Distance of the sky in metres, for occlusion."""


@njit(cache=True, fastmath=True, error_model="numpy")
def look(view: Visible, surfaces: Array, pose: Array, rows: Array, sun_direction: Array) -> None:
    """Fill in the geometry of each spot: flat and smoothed normal, both towards the viewer, and position.

    Misses get an upward normal and the ray's origin. ``side`` is the side of the face where a ray to the sun
    starts: 1 the viewer's, -1 the other (leaves, which the sun shines through), 0 if none is needed: in the
    sky, and where a surface faces away from the sun.
    """
    origin, spots, hits = view.rays.origin, view.spots, view.hits
    directions, distance, sample = spots.directions, spots.distance, spots.sample
    instance, face, u, v = hits.instance, hits.face, hits.u, hits.v
    flat, smooth, points, side = view.flat, view.smooth, view.points, view.side
    sun0, sun1, sun2 = sun_direction[0], sun_direction[1], sun_direction[2]
    # Lookups are separate from arithmetic, which is vectorised. All buffers are one array, since the compiler
    # could not rule out that several arrays overlap.
    work = np.empty((16, BATCH), np.float32)
    fx, fy, fz, sx, sy, sz = work[0], work[1], work[2], work[3], work[4], work[5]
    dx, dy, dz, t, x, y, z = work[6], work[7], work[8], work[9], work[10], work[11], work[12]
    hit, clear, begins = work[13], work[14], work[15]
    origin0, origin1, origin2 = origin[0], origin[1], origin[2]
    for begin in range(0, sample.shape[0], BATCH):
        count = min(BATCH, sample.shape[0] - begin)
        for n in range(count):
            i, at = begin + n, sample[begin + n]
            f = face[at]
            dx[n], dy[n], dz[n] = directions[i, 0], directions[i, 1], directions[i, 2]
            if f < 0:
                fx[n] = fy[n] = sx[n] = sy[n] = t[n] = hit[n] = clear[n] = ZERO
                fz[n] = sz[n] = ONE
                continue
            j = instance[at]
            row = carray(float_pointer(surfaces[j]), (f + 1, ROW))[f]
            a, b, c = row[0], row[1], row[2]
            w = ONE - u[at] - v[at]
            p = w * row[3] + u[at] * row[6] + v[at] * row[9]
            q = w * row[4] + u[at] * row[7] + v[at] * row[10]
            r = w * row[5] + u[at] * row[8] + v[at] * row[11]
            fx[n] = pose[j, 0, 0] * a + pose[j, 0, 1] * b + pose[j, 0, 2] * c
            fy[n] = pose[j, 1, 0] * a + pose[j, 1, 1] * b + pose[j, 1, 2] * c
            fz[n] = pose[j, 2, 0] * a + pose[j, 2, 1] * b + pose[j, 2, 2] * c
            sx[n] = pose[j, 0, 0] * p + pose[j, 0, 1] * q + pose[j, 0, 2] * r
            sy[n] = pose[j, 1, 0] * p + pose[j, 1, 1] * q + pose[j, 1, 2] * r
            sz[n] = pose[j, 2, 0] * p + pose[j, 2, 1] * q + pose[j, 2, 2] * r
            t[n], hit[n], clear[n] = distance[i], ONE, rows[int(row[15]), 2]
        for n in range(count):
            a, b, c, p, q, r = fx[n], fy[n], fz[n], sx[n], sy[n], sz[n]
            shrink = ONE / f32(math.sqrt(max(p * p + q * q + r * r, f32(1e-12))))
            toward_flat = a * dx[n] + b * dy[n] + c * dz[n]
            toward_smooth = p * dx[n] + q * dy[n] + r * dz[n]
            # At a silhouette the smoothed normal may point away; then the flat one is used.
            leans = toward_flat * toward_smooth <= ZERO
            p, q, r = (
                a if leans else shrink * p, b if leans else shrink * q, c if leans else shrink * r,
            )  # fmt: skip
            turn = -ONE if toward_flat * hit[n] > ZERO else ONE
            by_face = turn * (a * sun0 + b * sun1 + c * sun2)
            by_normal = turn * (p * sun0 + q * sun1 + r * sun2)
            viewer_side = ONE if by_face > ZERO else ZERO
            one_sided = viewer_side if by_normal > ZERO else ZERO
            begins[n] = hit[n] * (viewer_side + viewer_side - ONE if clear[n] > ZERO else one_sided)
            fx[n], fy[n], fz[n] = turn * a, turn * b, turn * c
            sx[n], sy[n], sz[n] = turn * p, turn * q, turn * r
            x[n] = origin0 + t[n] * dx[n]
            y[n] = origin1 + t[n] * dy[n]
            z[n] = origin2 + t[n] * dz[n]
        for n in range(count):
            i = begin + n
            flat[i, 0], flat[i, 1], flat[i, 2] = fx[n], fy[n], fz[n]
            smooth[i, 0], smooth[i, 1], smooth[i, 2] = sx[n], sy[n], sz[n]
            points[i, 0], points[i, 1], points[i, 2] = x[n], y[n], z[n]
            side[i] = np.int8(begins[n])


@njit(cache=True, fastmath=True, error_model="numpy")
def sky_rays(
    view: Visible, columns: int, step: int, height: int, width: int, out: Segments
) -> None:
    """One cosine-distributed ray for every ``step``-th pixel along each axis, stratified over 4 x 4 of them.

    Rays that soon hit the street are not needed: they find no sky.
    """
    first, sample, face = view.spots.first, view.spots.sample, view.hits.face
    flat, points = view.flat, view.points
    starts, directions, needed = out.starts, out.directions, out.needed
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
            needed[j] = face[sample[i]] >= 0
            a, b, c = flat[i, 0], flat[i, 1], flat[i, 2]
            # A basis that rotates smoothly with the normal, above all around walls and bodies:
            # neighbours then share the same 16 directions, and their mean is even.
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
                needed[j] = 0


@njit(cache=True, fastmath=True, error_model="numpy")
def spread_open(
    is_open: Array, view: Visible, rows: int, columns: int, step: int, out: Array
) -> None:
    """The share of visible sky at each spot, from a binary value at every ``step``-th pixel.

    First the mean over 4 x 4 rays from about the same surface, then interpolation between the four nearest
    means, again only across the same surface.
    """
    first, sample, face = view.spots.first, view.spots.sample, view.hits.face
    smooth, distance = view.smooth, view.spots.distance
    height, width = (rows + step - 1) // step, (columns + step - 1) // step
    grid = np.empty((4, height, width), np.float32)  # normal and distance of these pixels
    for y in range(height):
        for x in range(width):
            i = first[step * (y * columns + x)]
            grid[0, y, x], grid[1, y, x], grid[2, y, x] = smooth[i, 0], smooth[i, 1], smooth[i, 2]
            grid[3, y, x] = distance[i] if face[sample[i]] >= 0 else FAR_OFF
    mean = _mean_open(is_open.reshape(height, width), grid)
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
    """Share of visible sky from the 4 x 4 rays around each, of those from about the same surface.

    Others at the same distance have a small weight: among leaves, hardly two rays start on one surface. The
    loop handles one neighbour at a time for a whole row, which is vectorised.
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
