"""The shader of all renderers: sun, sky light, texture, gloss and haze for one sample at a time.

Everything here is compiled and alike for all renderers. A compiled function calls only functions of its
own file: the compiler's cache does not notice changes elsewhere.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import carray, njit, types
from numba.extending import intrinsic

from scene.geometry import ROW
from scene.materials import MATERIALS, textures

MISS = -1
"""Face of a sample that sees the sky."""
OFFSET = 1e-2
"""Metres along the normal from a surface to the start of its next ray."""
DARKEST = 0.05
"""Share of the sky's light that reaches a surface from which no sky is seen."""
BOUNCE = 0.12
"""Share of the light on the ground that comes back up."""

Array = np.ndarray
f32 = np.float32
ZERO, HALF, ONE = f32(0), f32(0.5), f32(1)
"""Compiled code computes in doubles as soon as a plain number comes near; these keep it single."""


class Textures(NamedTuple):
    """Every material's texture at every level of detail, in one row of bytes."""

    texels: np.ndarray  # u8[materials, texels], level after level; 100 is a factor of 1
    start: np.ndarray  # i32[levels] first texel of a level
    size: np.ndarray  # i32[levels] texels along each side


@cache
def texture_levels() -> Textures:
    """The textures and their means over 2 x 2, 4 x 4, ... texels."""
    level = textures()
    levels = [level]
    while level.shape[1] > 1:
        n = level.shape[1] // 2
        level = level.reshape(len(level), n, 2, n, 2).mean(axis=(2, 4))
        levels.append(level)
    size = np.array([x.shape[1] for x in levels], np.int32)
    texels = np.concatenate([x.reshape(len(x), -1) for x in levels], axis=1)
    start = np.cumsum(size**2, dtype=np.int32) - size**2
    return Textures(np.clip(100 * texels + 0.5, 0, 255).astype(np.uint8), start, size)


@cache
def material_rows() -> np.ndarray:
    """f32[materials, 3]: tile (m), gloss, translucency."""
    return np.array([[m.tile, m.gloss, m.translucency] for m in MATERIALS], np.float32)


@intrinsic
def _pointer(typing_context: Any, address: Any) -> Any:
    """The float pointer that an integer ``address`` stands for."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], ir.PointerType(ir.FloatType()))

    return types.CPointer(types.float32)(address), generate


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
        row = carray(_pointer(surfaces[instance[i]]), (f + 1, ROW))[f]
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
        row = carray(_pointer(surfaces[instance[i]]), (f + 1, ROW))[f]
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


@njit(cache=True, fastmath=True)
def _sky(x: float, y: float, z: float, panorama: Array, out: Array) -> None:
    """Radiance of the sky along a unit direction that does not fall, see ``scene.sky.panorama``."""
    height, width = panorama.shape[0], panorama.shape[1]
    column = (f32(math.atan2(y, x)) * f32(1 / math.tau) + HALF) * f32(width) - HALF
    elevation = f32(math.asin(z if z < ONE else ONE)) * f32(2 / math.pi)
    row = min(max(f32(height) * f32(math.sqrt(elevation)) - HALF, ZERO), f32(height) - f32(1.001))
    c, r = int(column + ONE) - 1, int(row)  # cheaper than floor; column is over -1
    right, down = column - f32(c), row - f32(r)
    c0 = c % width
    c1 = (c0 + 1) % width
    w00, w01 = (ONE - right) * (ONE - down), right * (ONE - down)
    w10, w11 = (ONE - right) * down, right * down
    for k in range(3):
        out[k] = (
            panorama[r, c0, k] * w00
            + panorama[r, c1, k] * w01
            + panorama[r + 1, c0, k] * w10
            + panorama[r + 1, c1, k] * w11
        )


@njit(cache=True, fastmath=True)
def _texture(
    m: int, u: float, v: float, level: int, texels: Array, start: Array, size: Array
) -> np.float32:
    """Bilinear lookup at ``u``, ``v`` in tiles."""
    n = size[level]
    x, y = u * f32(n) - HALF, v * f32(n) - HALF
    fx, fy = int(x) - (x < ZERO), int(y) - (y < ZERO)  # cheaper than floor, and as good
    right, down = x - f32(fx), y - f32(fy)
    c0, r0 = fx & (n - 1), fy & (n - 1)
    c1, r1 = (c0 + 1) & (n - 1), (r0 + 1) & (n - 1)
    a, b = start[level] + r0 * n, start[level] + r1 * n
    top = f32(texels[m, a + c0]) * (ONE - right) + f32(texels[m, a + c1]) * right
    bottom = f32(texels[m, b + c0]) * (ONE - right) + f32(texels[m, b + c1]) * right
    return f32(0.01) * (top * (ONE - down) + bottom * down)


@njit(cache=True, fastmath=True)
def shade(
    face: Array,
    instance: Array,
    distance: Array,
    directions: Array,
    points: Array,
    flat: Array,
    smooth: Array,
    lit: Array,
    opened: Array,
    pixel_angle: np.float32,
    textured: bool,
    surfaces: Array,
    rows: Array,
    texels: Array,
    start: Array,
    size: Array,
    sun_direction: Array,
    sun: Array,
    ambient: Array,
    horizon: Array,
    haze: np.float32,
    wetness: np.float32,
    panorama: Array,
) -> Array:
    """Linear radiance f32[n, 3] towards the camera for n samples.

    ``lit`` is 1 where the sun is seen, ``opened`` the share of the sky that is seen, ``pixel_angle``
    the radians between samples; the rest as in ``Hits``, ``Visible``, ``Geometry`` and ``Sky``.
    """
    out = np.empty((face.shape[0], 3), np.float32)
    mirrored = np.empty(3, np.float32)
    ground_light = np.empty(3, np.float32)
    for k in range(3):
        ground_light[k] = f32(BOUNCE) * (sun[k] * max(sun_direction[2], ZERO) + ambient[k])
    for i in range(face.shape[0]):
        f = face[i]
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        if f < 0:
            _sky(dx, dy, max(dz, ZERO), panorama, out[i])
            continue
        row = carray(_pointer(surfaces[instance[i]]), (f + 1, ROW))[f]
        m = int(row[15])
        nx, ny, nz = smooth[i, 0], smooth[i, 1], smooth[i, 2]
        t = distance[i]
        toward = dx * nx + dy * ny + dz * nz
        steep = min(abs(toward), ONE)
        texture = ONE
        if textured:
            # Project along the dominant axis; instances start at different places in the texture.
            a, b = points[i, 0], -points[i, 2]
            if abs(flat[i, 2]) > f32(0.7):
                b = -points[i, 1]
            elif abs(flat[i, 0]) > abs(flat[i, 1]):
                a = points[i, 1]
            per_tile = ONE / rows[m, 0]
            # Texels in a pixel, squared: each level of detail quarters it.
            footprint = t * pixel_angle * f32(size[0]) * per_tile
            footprint *= footprint / max(steep, f32(0.02))
            level = 0
            while footprint > f32(2) and level < len(size) - 1:
                footprint *= f32(0.25)
                level += 1
            shift = f32(instance[i]) * f32(0.1446)  # of a tile
            texture = _texture(m, a * per_tile + shift, b * per_tile, level, texels, start, size)
        cosine = nx * sun_direction[0] + ny * sun_direction[1] + nz * sun_direction[2]
        through = rows[m, 2]
        direct = lit[i] * (max(cosine, ZERO) * (ONE - through) + f32(0.6) * abs(cosine) * through)
        up = HALF + HALF * nz
        gloss = rows[m, 1]
        wet = ZERO
        if wetness > ZERO and flat[i, 2] > f32(0.9) and points[i, 2] < f32(0.2):
            wet = wetness
            gloss = max(gloss, f32(0.05) * wet)
        if gloss > ZERO:
            graze = ONE - steep
            graze *= graze * graze * graze * graze
            gloss += (ONE - gloss) * graze * (f32(0.6) if wet == ZERO else f32(0.8) * wet)
            mx, my = dx - f32(2) * toward * nx, dy - f32(2) * toward * ny
            mz = dz - f32(2) * toward * nz
            _sky(mx, my, abs(mz), panorama, mirrored)
            # Low rays meet the street's other side rather than the sky.
            sky_share = min(max(mz * f32(3) + f32(0.1), f32(0.12)), ONE)
            sky_share *= f32(0.3) + f32(0.7) * opened[i]
            # A wet road is rough: only standing water mirrors clouds, the rest their mean.
            clear = ONE if wet == ZERO else min(max(f32(5) * wet - f32(4), ZERO), ONE)
            for k in range(3):
                blurred = HALF * (horizon[k] + ambient[k]) * texture
                mirrored[k] = sky_share * (
                    min(mirrored[k], f32(2.5)) * clear + blurred * (ONE - clear)
                )
        air = ONE - f32(math.exp(-t / haze))
        for k in range(3):
            albedo = min(row[12 + k] * texture, f32(0.95)) * (ONE - f32(0.45) * wet)
            light = sun[k] * direct + opened[i] * (ambient[k] * up + ground_light[k] * (ONE - up))
            radiance = albedo * light
            if gloss > ZERO:
                radiance = radiance * (ONE - gloss) + gloss * mirrored[k]
            out[i, k] = radiance * (ONE - air) + horizon[k] * air
    return out
