"""Sun, sky and haze of one street. Radiances are linear RGB; 1 is a white wall in full light."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from scene.compiled import njit
from scene.sky.clouds import cloud_relief
from scene.sky.weather import Range, sample_weather

SUN = 1.9
"""Irradiance of a nominal sun outside the air."""
SURROUNDINGS = 0.05
"""Share of the sun's light that sunlit walls and cars reflect, so that shade is not blue."""
BRIGHTEST = 4.0
"""Largest radiance of a sky, including the sun's disc."""
DISC = math.cos(math.radians(0.9))
"""Cosine at the edge of the sun's disc: three times as wide as the real one, so that columns hit it."""


class Sky(NamedTuple):
    """Light from above, as arrays and floats that all renderers read."""

    sun_direction: np.ndarray  # f32[3] unit vector towards the sun
    sun: np.ndarray  # f32[3] irradiance on a surface facing the sun
    zenith: np.ndarray  # f32[3] radiance straight up between clouds
    horizon: np.ndarray  # f32[3] radiance at the horizon, the colour of haze
    cloud: np.ndarray  # f32[3] mean radiance of a cloud
    cover: float  # share of the sky in cloud, 0 clear .. 1 overcast
    cloud_offset: np.ndarray  # f32[2] position of this sky in the cloud map
    haze: float  # metres after which 1/e of the light is left
    wetness: float  # of the road, 0 dry .. 1 standing water
    snow: float  # share of level ground covered by snow
    lamps: float  # brightness of lamps, 0 by day
    weather: str  # name of its row in ``SKIES``
    clouds: str  # kind of cloud map
    scale: float  # size of that map, in heights of the cloud base
    wind: float  # direction in which streaks are drawn out, radians
    lift: float  # how upright clouds stand at the horizon
    crisp: float  # sharpness of cloud edges
    opacity: float  # of thick cloud
    relief: float  # contrast of its bright and dark sides

    @property
    def ambient(self) -> np.ndarray:
        """Light f32[3] that a surface in a street gets from the sky and from sunlit surroundings.

        A clear sky is brightest at the horizon, where houses hide it; a grey one is brightest overhead.
        """
        clear = 0.55 * (0.5 * self.zenith + 0.5 * self.horizon)
        sky = (1 - self.cover) * clear + self.cover * 0.75 * self.cloud
        return (sky + SURROUNDINGS * self.sun).astype(np.float32)

    @property
    def single(self) -> Sky:
        """The sky for compiled code: all fields in single precision, 0 for names."""
        single: list[Any] = [np.float32(0 if isinstance(value, str) else value) for value in self]
        return Sky(*single)


def sample_sky(
    rng: np.random.Generator,
    *,
    intensity: float,
    elevation: float,
    azimuth: float,
    share: float = 1.0,
    closed: bool | None = None,
    weather_name: str = "",
) -> Sky:
    """Draw weather for a sun at the given angles (radians) and overall ``intensity`` (1 is nominal).

    The sun reddens and weakens towards the horizon; clouds take its light and return grey. All light is
    proportional to ``intensity``; see ``sample_weather`` for ``share``, ``closed`` and ``weather_name``.
    """
    weather = sample_weather(rng, elevation, share, closed, weather_name)
    height = math.sin(elevation)
    air = math.exp(-0.12 / max(height, 0.05))
    warm = np.array([1.0, 0.55 + 0.45 * air, 0.25 + 0.75 * air])
    sun = intensity * SUN * air * weather.sun * rng.uniform(0.85, 1.1) * warm
    day = 0.55 + 0.45 * math.sqrt(max(height, 0.0))
    level = intensity * day * math.exp(rng.normal(0, 0.12))
    tint = 1 + rng.normal(0, 0.03, 3)
    direction = [
        math.cos(elevation) * math.cos(azimuth),
        math.cos(elevation) * math.sin(azimuth),
        height,
    ]
    return Sky(
        sun_direction=np.array(direction, np.float32),
        sun=sun.astype(np.float32),
        zenith=(level * tint * weather.zenith).astype(np.float32),
        horizon=(level * tint * weather.horizon).astype(np.float32),
        cloud=(level * rng.uniform(0.85, 1.15) * tint * weather.cloud).astype(np.float32),
        cover=rng.uniform(*weather.cover),
        cloud_offset=rng.random(2).astype(np.float32),
        haze=_log_uniform(rng, weather.haze),
        wetness=rng.uniform(*weather.wetness),
        snow=weather.snow,
        lamps=weather.lamps,
        weather=weather.name,
        clouds=weather.clouds,
        scale=rng.uniform(*weather.scale),
        wind=rng.uniform(-math.pi, math.pi),
        lift=weather.lift,
        crisp=rng.uniform(*weather.crisp),
        opacity=weather.opacity,
        relief=weather.relief,
    )


def _log_uniform(rng: np.random.Generator, ends: Range) -> float:
    return float(np.exp(rng.uniform(math.log(ends[0]), math.log(ends[1]))))


def panorama(sky: Sky, columns: int) -> np.ndarray:
    """Radiance f32[columns // 4, columns, 3] of the upper half of the sky.

    Column c looks along azimuth -pi + 2 pi (c + 0.5) / columns (0 is +x, left positive), row r at
    elevation (pi / 2) ((r + 0.5) / rows)^2: row 0 is the horizon, where most of a street's sky is.
    """
    return _panorama(columns, sky.single, cloud_relief(sky.clouds))


@njit(cache=True, fastmath=True, error_model="numpy")
def _panorama(columns: int, sky: Sky, clouds: np.ndarray) -> np.ndarray:
    """Paint clouds on a plane overhead that bends down by ``lift``, so that distant ones still have flanks.

    The bright side of a cloud slopes up (seen from the street) or to the sun. Thin cloud lets the sun's glow
    through, which gives it a silver lining.
    """
    sun_direction, sun, zenith, horizon = sky.sun_direction, sky.sun, sky.zenith, sky.horizon
    cloud, cover, offset = sky.cloud, np.float32(sky.cover), sky.cloud_offset
    scale, wind, lift, crisp = sky.scale, sky.wind, sky.lift, sky.crisp
    opacity, relief = sky.opacity, sky.relief
    rows = columns // 4
    half, one, two, three = np.float32(0.5), np.float32(1), np.float32(2), np.float32(3)
    zero = np.float32(0)
    size = clouds.shape[0]
    far = 64 * size  # keeps places on the map positive
    mask = size - 1  # the size is a power of two
    out = np.empty((rows, columns, 3), np.float32)
    # Row by row; in a row, lookups are separate from arithmetic, which is vectorised. All buffers are one
    # array, since the compiler could not rule out that several arrays overlap.
    work = np.empty((14, columns), np.float32)
    east, north, u, v, row, column, sunward, thick, slope_u, slope_v = (
        work[0], work[1], work[2], work[3], work[4], work[5], work[6], work[7], work[8], work[9],
    )  # fmt: skip
    opaque, bright, glow, disc = work[10], work[11], work[12], work[13]
    cosine, sine = np.float32(math.cos(wind)), np.float32(math.sin(wind))
    closed = max(cover, zero) ** 4
    sun0, sun1, sun2 = sun_direction[0], sun_direction[1], sun_direction[2]
    for c in range(columns):
        azimuth = -math.pi + 2 * math.pi * (c + 0.5) / columns
        east[c], north[c] = math.cos(azimuth), math.sin(azimuth)
        # Rows of the map run along the wind.
        u[c], v[c] = east[c] * cosine + north[c] * sine, north[c] * cosine - east[c] * sine
    flat = np.float32(math.sqrt(sun0**2 + sun1**2))
    along, across = sun0 * cosine + sun1 * sine, sun1 * cosine - sun0 * sine
    start0, start1 = np.float32(offset[0] * size + far), np.float32(offset[1] * size + far)
    for r in range(rows):
        elevation = math.pi / 2 * ((r + 0.5) / rows) ** 2
        up, level = np.float32(math.sin(elevation)), np.float32(math.cos(elevation))
        fade = np.float32((one - up) ** 6)
        # Under closed cloud the sky is three times as bright overhead as at the horizon.
        graded = one - closed + closed * (three + two * three * up) / np.float32(7)
        mist = np.float32(math.exp(-elevation / 0.05))  # the last three degrees are haze
        reach = np.float32(level * (1 + lift) / (up + lift) * size / scale)
        for c in range(columns):
            sunward[c] = (east[c] * sun0 + north[c] * sun1) * level + up * sun2
            # Where the ray meets the clouds.
            row[c], column[c] = u[c] * reach + start0, v[c] * reach + start1
        for c in range(columns):
            r0, c0 = int(row[c]), int(column[c])
            fr, fc = row[c] - np.float32(r0), column[c] - np.float32(c0)
            r0, c0 = r0 & mask, c0 & mask
            r1, c1 = (r0 + 1) & mask, (c0 + 1) & mask
            w00, w01 = (one - fr) * (one - fc), (one - fr) * fc
            w10, w11 = fr * (one - fc), fr * fc
            thick[c] = (
                w00 * clouds[r0, c0, 0] + w01 * clouds[r0, c1, 0]
                + w10 * clouds[r1, c0, 0] + w11 * clouds[r1, c1, 0]
            )  # fmt: skip
            slope_u[c] = (
                w00 * clouds[r0, c0, 1] + w01 * clouds[r0, c1, 1]
                + w10 * clouds[r1, c0, 1] + w11 * clouds[r1, c1, 1]
            )  # fmt: skip
            slope_v[c] = (
                w00 * clouds[r0, c0, 2] + w01 * clouds[r0, c1, 2]
                + w10 * clouds[r1, c0, 2] + w11 * clouds[r1, c1, 2]
            )  # fmt: skip
        for c in range(columns):
            t = max(sunward[c], zero)
            t2 = t * t
            t8 = t2 * t2 * t2 * t2
            t32 = t8 * t8 * t8 * t8
            t128 = t32 * t32 * t32 * t32
            t512 = t128 * t128 * t128 * t128
            depth = thick[c] - (one - cover)
            cloudy = min(max(depth * crisp + half, zero), one)
            cloudy = cloudy * cloudy * (three - two * cloudy) * opacity
            # Thickness that grows outwards is the upper flank, as the plane is seen from below.
            flank = slope_u[c] * u[c] + slope_v[c] * v[c]
            lit = -(slope_u[c] * along + slope_v[c] * across)
            core = np.float32(0.55) * min(depth / (cover + np.float32(0.05)), one)
            opaque[c] = cloudy
            bright[c] = cloudy * (
                one + relief * (
                    np.float32(0.55) * flank + np.float32(0.4) * flat * lit
                    + np.float32(0.35) - core
                )
            )  # fmt: skip
            glow[c] = (one - np.float32(0.75) * cloudy) * (
                np.float32(0.10) * t8 + np.float32(0.16) * t32 + np.float32(0.35) * t512
            )
            edge = min((sunward[c] - np.float32(DISC)) * np.float32(20000) + half, one)
            disc[c] = two * max(edge, zero) * (one - cloudy)
        for k in range(3):
            base = zenith[k] * (one - fade) + horizon[k] * fade
            cloud_k, hazy, sun_k = cloud[k], horizon[k] * mist, sun[k]
            for c in range(columns):
                value = base * (one - opaque[c]) + graded * cloud_k * bright[c]
                value = value * (one - mist) + hazy + sun_k * (glow[c] + disc[c])
                out[r, c, k] = min(value, np.float32(BRIGHTEST))
    return out
