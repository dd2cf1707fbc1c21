"""The camera's response: from linear radiance to the 8-bit image a real camera would store."""

from __future__ import annotations

import math
from functools import cache, lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from scene.compiled import njit
from scene.streams import table_row

KEY = 0.44
"""Mean radiance of a scene that the meter does not change."""
BRIGHTEST = 2.0
"""The meter clips radiance here, or a visible sun would turn day into night."""
MIDDLE = 0.18
"""Radiance that contrast does not change."""
WHITE = 3.0
"""Radiance, after contrast, at which the tone curve saturates."""
TONES = 4096
"""Entries of the tone table, evenly spaced in the square root of radiance."""
MOST = 4.0
"""Radiance at the end of the tone table."""
GRAIN = 512
"""Pixels along each side of the noise tile."""


class CameraResponse(NamedTuple):
    """The camera between scene and file; a defect at 0 is off.

    The defaults bring renders between the tones of real sets: grey has a mean of 107 in CamVid's 0016E5
    (day, sky blown out), 59 in its 0001TP (dusk) and 117 in LabelMeFacade (skies with colour).
    ``python -m benchmarks.transfer --only tones`` compares class by class.
    """

    exposure: float = 1.0
    gain: tuple[float, float, float] = (0.98, 1.0, 1.02)  # white balance, per channel
    gamma: float = 1.0  # on top of sRGB; above 1 darkens the middle tones
    blur: float = 0.0  # sigma of the lens blur in pixels
    noise: float = 0.003  # standard deviation of sensor noise at mid grey, as a share of full scale
    meter: float = 0.6  # share (in stops) of a scene's brightness that exposure compensates
    contrast: float = 1.3  # slope of the tone curve in the middle; 1 is plain sRGB
    saturation: float = 1.0  # 0 is grey, 1 as in the scene
    vignette: float = 0.06  # share of light lost in the corners
    fringe: float = 0.0  # pixels by which red is larger than blue in the corners
    halo: float = 0.1  # strength of the sharpening
    jpeg: int = 0  # quality 1..100; 0 stores without loss
    variation: float = 1.0  # between streets, see ``camera_of_street``; 0 gives all the same


def camera_of_street(response: CameraResponse, rng: np.random.Generator) -> CameraResponse:
    """One street's camera around ``response``: each value times a random factor near 1.

    Effects that are off stay off. A variation of 0 returns ``response`` itself.
    """
    s = response.variation
    if s == 0:
        return response
    bend = np.exp(s * rng.normal(0, 1, 9) * (0.3, 0.05, 0.05, 0.3, 0.4, 0.08, 0.12, 0.4, 0.4))
    bend = np.clip(bend, 0.25, 4.0).tolist()
    red, green, blue = response.gain
    quality = response.jpeg + s * rng.uniform(-12, 6)
    return response._replace(
        exposure=response.exposure * bend[0],
        gain=(red * bend[1], green, blue * bend[2]),
        blur=response.blur * bend[3],
        noise=response.noise * bend[4],
        contrast=response.contrast * bend[5],
        saturation=response.saturation * bend[6],
        vignette=min(response.vignette * bend[7], 1.0),
        fringe=response.fringe * bend[8],
        jpeg=int(np.clip(quality, 1, 100)) if response.jpeg else 0,
    )


def set_to(response: CameraResponse, exposure: float, warmth: float) -> CameraResponse:
    """The response with ``exposure`` times the light, and ``warmth`` stops more red than blue."""
    red, green, blue = response.gain
    bend = 2 ** (warmth / 2)
    return response._replace(
        exposure=response.exposure * exposure, gain=(red * bend, green, blue / bend)
    )


def develop(radiance: np.ndarray, response: CameraResponse, rng: np.random.Generator) -> np.ndarray:
    """Linear radiance f32[h, w, 3] to an sRGB image u8[h, w, 3].

    The exposure is (key / mean)^meter, so that a bright sky darkens the street. It is followed by lens, tone
    curve, sharpening, shot-like noise (which grows with the signal, and with the square root of the meter's
    factor), and the compression of the file.
    """
    radiance = np.ascontiguousarray(radiance, np.float32)
    metered = _metered(radiance, response.meter)
    light = np.array(response.gain) * response.exposure * metered
    tones = _expose(
        radiance, light.astype(np.float32), _tone_table(response.contrast, response.gamma),
        np.float32(response.vignette), np.float32(response.fringe),
    )  # fmt: skip
    if response.blur > 0:
        tones = cv2.GaussianBlur(tones, (0, 0), response.blur)
    start = rng.integers(0, GRAIN, 2)
    image = _store(
        tones, np.float32(response.saturation), np.float32(response.halo),
        np.float32(response.noise * math.sqrt(metered)), _grain(), int(start[0]), int(start[1]),
    )  # fmt: skip
    return _compressed(image, response.jpeg) if response.jpeg > 0 else image


def _metered(radiance: np.ndarray, meter: float) -> float:
    """Factor that automatic exposure multiplies radiance by, from every fourth pixel and row."""
    if meter == 0:
        return 1.0
    mean = float(np.minimum(radiance[::4, ::4], BRIGHTEST).mean())
    return (KEY / max(mean, 1e-3)) ** meter


@lru_cache(maxsize=64)
def _tone_table(contrast: float, gamma: float) -> np.ndarray:
    """Tones f32[TONES] in 0..255 of radiances MOST (i / (TONES - 1))^2.

    The curve x / (1 + x^2)^(1/2) bends the sky's last two stops; contrast turns it about mid grey.
    """
    x = MOST * (np.arange(TONES) / (TONES - 1)) ** 2
    x = MIDDLE * (x / MIDDLE) ** contrast
    x = np.minimum(x / np.sqrt(1 + x**2) * math.sqrt(1 + WHITE**2) / WHITE, 1.0)
    srgb = np.where(x < 0.0031308, 12.92 * x, 1.055 * np.power(x, 1 / 2.4) - 0.055)
    table = (255 * np.power(srgb, gamma)).astype(np.float32)
    table.setflags(write=False)
    return table


@cache
def _grain() -> np.ndarray:
    """Noise f32[GRAIN, GRAIN, 3] of mean 0 and deviation 1; neighbours correlate, as in raw files."""
    white = table_row("grain").standard_normal((GRAIN, GRAIN, 3), dtype=np.float32)
    mixed = white + 0.3 * sum(np.roll(white, s, a) for a in (0, 1) for s in (-1, 1))
    mixed = 0.8 * mixed + 0.6 * mixed.mean(axis=2, keepdims=True)
    mixed = ((mixed - mixed.mean()) / mixed.std()).astype(np.float32)
    mixed.setflags(write=False)
    return mixed


@njit(cache=True, fastmath=True, error_model="numpy")
def _expose(
    radiance: np.ndarray, light: np.ndarray, table: np.ndarray, vignette: np.float32,
    fringe: np.float32,
) -> np.ndarray:  # fmt: skip
    """Tones f32[h, w, 3] in 0..255 after the lens."""
    h, w, _ = radiance.shape
    out = np.empty((h, w, 3), np.float32)
    last = table.shape[0] - 1
    scale = np.float32(last / math.sqrt(MOST))
    zero, one, half, top = np.float32(0), np.float32(1), np.float32(0.5), np.float32(last)
    cy, cx = np.float32((h - 1) / 2), np.float32((w - 1) / 2)
    corner = one / max(cy * cy + cx * cx, one)
    grow = np.float32(fringe * math.sqrt(corner))
    # The colours of a row are one array, so that loops are vectorised.
    work = np.empty((3, 3 * w), np.float32)
    away, colored, place = work[0], work[1], work[2]
    for x in range(w):
        for k in range(3):
            away[3 * x + k] = (np.float32(x) - cx) ** 2
            colored[3 * x + k] = light[k]
    flat, lines = radiance.reshape(h, 3 * w), out.reshape(h, 3 * w)
    for y in range(h):
        dy = np.float32(y) - cy
        for e in range(3 * w):
            lens = one - vignette * (dy * dy + away[e]) * corner
            bright = math.sqrt(max(flat[y, e] * colored[e] * lens, zero)) * scale + half
            place[e] = min(bright, top)
        if fringe > 0:
            for x in range(w):
                dx = np.float32(x) - cx
                sy = min(max(cy + dy * (1 - grow), zero), np.float32(h - 1))
                sx = min(max(cx + dx * (1 - grow), zero), np.float32(w - 1))
                y0, x0 = int(sy), int(sx)
                y1, x1 = min(y0 + 1, h - 1), min(x0 + 1, w - 1)
                fy, fx = sy - np.float32(y0), sx - np.float32(x0)
                upper = radiance[y0, x0, 0] * (1 - fx) + radiance[y0, x1, 0] * fx
                lower = radiance[y1, x0, 0] * (1 - fx) + radiance[y1, x1, 0] * fx
                lens = one - vignette * (dy * dy + dx * dx) * corner
                value = np.float32(upper * (1 - fy) + lower * fy) * light[0] * lens
                place[3 * x] = min(math.sqrt(max(value, zero)) * scale + half, top)
        for e in range(3 * w):
            lines[y, e] = table[int(place[e])]
    return out


@njit(cache=True, fastmath=True, error_model="numpy")
def _store(
    tones: np.ndarray, saturation: np.float32, halo: np.float32, noise: np.float32,
    grain: np.ndarray, row: int, column: int,
) -> np.ndarray:  # fmt: skip
    """Sharpen, colour and add noise; rounded to u8[h, w, 3]."""
    h, w, _ = tones.shape
    out = np.empty((h, w, 3), np.uint8)
    mask = grain.shape[0] - 1  # the size is a power of two
    quarter, white = np.float32(0.25), np.float32(255)
    floor, slope = np.float32(0.2 * 255 * 255), np.float32(1.6 * 255)
    zero, half = np.float32(0), np.float32(0.5)
    lines, stored = tones.reshape(h, 3 * w), out.reshape(h, 3 * w)
    # The colours of a row are one array, so that loops are vectorised; it repeats the pixels at its ends.
    work = np.empty((6, 3 * w + 6), np.float32)
    current, above, below, grey, speck = work[0], work[1], work[2], work[3], work[4]
    done = work[5]
    for y in range(h):
        high, low = max(y - 1, 0), min(y + 1, h - 1)
        for e in range(3 * w):
            current[e + 3], above[e], below[e] = lines[y, e], lines[high, e], lines[low, e]
        for k in range(3):
            current[k], current[3 * w + 3 + k] = lines[y, k], lines[y, 3 * w - 3 + k]
        specks = grain[(y + row) & mask]
        for x in range(w):
            r, g, b = current[3 * x + 3], current[3 * x + 4], current[3 * x + 5]
            mean = np.float32(0.299) * r + np.float32(0.587) * g + np.float32(0.114) * b
            at = (x + column) & mask
            for k in range(3):
                grey[3 * x + k], speck[3 * x + k] = mean, specks[at, k]
        for e in range(3 * w):
            value = current[e + 3]
            around = above[e] + below[e] + current[e] + current[e + 6]
            sharp = halo * (value - quarter * around)
            value = grey[e] + saturation * (value - grey[e]) + sharp
            value = min(max(value, zero), white)
            value += noise * math.sqrt(floor + slope * value) * speck[e]
            done[e] = min(max(value, zero), white) + half
        for e in range(3 * w):
            stored[y, e] = np.uint8(np.int32(done[e]))
    return out


def _compressed(image: np.ndarray, quality: int) -> np.ndarray:
    """The image after JPEG compression with ``quality`` 1..100."""
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
