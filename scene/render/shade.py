"""The shader of all renderers: sun, sky light, texture, gloss and haze for one sample at a time."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numba import njit

from scene.materials import MATERIALS, TEXTURE_SIZE, textures
from scene.sky import Sky, sky_arrays

MISS = -1

Array = np.ndarray


@cache
def texture_levels() -> np.ndarray:
    """Mip levels f32[materials, levels, size, size]; level k is blurred over 2^k texels."""
    base = textures()
    levels = [base]
    for k in range(1, int(math.log2(TEXTURE_SIZE)) + 1):
        n = TEXTURE_SIZE >> k
        small = base.reshape(len(base), n, 1 << k, n, 1 << k).mean(axis=(2, 4))
        levels.append(small.repeat(1 << k, axis=1).repeat(1 << k, axis=2))
    return np.stack(levels, axis=1).astype(np.float32)


@cache
def material_rows() -> np.ndarray:
    """f32[materials, 3]: tile (m), gloss, translucency."""
    return np.array([[m.tile, m.gloss, m.translucency] for m in MATERIALS], np.float32)


@njit(cache=True, fastmath=True)
def sky_radiance(direction: Array, sky: tuple, out: Array) -> None:
    """Radiance of ``sky`` (see ``sky_arrays``) along one unit ``direction``, written to ``out`` [3]."""
    sun_direction, sun, zenith, horizon, cloud, cover, offset, clouds = sky
    up = max(direction[2], 0.0)
    fade = (1.0 - up) ** 4
    toward = (
        direction[0] * sun_direction[0]
        + direction[1] * sun_direction[1]
        + direction[2] * sun_direction[2]
    )
    glow = max(toward, 0.0) ** 24 * 0.35
    # Clouds on a plane overhead, thinning into haze at the horizon.
    size = clouds.shape[0]
    reach = 0.16 / (up + 0.12)
    row = (direction[0] * reach + offset[0]) * size
    column = (direction[1] * reach + offset[1]) * size
    r, c = math.floor(row), math.floor(column)
    fr, fc = row - r, column - c
    r0, c0 = int(r) % size, int(c) % size
    r1, c1 = (r0 + 1) % size, (c0 + 1) % size
    thick = (clouds[r0, c0] * (1 - fc) + clouds[r0, c1] * fc) * (1 - fr) + (
        clouds[r1, c0] * (1 - fc) + clouds[r1, c1] * fc
    ) * fr
    edge = (thick - (1.0 - cover)) * 5.0 + 0.5
    opaque = min(max(edge, 0.0), 1.0) * (1.0 - 0.5 * fade)
    body = 1.12 - 0.35 * thick
    for k in range(3):
        clear = zenith[k] * (1 - fade) + horizon[k] * fade + glow * sun[k]
        out[k] = clear * (1 - opaque) + (cloud[k] * body + 0.5 * glow * sun[k]) * opaque


@njit(cache=True, fastmath=True)
def _sky_image(directions: Array, sky: tuple) -> Array:
    image = np.empty((directions.shape[0], 3), np.float32)
    for i in range(directions.shape[0]):
        sky_radiance(directions[i], sky, image[i])
    return image


def sky_image(sky: Sky, directions: np.ndarray) -> np.ndarray:
    """Radiance f32[n, 3] of the sky along unit ``directions`` f32[n, 3]."""
    return _sky_image(directions, sky_arrays(sky))


@njit(cache=True, fastmath=True)
def facing_normals(faces: Array, directions: Array, normals: Array, out: Array) -> None:
    """Normal of each hit face turned towards the viewer; faces < 0 (misses) are left out."""
    for i in range(faces.shape[0]):
        f = faces[i]
        if f < 0:
            continue
        dot = (
            directions[i, 0] * normals[f, 0]
            + directions[i, 1] * normals[f, 1]
            + directions[i, 2] * normals[f, 2]
        )
        sign = -1.0 if dot > 0 else 1.0
        for k in range(3):
            out[i, k] = sign * normals[f, k]


@njit(cache=True, fastmath=True)
def occlusion_directions(normals: Array, width: int, out: Array) -> None:
    """One cosine-distributed direction per sample, stratified over every 4x4 block of samples."""
    for i in range(normals.shape[0]):
        x, y = i % width, i // width
        cell = (x & 3) + 4 * (y & 3)
        # Low-discrepancy pair over the 16 cells of a block (bit-reversed and golden-ratio steps).
        u = (cell + 0.5) / 16.0
        v = cell * 0.618034 % 1.0
        radius, angle = math.sqrt(u), 6.2831853 * v
        a, b, c = normals[i, 0], normals[i, 1], normals[i, 2]
        # Branchless orthonormal basis (Duff et al. 2017).
        sign = 1.0 if c >= 0 else -1.0
        p = -1.0 / (sign + c)
        q = a * b * p
        dx, dy, dz = radius * math.cos(angle), radius * math.sin(angle), math.sqrt(1.0 - u)
        out[i, 0] = dx * (1.0 + sign * a * a * p) + dy * q + dz * a
        out[i, 1] = dx * sign * q + dy * (sign + b * b * p) + dz * b
        out[i, 2] = -dx * sign * a - dy * b + dz * c


@njit(cache=True, fastmath=True)
def smooth_open(
    opened: Array, faces: Array, normals: Array, depth: Array, height: int, width: int, out: Array
) -> None:
    """Mean over the 4x4 window of samples that lie on about the same surface."""
    for y in range(height):
        for x in range(width):
            i = y * width + x
            if faces[i] < 0:
                out[i] = 1.0
                continue
            total, count = 0.0, 0
            for dy in range(-2, 2):
                for dx in range(-2, 2):
                    yy, xx = y + dy, x + dx
                    if yy < 0 or yy >= height or xx < 0 or xx >= width:
                        continue
                    j = yy * width + xx
                    if faces[j] < 0 or abs(depth[j] - depth[i]) > 0.06 * depth[i]:
                        continue
                    alike = (
                        normals[i, 0] * normals[j, 0]
                        + normals[i, 1] * normals[j, 1]
                        + normals[i, 2] * normals[j, 2]
                    )
                    if alike > 0.8:
                        total += opened[j]
                        count += 1
            out[i] = total / max(count, 1)


@njit(cache=True, fastmath=True)
def shade(
    faces: Array,
    distance: Array,
    directions: Array,
    origin: Array,
    normals: Array,
    lit: Array,
    opened: Array,
    pixel_angle: np.float32,
    textured: bool,
    face_color: Array,
    face_material: Array,
    face_instance: Array,
    tile_gloss: Array,
    levels: Array,
    ambient: Array,
    haze: np.float32,
    sky: tuple,
) -> Array:
    """Linear radiance f32[n, 3] towards the camera for n samples.

    ``faces`` i32[n] (MISS for sky), ``distance`` f32[n] metres, ``lit`` f32[n] 1 where the sun is
    seen, ``opened`` f32[n] share of the sky that is seen, ``pixel_angle`` radians between samples.
    """
    sun_direction, sun, _, horizon, _, _, _, _ = sky
    out = np.empty((faces.shape[0], 3), np.float32)
    mirrored = np.empty(3, np.float32)
    mirror = np.empty(3, np.float32)
    size = levels.shape[2]
    for i in range(faces.shape[0]):
        f = faces[i]
        if f < 0:
            sky_radiance(directions[i], sky, out[i])
            continue
        m = face_material[f]
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        t = distance[i]
        px = origin[0] + t * directions[i, 0]
        py = origin[1] + t * directions[i, 1]
        pz = origin[2] + t * directions[i, 2]
        facing = abs(directions[i, 0] * nx + directions[i, 1] * ny + directions[i, 2] * nz)
        texture = 1.0
        if textured:
            # Project along the dominant axis; instances start at different places in the texture.
            if abs(nz) > 0.7:
                u, v = px, py
            elif abs(nx) > abs(ny):
                u, v = py, pz
            else:
                u, v = px, pz
            scale = size / tile_gloss[m, 0]
            footprint = t * pixel_angle * scale / math.sqrt(max(facing, 0.02))
            level = min(max(int(math.log2(max(footprint, 1.0)) + 0.5), 0), levels.shape[1] - 1)
            shift = (face_instance[f] * 37) % size
            column = int(math.floor(u * scale) + shift) % size
            row = math.floor(-v * scale) % size
            texture = levels[m, level, row, column]
        cosine = nx * sun_direction[0] + ny * sun_direction[1] + nz * sun_direction[2]
        through = tile_gloss[m, 2]
        direct = lit[i] * (max(cosine, 0.0) * (1 - through) + 0.6 * abs(cosine) * through)
        up = 0.5 + 0.5 * nz
        gloss = tile_gloss[m, 1]
        if gloss > 0:
            gloss = gloss + (1 - gloss) * (1 - facing) ** 5 * 0.6
            dot = 2 * (directions[i, 0] * nx + directions[i, 1] * ny + directions[i, 2] * nz)
            mirror[0] = directions[i, 0] - dot * nx
            mirror[1] = directions[i, 1] - dot * ny
            mirror[2] = directions[i, 2] - dot * nz
            sky_radiance(mirror, sky, mirrored)
            if mirror[2] < 0.05:  # mirrors the street rather than the sky
                for k in range(3):
                    mirrored[k] *= 0.25
        air = 1.0 - math.exp(-t / haze)
        for k in range(3):
            albedo = min(face_color[f, k] * texture, 0.95)
            bounce = (0.14 * (sun[k] * max(sun_direction[2], 0.0) + ambient[k])) * (1 - up)
            light = sun[k] * direct + opened[i] * (ambient[k] * up + bounce)
            radiance = albedo * light
            if gloss > 0:
                radiance = radiance * (1 - gloss) + gloss * mirrored[k] * (0.3 + 0.7 * opened[i])
            out[i, k] = radiance * (1 - air) + horizon[k] * air
    return out
