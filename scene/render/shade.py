"""The shader of all renderers: sun, sky light, texture, gloss and haze of every spot.

All of it is compiled and shared by all renderers.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import carray

from scene.cache import cached
from scene.classes import TrainId
from scene.compiled import njit
from scene.ground.build import GROUND_INSTANCES
from scene.look.materials import MATERIALS, material_id, textures
from scene.render.address import float_pointer
from scene.render.buffers import Light, Visible
from scene.render.geometry import ROW

if TYPE_CHECKING:
    from scene.sky.sky import Sky

MISS = -1
"""Face of a sample that hits the sky."""
BOUNCE = 0.15
"""Share of the light on the ground that is reflected upwards."""
OPPOSITE = 0.7
"""Radiance of the opposite side of the street in mirrors, relative to that of the ground."""

WHITE = (0.80, 0.83, 0.88)
"""Linear RGB of snow."""

Array = np.ndarray
f32 = np.float32
GLASS, LAMP = material_id("glass"), material_id("lamp")
LAMPLIGHT = (1.0, 0.72, 0.42)
"""Linear RGB of light from street lamps and windows."""
SHINE = 1.8
"""Radiance of a white lamp."""
LAMP_POWER = 16.0
"""Light of a lamp at a distance of one metre."""
LAMP_REACH = 45.0
"""Metres beyond which a lamp lights nothing."""
ROAD = next(k for k, train_id in GROUND_INSTANCES.items() if train_id == TrainId.ROAD)
HOUSES = 34
"""Number of houses of different heights around a mirror, with sky between them."""
BATCH, WORK = 256, 40
"""Spots that are shaded together, and the number of intermediate values of each."""
ZERO, HALF, ONE = f32(0), f32(0.5), f32(1)
"""Compiled code computes in doubles as soon as a plain number comes near; these keep it single."""


class Textures(NamedTuple):
    """The textures of all materials at every level of detail, one row of bytes per material."""

    texels: np.ndarray  # u8[materials, texels], level after level; 100 is a factor of 1
    start: np.ndarray  # i32[levels] first texel of a level
    size: np.ndarray  # i32[levels] texels along each side


@cache
def texture_levels() -> Textures:
    """The textures and their means over 2 x 2, 4 x 4, ... texels."""
    return Textures(**cached("textures", lambda: _make_levels()._asdict()))


def _make_levels() -> Textures:
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


@njit(cache=True, fastmath=True, error_model="numpy", inline="always")
def _angle(y: np.float32, x: np.float32) -> np.float32:
    """``atan2`` to 1e-5, but faster: a polynomial in the ratio of the smaller to the larger."""
    wide, high = abs(x), abs(y)
    a = min(wide, high) / (max(wide, high) + f32(1e-20))
    s = a * a
    r = f32(0.05265332) - s * f32(0.01172120)
    r = f32(0.99997726) + s * (
        f32(-0.33262347) + s * (f32(0.19354346) + s * (f32(-0.11643287) + s * r))
    )
    r *= a
    r = f32(math.pi / 2) - r if high > wide else r
    r = f32(math.pi) - r if x < ZERO else r
    return -r if y < ZERO else r


@njit(cache=True, fastmath=True, error_model="numpy", inline="always")
def _sky(column: np.float32, row: np.float32, panorama: Array, n: int, out: Array) -> None:
    """Radiance ``out[:, n]`` at a position in the panorama, see ``scene.sky.sky.panorama``."""
    width = panorama.shape[1]
    c, r = int(column + ONE) - 1, int(row)  # cheaper than floor; column is over -1
    right, down = column - f32(c), row - f32(r)
    c0 = c + width if c < 0 else c
    c1 = c0 + 1 if c0 + 1 < width else 0
    w00, w01 = (ONE - right) * (ONE - down), right * (ONE - down)
    w10, w11 = (ONE - right) * down, right * down
    for k in range(3):
        out[k, n] = (
            panorama[r, c0, k] * w00
            + panorama[r, c1, k] * w01
            + panorama[r + 1, c0, k] * w10
            + panorama[r + 1, c1, k] * w11
        )


@njit(cache=True, fastmath=True, error_model="numpy")
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


@njit(cache=True, fastmath=True, error_model="numpy")
def lamplight(points: Array, smooth: Array, lamps: Array, power: np.float32, out: Array) -> None:
    """Add the light of all lamps at ``points`` to ``out`` f32[spots], without shadows, mostly downwards."""
    for i in range(points.shape[0]):
        for j in range(lamps.shape[0]):
            x, y = lamps[j, 0] - points[i, 0], lamps[j, 1] - points[i, 1]
            z = lamps[j, 2] - points[i, 2]
            away = x * x + y * y + z * z + f32(0.25)
            if away < f32(LAMP_REACH * LAMP_REACH):
                near = ONE / f32(math.sqrt(away))
                facing = (x * smooth[i, 0] + y * smooth[i, 1] + z * smooth[i, 2]) * near
                down = f32(0.15) + f32(0.85) * max(z * near, ZERO)
                out[i] += power * f32(LAMP_POWER) * max(facing, ZERO) * down * near * near


@njit(cache=True, fastmath=True, error_model="numpy")
def shade(
    visible: Visible,
    lighting: Light,
    pixel_angle: np.float32,
    brightest: np.float32,
    textured: bool,
    surfaces: Array,
    rows: Array,
    textures: Textures,
    sky: Sky,
    ambient: Array,
    panorama: Array,
) -> Array:
    """Linear radiance f32[pixels, 3] towards the camera: the mean over the samples of each pixel.

    ``visible`` has points and normals on the road (see ``on_road``) and shares of a pixel; ``pixel_angle`` is
    the angle between pixels in radians, ``brightest`` the largest radiance of a sample; ``surfaces`` are
    those of ``Geometry``, ``rows`` those of materials, ``sky`` is in single precision (see ``Sky.single``).

    Spots are processed in batches: first lookups, one by one, then arithmetic, which is vectorised.
    """
    first, sample, share = visible.spots.first, visible.spots.sample, visible.spots.share
    distance, directions = visible.spots.distance, visible.spots.directions
    face, instance = visible.hits.face, visible.hits.instance
    points, flat, smooth = visible.points, visible.flat, visible.smooth
    lit, opened, glow = lighting.lit, lighting.opened, lighting.glow
    texels, start, size = textures.texels, textures.start, textures.size
    sun_direction, sun, horizon = sky.sun_direction, sky.sun, sky.horizon
    haze, wetness, snow = sky.haze, sky.wetness, sky.snow
    pixels = first.shape[0] - 1
    out = np.zeros((pixels, 3), np.float32)
    ground_light = np.empty(3, np.float32)
    for k in range(3):
        ground_light[k] = f32(BOUNCE) * (sun[k] * max(sun_direction[2], ZERO) + ambient[k])
    sun0, sun1, sun2 = sun_direction[0], sun_direction[1], sun_direction[2]
    # A wet road is rough: only standing water mirrors clouds, the rest mirrors their mean.
    water = min(max(f32(5) * wetness - f32(4), ZERO), ONE)
    per_sample = pixel_angle * f32(size[0])
    per_sample *= per_sample
    high, wide = f32(panorama.shape[0]), f32(panorama.shape[1])
    # All buffers are one array, since the compiler could not rule out that several arrays overlap.
    work = np.zeros((WORK, BATCH), np.float32)
    dx, dy, dz, nx, ny, nz, x, y, z = (
        work[0], work[1], work[2], work[3], work[4], work[5], work[6], work[7], work[8],
    )  # fmt: skip
    flat_x, flat_y, flat_z, t, light, sky_light, solid = (
        work[9], work[10], work[11], work[12], work[13], work[14], work[15],
    )  # fmt: skip
    tile, gloss, through, shift, u, v, level, up, wet, clear, air = (
        work[16], work[17], work[18], work[19], work[20], work[21], work[22], work[23], work[24],
        work[25], work[26],
    )  # fmt: skip
    sky_share, texture, column, row, size_of = work[27], work[28], work[29], work[30], work[31]
    color, mirrored, shone, shines = work[32:35], work[35:38], work[38], work[39]
    material = np.empty(BATCH, np.int32)
    pixel = 0
    for begin in range(0, sample.shape[0], BATCH):
        count = min(BATCH, sample.shape[0] - begin)
        for n in range(count):
            f, j = face[sample[begin + n]], instance[sample[begin + n]]
            i = begin + n
            dx[n], dy[n], dz[n] = directions[i, 0], directions[i, 1], directions[i, 2]
            nx[n], ny[n], nz[n] = smooth[i, 0], smooth[i, 1], smooth[i, 2]
            x[n], y[n], z[n] = points[i, 0], points[i, 1], points[i, 2]
            flat_x[n], flat_y[n], flat_z[n] = flat[i, 0], flat[i, 1], flat[i, 2]
            light[n], sky_light[n], size_of[n] = lit[i], opened[i], share[i]
            t[n], solid[n], texture[n] = distance[i], ONE, ONE
            if f < 0:
                # A spot in the sky shows only what it "mirrors".
                t[n], solid[n] = ZERO, ZERO
                material[n] = -1
                tile[n], gloss[n], through[n], shift[n] = ONE, ONE, ZERO, ZERO
                color[0, n] = color[1, n] = color[2, n] = ZERO
                continue
            of_face = carray(float_pointer(surfaces[j]), (f + 1, ROW))[f]
            m = int(of_face[15])
            material[n] = m
            tile[n], gloss[n], through[n] = rows[m, 0], rows[m, 1], rows[m, 2]
            shift[n] = f32(j) * f32(0.1446)  # of a tile
            color[0, n], color[1, n], color[2, n] = of_face[12], of_face[13], of_face[14]
        for n in range(count):
            toward = dx[n] * nx[n] + dy[n] * ny[n] + dz[n] * nz[n]
            steep = min(abs(toward), ONE)
            # Project along the dominant axis; instances start at different positions in the texture.
            level_one = flat_z[n] * flat_z[n] > f32(0.49)
            sideways = flat_x[n] * flat_x[n] > flat_y[n] * flat_y[n]
            per_tile = ONE / tile[n]
            px, py, pz = x[n], y[n], z[n]
            across = py if sideways else px
            u[n] = (px if level_one else across) * per_tile + shift[n]
            v[n] = -(py if level_one else pz) * per_tile
            width = t[n] * per_tile
            # Texels in a spot, squared: each level of detail quarters it.
            footprint = width * width * size_of[n] * per_sample / max(steep, f32(0.02))
            level[n] = (
                (ONE if footprint > f32(2) else ZERO) + (ONE if footprint > f32(8) else ZERO)
                + (ONE if footprint > f32(32) else ZERO) + (ONE if footprint > f32(128) else ZERO)
                + (ONE if footprint > f32(512) else ZERO) + (ONE if footprint > f32(2048) else ZERO)
                + (ONE if footprint > f32(8192) else ZERO)
                + (ONE if footprint > f32(32768) else ZERO)
            )  # fmt: skip
            cosine = nx[n] * sun0 + ny[n] * sun1 + nz[n] * sun2
            light[n] *= max(cosine, ZERO) * (ONE - through[n]) + f32(0.6) * abs(cosine) * through[n]
            up[n] = HALF + HALF * nz[n]
            damp = wetness if flat_z[n] > f32(0.9) else ZERO
            damp = damp if pz < f32(0.2) else ZERO
            damp *= solid[n]
            wet[n] = damp
            clear[n] = water if damp > ZERO else ONE
            shine = max(gloss[n], f32(0.05) * damp)
            graze = ONE - steep
            graze *= graze * graze * graze * graze
            graze *= f32(0.8) * damp if damp > ZERO else f32(0.6)
            grown = shine + (ONE - shine) * graze
            grown = grown if shine > ZERO else ZERO
            gloss[n] = grown if solid[n] > ZERO else ONE
            bounce = f32(2) * toward * solid[n]
            mx, my, mz = dx[n] - bounce * nx[n], dy[n] - bounce * ny[n], dz[n] - bounce * nz[n]
            # Low rays hit the opposite side of the street, houses of several heights, rather than the sky.
            turn = _angle(my, mx) * f32(1 / math.tau) + HALF
            house = int(turn * f32(HOUSES))
            eaves = f32(house * (house + 5) % 11) * f32(0.02)
            wall = min(max((mz - eaves) * f32(8) + f32(0.1), f32(0.12)), ONE)
            # Wet surfaces are level and rough, so they blur the houses.
            part = min(max(mz * f32(3) + f32(0.1), f32(0.12)), ONE)
            part = part if damp > ZERO else wall
            part *= f32(0.3) + f32(0.7) * sky_light[n]
            sky_share[n] = part if solid[n] > ZERO else ONE
            mz = min(max(mz, -mz * solid[n]), ONE)
            column[n] = turn * wide - HALF
            mz = max(mz, ZERO)
            rise = _angle(mz, f32(math.sqrt(max(ONE - mz * mz, ZERO)))) * f32(2 / math.pi)
            row[n] = min(max(high * f32(math.sqrt(rise)) - HALF, ZERO), high - f32(1.001))
            # exp(-t / haze) as the 16th power of the series of a sixteenth.
            e = min(t[n] / haze, f32(16)) * f32(-1 / 16)
            e = ONE + e * (
                ONE + e * (HALF + e * (f32(1 / 6) + e * (f32(1 / 24) + e * f32(1 / 120))))
            )
            e *= e
            e *= e
            e *= e
            air[n] = ONE - e * e
        for n in range(count):
            if (gloss[n] > ZERO) & (clear[n] > ZERO):
                _sky(column[n], row[n], panorama, n, mirrored)
        if textured:
            for n in range(count):
                if material[n] >= 0:
                    at = min(int(level[n]), len(size) - 1)
                    texture[n] = _texture(material[n], u[n], v[n], at, texels, start, size)
        if glow.shape[0] > 0:
            # Lamps emit light, and so do windows with drawn curtains.
            for n in range(count):
                shone[n] = glow[begin + n] * sky_light[n]
                curtain = (material[n] == GLASS) & (color[0, n] > f32(0.2))
                shines[n] = f32(SHINE) if material[n] == LAMP else (f32(0.35) if curtain else ZERO)
        if snow > ZERO:
            # Snow covers level surfaces; it is thin and patchy in wheel tracks and on uneven ground.
            for n in range(count):
                if material[n] >= 0 and flat_z[n] > f32(0.3):
                    cover = min((min(nz[n], flat_z[n]) - f32(0.3)) * f32(2.5), ONE)
                    cover *= snow + f32(1.5) * (texture[n] - ONE)
                    if instance[sample[begin + n]] == ROAD:
                        track = HALF + HALF * f32(math.cos(abs(y[n]) * f32(math.tau / 1.75)))
                        cover *= f32(0.9) - f32(0.75) * track
                    cover = min(max(cover, ZERO), ONE)
                    gloss[n] *= ONE - cover
                    texture[n] = texture[n] * (ONE - cover) + cover
                    for k in range(3):
                        color[k, n] = color[k, n] * (ONE - cover) + cover * f32(WHITE[k])
        for k in range(3):
            sun_k, above, below, hazy = sun[k], ambient[k], ground_light[k], horizon[k]
            mean = HALF * (hazy + above)
            for n in range(count):
                blurred = mean * texture[n] * (ONE - clear[n])
                mirror = mirrored[k, n] if solid[n] == ZERO else min(mirrored[k, n], f32(2.5))
                mirror = sky_share[n] * (mirror * clear[n] + blurred)
                mirror += (ONE - sky_share[n]) * sky_light[n] * f32(OPPOSITE) * below
                albedo = min(color[k, n] * texture[n], f32(0.95)) * (ONE - f32(0.45) * wet[n])
                received = sun_k * light[n] + sky_light[n] * (above * up[n] + below * (ONE - up[n]))
                received += shone[n] * f32(LAMPLIGHT[k])
                radiance = albedo * received * (ONE - gloss[n]) + gloss[n] * mirror
                radiance += shines[n] * f32(LAMPLIGHT[k]) * color[k, n]
                color[k, n] = min(radiance * (ONE - air[n]) + hazy * air[n], brightest)
        for n in range(count):
            i = begin + n
            while i >= first[pixel + 1]:
                pixel += 1
            for k in range(3):
                out[pixel, k] += share[i] * color[k, n]
    return out
