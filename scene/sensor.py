"""The camera's response: from linear radiance to the 8-bit image a real camera would store."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np


class CameraResponse(NamedTuple):
    """What stands between the scene and the file."""

    exposure: float = 1.0
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)  # white balance, per channel
    gamma: float = 1.0  # on top of sRGB; above 1 darkens the middle tones
    blur: float = 0.0  # sigma of the lens blur in pixels
    noise: float = 0.012  # standard deviation of sensor noise at mid grey, of full scale


def develop(radiance: np.ndarray, response: CameraResponse, rng: np.random.Generator) -> np.ndarray:
    """Linear radiance f32[h, w, 3] to an sRGB image u8[h, w, 3].

    The tone curve x / (1 + x^4)^(1/4) leaves shadows and middle tones alone and only bends the sky's
    last stop; noise is shot-like: it grows with the signal.
    """
    x = radiance * (np.asarray(response.gain, np.float32) * response.exposure)
    x = x / np.sqrt(np.sqrt(1 + x**4))
    srgb = np.where(x < 0.0031308, 12.92 * x, 1.055 * np.power(x, 1 / 2.4) - 0.055)
    if response.gamma != 1.0:
        srgb = np.power(srgb, response.gamma)
    if response.blur > 0:
        srgb = cv2.GaussianBlur(srgb, (0, 0), response.blur)
    if response.noise > 0:
        grain = rng.standard_normal(srgb.shape, dtype=np.float32)
        srgb = srgb + response.noise * np.sqrt(0.2 + 1.6 * srgb) * grain
    return (np.clip(srgb, 0, 1) * 255 + 0.5).astype(np.uint8)
