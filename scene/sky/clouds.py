"""Tileable cloud maps, one per kind of cloud: thickness, and slope of its surface."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from scene.cache import cached
from scene.look.patterns import fractal_noise
from scene.streams import table_row

SIZE = 512
"""Pixels along each side of a map."""
Array = np.ndarray


def heaps(rng: np.random.Generator) -> Array:
    """Cumulus: heaps of round puffs, large ones in the middle of a cloud and small ones around it."""
    height = np.zeros((SIZE, SIZE), np.float32)
    for _ in range(34):
        middle, width = rng.random(2) * SIZE, rng.uniform(14, 44)
        for _ in range(int(width * 2.2)):
            away = np.abs(rng.normal(0, 0.5)) * width
            angle = rng.uniform(0, 2 * np.pi)
            radius = rng.uniform(0.16, 0.42) * width * np.exp(-((away / width) ** 2) / 1.4)
            centre = middle + away * np.array([np.sin(angle), np.cos(angle)])
            _puff(height, centre, max(radius, 2.0), 0.5 * (width - away))
    return height + 6 * fractal_noise(rng, SIZE, 24, 4) * (height > 0) + _rest(rng)


def _puff(height: Array, centre: Array, radius: float, base: float) -> None:
    """Raise ``height`` to a half-ball (pixels) at ``centre`` (row, column), around the map's ends."""
    reach = int(radius) + 1
    rows = np.arange(int(centre[0]) - reach, int(centre[0]) + reach + 2)
    columns = np.arange(int(centre[1]) - reach, int(centre[1]) + reach + 2)
    rise = radius**2 - (rows[:, None] - centre[0]) ** 2 - (columns - centre[1]) ** 2
    window = np.ix_(rows % SIZE, columns % SIZE)
    ball = np.where(rise > 0, np.sqrt(np.maximum(rise, 0)) + max(base, 0.0), 0)
    height[window] = np.maximum(height[window], ball)


def _rest(rng: np.random.Generator) -> Array:
    """Faint noise that ranks cloudless pixels, so that every cover value gets its share of the map."""
    return 0.01 * fractal_noise(rng, SIZE, 5, 5)


def fleece(rng: np.random.Generator) -> Array:
    """Stratocumulus: billowing masses with torn edges."""
    bulk = _warped(fractal_noise(rng, SIZE, 5, 6), rng, 26)
    billow = 1 - np.abs(2 * fractal_noise(rng, SIZE, 12, 4) - 1)
    return 80 * bulk + 14 * billow


def ripples(rng: np.random.Generator) -> Array:
    """Altocumulus: a field of small flakes in rows, of varying density."""
    rows, columns = np.mgrid[0:SIZE, 0:SIZE] * (2 * np.pi / SIZE)
    bend = 5 * fractal_noise(rng, SIZE, 4, 3)
    flakes = np.cos(20 * rows + bend) * (0.7 + 0.3 * np.cos(26 * columns + 2 * bend))
    torn = fractal_noise(rng, SIZE, 24, 3)
    return 7 * flakes + 60 * fractal_noise(rng, SIZE, 3, 3) + 22 * torn


def streaks(rng: np.random.Generator) -> Array:
    """Cirrus: fibres stretched by the wind, with hooked ends."""
    fibre = fractal_noise(rng, SIZE, 48, 4, stretch=12)
    return 40 * _warped(fibre, rng, 34) + 55 * fractal_noise(rng, SIZE, 4, 4)


def sheet(rng: np.random.Generator) -> Array:
    """Stratus: one almost uniform layer."""
    return 60 * fractal_noise(rng, SIZE, 3, 4) + 12 * fractal_noise(rng, SIZE, 10, 4)


def rags(rng: np.random.Generator) -> Array:
    """Nimbostratus: a dark layer with low torn rags below it."""
    torn = _warped(fractal_noise(rng, SIZE, 8, 6, stretch=2), rng, 18)
    return 45 * fractal_noise(rng, SIZE, 3, 4) + 50 * torn**2


def _warped(image: Array, rng: np.random.Generator, reach: float) -> Array:
    """Warp the tile ``image`` smoothly by up to ``reach`` pixels."""
    rows, columns = np.mgrid[0:SIZE, 0:SIZE]
    shift = [2 * reach * (fractal_noise(rng, SIZE, 5, 3) - 0.5) for _ in range(2)]
    away = [np.rint(c + s).astype(int) % SIZE for c, s in zip((rows, columns), shift, strict=True)]
    return image[away[0], away[1]]


KINDS: dict[str, Callable[[np.random.Generator], Array]] = {
    f.__name__: f for f in (heaps, fleece, ripples, streaks, sheet, rags)
}


@cache
def cloud_relief(kind: str) -> Array:
    """A map f32[size, size, 3] of one kind: rank of thickness in [0, 1], slope along row and column.

    A share ``c`` of its thickness is above 1 - c. Slopes are those of the cloud's underside or flank, in
    [-1, 1]; they point to where it gets thicker. Read-only.
    """
    relief = cached(f"clouds-{kind}", lambda: {"relief": _make_relief(kind)})["relief"]
    relief.setflags(write=False)  # in both cases, since it is part of the type for compiled code
    return relief


def _make_relief(kind: str) -> Array:
    height = KINDS[kind](table_row("clouds", list(KINDS).index(kind))).astype(np.float32)
    rank = np.empty(height.size, np.float32)
    rank[np.argsort(height, axis=None)] = np.arange(height.size) / height.size
    smooth = sum(np.roll(height, (r, c), (0, 1)) for r in (-1, 0, 1) for c in (-1, 0, 1)) / 9
    slope = [np.roll(smooth, -1, axis) - np.roll(smooth, 1, axis) for axis in (0, 1)]
    steep = np.sqrt(1 + slope[0] ** 2 + slope[1] ** 2)
    relief = np.stack([rank.reshape(height.shape), slope[0] / steep, slope[1] / steep], axis=-1)
    return np.ascontiguousarray(relief, np.float32)
