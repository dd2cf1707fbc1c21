"""Surface materials: a tileable luminance texture, its scale in metres, and how much sky it mirrors.

A material multiplies a face's own colour; the face's colour says what is red, the material says what
is brick. Both renderers read this table.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

TEXTURE_SIZE = 128
"""Pixels along each side of every texture."""


class Material(NamedTuple):
    """One row of the table."""

    name: str
    pattern: str  # which function below draws the texture
    tile: float  # metres that one texture covers
    contrast: float  # 0 none .. 1 strong, around a mean of 1
    gloss: float  # share of mirrored sky at normal incidence
    translucency: float  # share of sunlight that passes through (leaves)


MATERIALS: tuple[Material, ...] = (
    Material("plain", "flat", 1.0, 0.0, 0.0, 0.0),
    Material("paint", "flat", 1.0, 0.0, 0.06, 0.0),
    Material("glass", "flat", 1.0, 0.0, 0.12, 0.0),
    Material("metal", "speckle", 2.0, 0.15, 0.04, 0.0),
    Material("rubber", "flat", 1.0, 0.0, 0.0, 0.0),
    Material("cloth", "cloudy", 0.5, 0.35, 0.0, 0.0),
    Material("skin", "flat", 1.0, 0.0, 0.0, 0.0),
    Material("brick", "brick", 2.0, 1.0, 0.0, 0.0),
    Material("plaster", "cloudy", 6.0, 0.45, 0.0, 0.0),
    Material("concrete", "blotchy", 4.0, 0.55, 0.0, 0.0),
    Material("wood", "planks", 1.6, 0.6, 0.0, 0.0),
    Material("bark", "streaks", 1.0, 0.9, 0.0, 0.0),
    Material("foliage", "leaves", 2.0, 1.0, 0.0, 0.35),
    Material("asphalt", "asphalt", 8.0, 0.45, 0.0, 0.0),
    Material("paving", "slabs", 2.4, 0.5, 0.0, 0.0),
    Material("grass", "grass", 3.0, 0.8, 0.0, 0.0),
    Material("marking", "worn", 3.0, 0.5, 0.0, 0.0),
    Material("roof", "tiles", 2.0, 0.7, 0.0, 0.0),
    Material("lamp", "flat", 1.0, 0.0, 0.10, 0.0),
)
MATERIAL_ID: dict[str, int] = {m.name: i for i, m in enumerate(MATERIALS)}


def material_id(name: str) -> int:
    """Index of a material; raises ValueError naming the known ones."""
    if name not in MATERIAL_ID:
        raise ValueError(f"unknown material {name!r}; known: {', '.join(MATERIAL_ID)}")
    return MATERIAL_ID[name]


def value_noise(rng: np.random.Generator, size: int, cells: tuple[int, int]) -> np.ndarray:
    """Tileable smooth noise f32[size, size] in [0, 1] with ``cells`` lattice cells (rows, columns)."""
    lattice = rng.random(cells, dtype=np.float32)
    weights = []
    for axis_cells in cells:
        position = np.arange(size, dtype=np.float32) * axis_cells / size
        low = position.astype(np.int32)
        t = position - low
        weights.append((low % axis_cells, (low + 1) % axis_cells, t * t * (3 - 2 * t)))
    (r0, r1, rt), (c0, c1, ct) = weights
    top = lattice[r0][:, c0] * (1 - ct) + lattice[r0][:, c1] * ct
    bottom = lattice[r1][:, c0] * (1 - ct) + lattice[r1][:, c1] * ct
    return top * (1 - rt[:, None]) + bottom * rt[:, None]


def fractal_noise(
    rng: np.random.Generator, size: int, cells: int, octaves: int = 4, stretch: int = 1
) -> np.ndarray:
    """Sum of ``octaves`` of value noise, each twice as fine and half as strong, scaled to [0, 1]."""
    total = np.zeros((size, size), np.float32)
    for octave in range(octaves):
        n = min(cells * 2**octave, size)
        total += value_noise(rng, size, (max(1, n // stretch), n)) * 0.5**octave
    low, high = total.min(), total.max()
    return (total - low) / (high - low)


def _flat(rng: np.random.Generator, size: int) -> np.ndarray:
    return np.full((size, size), 0.5, np.float32)


def _speckle(rng: np.random.Generator, size: int) -> np.ndarray:
    return rng.random((size, size), dtype=np.float32)


def _cloudy(rng: np.random.Generator, size: int) -> np.ndarray:
    return fractal_noise(rng, size, 3, 4)


def _blotchy(rng: np.random.Generator, size: int) -> np.ndarray:
    return 0.7 * fractal_noise(rng, size, 2, 5) + 0.3 * _speckle(rng, size)


def _courses(
    rng: np.random.Generator, size: int, rows: int, columns: int, joint: int, stagger: bool
) -> np.ndarray:
    """Bricks, slabs or tiles: blocks of one tone each, dark joints ``joint`` pixels wide."""
    y, x = np.mgrid[0:size, 0:size]
    row = y * rows // size
    shift = (row % 2) * (size // columns // 2) if stagger else 0
    column = ((x + shift) % size) * columns // size
    tone = rng.random((rows, columns), dtype=np.float32)[row, column]
    in_joint = (y % (size // rows) < joint) | ((x + shift) % (size // columns) < joint)
    return np.where(in_joint, 0.0, 0.45 + 0.55 * tone) + 0.1 * _speckle(rng, size)


def _brick(rng: np.random.Generator, size: int) -> np.ndarray:
    return _courses(rng, size, 16, 8, 2, True)


def _slabs(rng: np.random.Generator, size: int) -> np.ndarray:
    return 0.7 * _courses(rng, size, 4, 4, 2, False) + 0.3 * _blotchy(rng, size)


def _tiles(rng: np.random.Generator, size: int) -> np.ndarray:
    return _courses(rng, size, 8, 8, 3, True)


def _planks(rng: np.random.Generator, size: int) -> np.ndarray:
    return 0.6 * _courses(rng, size, 1, 8, 2, False) + 0.4 * _streaks(rng, size)


def _streaks(rng: np.random.Generator, size: int) -> np.ndarray:
    return fractal_noise(rng, size, 16, 3, stretch=8)


def _leaves(rng: np.random.Generator, size: int) -> np.ndarray:
    clumps = fractal_noise(rng, size, 6, 3)
    return np.clip(0.55 * clumps + 0.6 * value_noise(rng, size, (48, 48)) - 0.1, 0, 1)


def _asphalt(rng: np.random.Generator, size: int) -> np.ndarray:
    wear = fractal_noise(rng, size, 2, 4)
    patch = np.zeros((size, size), np.float32)
    for _ in range(3):
        r, c, h, w = (
            int(v) for v in rng.integers([0, 0, 8, 8], [size, size, size // 4, size // 2])
        )
        patch[r : r + h, c : c + w] = rng.choice([-0.25, 0.2])
    return 0.5 * wear + 0.35 * _speckle(rng, size) + patch


def _grass(rng: np.random.Generator, size: int) -> np.ndarray:
    return 0.5 * fractal_noise(rng, size, 3, 4) + 0.5 * _speckle(rng, size)


def _worn(rng: np.random.Generator, size: int) -> np.ndarray:
    return np.clip(1.6 * fractal_noise(rng, size, 8, 3), 0, 1)


_PATTERNS = {
    "flat": _flat,
    "speckle": _speckle,
    "cloudy": _cloudy,
    "blotchy": _blotchy,
    "brick": _brick,
    "slabs": _slabs,
    "tiles": _tiles,
    "planks": _planks,
    "streaks": _streaks,
    "leaves": _leaves,
    "asphalt": _asphalt,
    "grass": _grass,
    "worn": _worn,
}


@cache
def textures() -> np.ndarray:
    """Every material's texture, f32[materials, size, size], a multiplier with mean 1 (read-only)."""
    layers = []
    for index, material in enumerate(MATERIALS):
        rng = np.random.default_rng([19, index])
        pattern = _PATTERNS[material.pattern](rng, TEXTURE_SIZE).astype(np.float32)
        centred = pattern - pattern.mean()
        layers.append(1 + material.contrast * centred / max(2 * np.abs(centred).max(), 1e-6) * 1.6)
    stack = np.stack(layers).astype(np.float32).clip(0.05, 2.5)
    stack /= stack.mean(axis=(1, 2), keepdims=True)
    stack.setflags(write=False)
    return stack
