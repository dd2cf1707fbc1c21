"""The shader of all renderers: sun, sky light, texture, gloss and haze for one sample at a time.

Everything here is compiled and alike for all renderers. A compiled function calls only functions of its
own file: the compiler's cache does not notice changes elsewhere.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numba import carray, njit

from scene.look.materials import MATERIALS, textures
from scene.render.address import float_pointer
from scene.render.geometry import ROW

MISS = -1
"""Face of a sample that sees the sky."""
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


@njit(cache=True, fastmath=True)
def _angle(y: float, x: float) -> np.float32:
    """``atan2`` to 1e-5, without its slow exactness: a polynomial in the smaller over the larger."""
    wide, high = abs(x), abs(y)
    steep = high > wide
    a = (wide if steep else high) / ((high if steep else wide) + f32(1e-20))
    s = a * a
    r = f32(0.05265332) - s * f32(0.01172120)
    r = f32(0.99997726) + s * (
        f32(-0.33262347) + s * (f32(0.19354346) + s * (f32(-0.11643287) + s * r))
    )
    r *= a
    if steep:
        r = f32(math.pi / 2) - r
    if x < ZERO:
        r = f32(math.pi) - r
    return -r if y < ZERO else r


@njit(cache=True, fastmath=True)
def _sky(x: float, y: float, z: float, panorama: Array, out: Array) -> None:
    """Radiance of the sky along a unit direction that does not fall, see ``scene.sky.sky.panorama``."""
    height, width = panorama.shape[0], panorama.shape[1]
    column = (_angle(y, x) * f32(1 / math.tau) + HALF) * f32(width) - HALF
    elevation = _angle(z, f32(math.sqrt(max(ONE - z * z, ZERO)))) * f32(2 / math.pi)
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
        row = carray(float_pointer(surfaces[instance[i]]), (f + 1, ROW))[f]
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
