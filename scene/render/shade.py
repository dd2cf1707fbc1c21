"""The shader of all renderers: sun, sky light, texture, gloss and haze of every spot.

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
BATCH, WORK = 256, 13
"""Spots that are shaded together, and the numbers that are kept of each meanwhile."""
LEVELS = 8
"""Levels of detail below the finest, at most."""
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
    first: Array,
    sample: Array,
    share: Array,
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
    brightest: np.float32,
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
    """Linear radiance f32[pixels, 3] towards the camera: of each pixel the mean over its samples.

    ``lit`` is 1 where the sun is seen, ``opened`` the share of the sky that is seen, ``pixel_angle``
    the radians between samples, ``brightest`` what no sample goes beyond; the rest as in ``Spots``,
    ``Hits``, ``Visible``, ``Geometry`` and ``Sky``.

    Spots are taken some at a time: what looks things up one by one, then the sums of all, which
    processors do many at a time.
    """
    pixels = first.shape[0] - 1
    out = np.zeros((pixels, 3), np.float32)
    ground_light = np.empty(3, np.float32)
    for k in range(3):
        ground_light[k] = f32(BOUNCE) * (sun[k] * max(sun_direction[2], ZERO) + ambient[k])
    work = np.empty((WORK, BATCH), np.float32)
    color, mirrored = np.empty((3, BATCH), np.float32), np.empty((3, BATCH), np.float32)
    u, v, footprint, steep, direct = work[0], work[1], work[2], work[3], work[4]
    up, texture, gloss, wet, sky_share = work[5], work[6], work[7], work[8], work[9]
    clear, t, open_sky = work[10], work[11], work[12]
    material, level = np.empty(BATCH, np.int32), np.empty(BATCH, np.int32)
    seen = np.empty(3, np.float32)
    pixel = 0
    for begin in range(0, sample.shape[0], BATCH):
        count = min(BATCH, sample.shape[0] - begin)
        for n in range(count):
            i = begin + n
            f, j = face[sample[i]], instance[sample[i]]
            dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
            open_sky[n] = opened[i]
            wet[n] = ZERO
            clear[n] = ONE
            texture[n] = ONE
            if f < 0:
                # All that is left of a spot in the sky is what it "mirrors".
                _sky(dx, dy, max(dz, ZERO), panorama, seen)
                material[n] = -1
                footprint[n] = t[n] = direct[n] = up[n] = ZERO
                steep[n] = gloss[n] = sky_share[n] = ONE
                for k in range(3):
                    color[k, n], mirrored[k, n] = ZERO, seen[k]
                continue
            row = carray(float_pointer(surfaces[j]), (f + 1, ROW))[f]
            m = int(row[15])
            material[n] = m
            for k in range(3):
                color[k, n], mirrored[k, n] = row[12 + k], ZERO
            nx, ny, nz = smooth[i, 0], smooth[i, 1], smooth[i, 2]
            toward = dx * nx + dy * ny + dz * nz
            steep[n] = min(abs(toward), ONE)
            # Project along the dominant axis; instances start at different places in the texture.
            a, b = points[i, 0], -points[i, 2]
            if abs(flat[i, 2]) > f32(0.7):
                b = -points[i, 1]
            elif abs(flat[i, 0]) > abs(flat[i, 1]):
                a = points[i, 1]
            per_tile = ONE / rows[m, 0]
            t[n] = distance[i]
            u[n] = a * per_tile + f32(j) * f32(0.1446)  # of a tile
            v[n] = b * per_tile
            width = t[n] * per_tile
            footprint[n] = width * width * share[i]
            cosine = nx * sun_direction[0] + ny * sun_direction[1] + nz * sun_direction[2]
            through = rows[m, 2]
            direct[n] = lit[i] * (
                max(cosine, ZERO) * (ONE - through) + f32(0.6) * abs(cosine) * through
            )
            up[n] = HALF + HALF * nz
            shine, sky_share[n] = rows[m, 1], ZERO
            if (wetness > ZERO) & (flat[i, 2] > f32(0.9)) & (points[i, 2] < f32(0.2)):
                wet[n] = wetness
                shine = max(shine, f32(0.05) * wetness)
                # A wet road is rough: only standing water mirrors clouds, the rest their mean.
                clear[n] = min(max(f32(5) * wetness - f32(4), ZERO), ONE)
            gloss[n] = shine
            if shine > ZERO:
                mx, my = dx - f32(2) * toward * nx, dy - f32(2) * toward * ny
                mz = dz - f32(2) * toward * nz
                if clear[n] > ZERO:
                    _sky(mx, my, min(abs(mz), ONE), panorama, seen)
                    for k in range(3):
                        mirrored[k, n] = min(seen[k], f32(2.5))
                # Low rays meet the street's other side rather than the sky.
                sky_share[n] = min(max(mz * f32(3) + f32(0.1), f32(0.12)), ONE)
                sky_share[n] *= f32(0.3) + f32(0.7) * opened[i]
        if textured:
            per_sample = pixel_angle * f32(size[0])
            per_sample *= per_sample
            for n in range(count):
                # Texels in a spot, squared: each level of detail quarters it.
                texels_seen = footprint[n] * per_sample / max(steep[n], f32(0.02))
                level[n] = 0
                most = f32(2)
                for _ in range(LEVELS):
                    level[n] += np.int32(texels_seen > most)
                    most *= f32(4)
            for n in range(count):
                if material[n] >= 0:
                    at = min(level[n], len(size) - 1)
                    texture[n] = _texture(material[n], u[n], v[n], at, texels, start, size)
        for n in range(count):
            graze = ONE - steep[n]
            graze *= graze * graze * graze * graze
            grown = (ONE - gloss[n]) * graze * (f32(0.6) if wet[n] == ZERO else f32(0.8) * wet[n])
            gloss[n] += grown if gloss[n] > ZERO else ZERO
            # exp(-t / haze) by its series, of a sixteenth of it.
            x = min(t[n] / haze, f32(16)) * f32(-1 / 16)
            x = ONE + x * (ONE + x * (HALF + x * (f32(1 / 6) + x * (f32(1 / 24) + x * f32(1 / 120)))))
            x *= x
            x *= x
            x *= x
            t[n] = x * x
        for k in range(3):
            for n in range(count):
                blurred = HALF * (horizon[k] + ambient[k]) * texture[n] * (ONE - clear[n])
                mirror = sky_share[n] * (mirrored[k, n] * clear[n] + blurred)
                albedo = min(color[k, n] * texture[n], f32(0.95)) * (ONE - f32(0.45) * wet[n])
                light = sun[k] * direct[n] + open_sky[n] * (
                    ambient[k] * up[n] + ground_light[k] * (ONE - up[n])
                )
                radiance = albedo * light * (ONE - gloss[n]) + gloss[n] * mirror
                color[k, n] = min(radiance * t[n] + horizon[k] * (ONE - t[n]), brightest)
        for n in range(count):
            i = begin + n
            while i >= first[pixel + 1]:
                pixel += 1
            for k in range(3):
                out[pixel, k] += share[i] * color[k, n]
    return out
