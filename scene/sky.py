"""Sun, sky and haze of one street. Radiances are linear RGB; 1 is a white wall in full light."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from scene.materials import fractal_noise

CLOUD_SIZE = 256
"""Pixels along each side of the tileable cloud map."""


class Sky(NamedTuple):
    """Light from above; plain arrays and floats, so that both renderers read the same."""

    sun_direction: np.ndarray  # f32[3] unit vector towards the sun
    sun: np.ndarray  # f32[3] irradiance on a surface facing the sun
    zenith: np.ndarray  # f32[3] radiance straight up
    horizon: np.ndarray  # f32[3] radiance at the horizon, the colour of haze
    cloud: np.ndarray  # f32[3] radiance of a cloud
    cover: float  # share of the sky in cloud, 0 clear .. 1 overcast
    cloud_offset: np.ndarray  # f32[2] where in the cloud map this sky lies
    haze: float  # metres over which all but 1/e of the light is lost

    @property
    def ambient(self) -> np.ndarray:
        """Light f32[3] that a surface in a street gets from the sky.

        A clear sky is brightest at the horizon, where houses hide it; a grey one overhead.
        """
        clear = 0.5 * self.zenith + 0.5 * self.horizon
        return ((1 - self.cover) * 0.55 * clear + self.cover * 0.75 * self.cloud).astype(np.float32)


def sample_sky(
    rng: np.random.Generator, *, intensity: float, elevation: float, azimuth: float
) -> Sky:
    """Draw weather for a sun at the given angles (radians) and overall ``intensity`` (1 is nominal).

    The sun reddens and weakens towards the horizon; clouds take its light and give back grey.
    """
    cover = float(np.clip(rng.beta(0.7, 0.7), 0, 1))
    height = math.sin(elevation)
    air = math.exp(-0.12 / max(height, 0.05))
    warm = np.array([1.0, 0.55 + 0.45 * air, 0.25 + 0.75 * air])
    sun = intensity * 1.9 * air * (1 - 0.93 * cover**1.5) * warm
    blue = np.array([0.45, 0.68, 1.05]) * rng.uniform(0.85, 1.25)
    pale = np.array([0.86, 0.93, 1.0]) * rng.uniform(1.2, 1.8)
    day = 0.55 + 0.45 * math.sqrt(max(height, 0.0))
    grey = rng.uniform(0.8, 1.6)
    direction = [
        math.cos(elevation) * math.cos(azimuth),
        math.cos(elevation) * math.sin(azimuth),
        height,
    ]
    return Sky(
        sun_direction=np.array(direction, np.float32),
        sun=sun.astype(np.float32),
        zenith=(intensity * day * blue).astype(np.float32),
        horizon=(intensity * day * (pale * (1 - 0.4 * cover) + 0.3 * cover)).astype(np.float32),
        cloud=(intensity * day * grey * np.array([1.0, 1.0, 1.03])).astype(np.float32),
        cover=cover,
        cloud_offset=rng.random(2).astype(np.float32),
        haze=float(np.exp(rng.uniform(math.log(500), math.log(3000)))),
    )


@cache
def cloud_map() -> np.ndarray:
    """Tileable cloud thickness f32[size, size] in [0, 1] (read-only)."""
    noise = fractal_noise(np.random.default_rng(41), CLOUD_SIZE, 4, 6)
    rank = np.argsort(np.argsort(noise, axis=None)).reshape(noise.shape)
    even = (rank / noise.size).astype(np.float32)  # so that a share ``cover`` of it is cloud
    even.setflags(write=False)
    return even


def sky_arrays(sky: Sky) -> tuple:
    """The sky as the plain tuple that compiled code takes, see ``shade.sky_radiance``."""
    return (
        sky.sun_direction, sky.sun, sky.zenith, sky.horizon, sky.cloud,
        np.float32(sky.cover), sky.cloud_offset, cloud_map(),
    )  # fmt: skip
