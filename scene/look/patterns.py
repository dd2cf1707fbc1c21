"""Tileable luminance patterns, drawn by code: the grain of every material.

Every pattern is a function (rng, size) -> f32[size, size] of any mean and range; ``materials.textures``
scales it. On the ground, columns run along the road and rows across it, from the centre line.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Pattern = Callable[[np.random.Generator, int], np.ndarray]

LANE_TILE = 10.0
"""Metres across which a pattern with wheel tracks repeats: the width of the carriageway."""


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


def _speckle(rng: np.random.Generator, size: int) -> np.ndarray:
    return rng.random((size, size), dtype=np.float32)


def _line(distance: np.ndarray, width: float) -> np.ndarray:
    """1 on a line, 0 from ``width`` away (both in the same unit)."""
    return np.clip(1 - np.abs(distance) / width, 0, 1)


def _cracks(rng: np.random.Generator, size: int, width: float = 0.02) -> np.ndarray:
    """Thin branching lines f32[size, size], 1 in a crack: level lines of noise, broken up."""
    noise = fractal_noise(rng, size, 4, 4)
    broken = np.clip(6 * (fractal_noise(rng, size, 3, 2) - 0.55), 0, 1)
    return _line(noise - 0.5, width) * broken


def _stones(rng: np.random.Generator, size: int, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Round stones (a Voronoi diagram on a jittered lattice): tone of each in [0, 1], and its relief.

    Relief is 1 on a stone and falls to 0 in the gap between two.
    """
    centre = rng.uniform(0.15, 0.85, (cells, cells, 2)).astype(np.float32)
    tones = rng.random((cells, cells), dtype=np.float32)
    position = np.arange(size, dtype=np.float32) * cells / size
    cell = position.astype(np.int32)
    first = np.full((size, size), np.inf, np.float32)
    second, tone = first.copy(), np.zeros_like(first)
    for dr in (-1, 0, 1):
        for dc in (-1, 0, 1):
            at = np.ix_((cell + dr) % cells, (cell + dc) % cells)
            away = np.hypot(
                (cell + dr - position)[:, None] + centre[at][..., 0],
                (cell + dc - position)[None, :] + centre[at][..., 1],
            )
            nearer = away < first
            second = np.where(nearer, first, np.minimum(second, away))
            tone = np.where(nearer, tones[at], tone)
            first = np.where(nearer, away, first)
    return tone, np.clip(3 * (second - first), 0, 1)


def _courses(
    rng: np.random.Generator, size: int, rows: int, columns: int, joint: float, shift: float = 0.5
) -> np.ndarray:
    """Bricks, slabs or tiles of one tone each, every other row moved by ``shift`` of a block.

    Joints are dark and ``joint`` texels wide.
    """
    y, x = np.mgrid[0:size, 0:size].astype(np.float32) / size
    row = (y * rows).astype(int)
    across = (x * columns + shift * (row % 2)) % columns
    tone = rng.random((rows, columns), dtype=np.float32)[row, across.astype(int)]
    to_joint = np.minimum(
        np.abs((across + 0.5) % 1 - 0.5) * size / columns,
        np.abs((y * rows + 0.5) % 1 - 0.5) * size / rows,
    )
    body = np.clip(to_joint / joint, 0, 1)
    return body * (0.55 + 0.45 * tone) + 0.12 * _speckle(rng, size)


def _flat(rng: np.random.Generator, size: int) -> np.ndarray:
    return np.full((size, size), 0.5, np.float32)


def _cloudy(rng: np.random.Generator, size: int) -> np.ndarray:
    return fractal_noise(rng, size, 3, 4)


def _blotchy(rng: np.random.Generator, size: int) -> np.ndarray:
    stains = 0.7 * fractal_noise(rng, size, 2, 5) + 0.3 * _speckle(rng, size)
    return stains - 0.3 * _cracks(rng, size)


def _plaster(rng: np.random.Generator, size: int) -> np.ndarray:
    """Rain runs down a wall: stains longer than wide, a few cracks."""
    runs = fractal_noise(rng, size, 16, 3, stretch=8)
    return 0.5 * fractal_noise(rng, size, 3, 5) + 0.35 * runs - 0.35 * _cracks(rng, size, 0.012)


def _brick(rng: np.random.Generator, size: int) -> np.ndarray:
    """Stretchers in running bond, mortar lighter than burnt bricks and darker than pale ones."""
    return _courses(rng, size, 24, 8, 1.4) + 0.25 * fractal_noise(rng, size, 2, 4)


def _slabs(rng: np.random.Generator, size: int) -> np.ndarray:
    return 0.7 * _courses(rng, size, 4, 4, 2, 0.0) + 0.4 * _blotchy(rng, size)


def _flags(rng: np.random.Generator, size: int) -> np.ndarray:
    return 0.7 * _courses(rng, size, 3, 4, 2, 0.37) + 0.5 * _blotchy(rng, size)


def _pavers(rng: np.random.Generator, size: int) -> np.ndarray:
    return _courses(rng, size, 16, 8, 1.3) + 0.3 * fractal_noise(rng, size, 2, 4)


def _herringbone(rng: np.random.Generator, size: int) -> np.ndarray:
    """Bricks of two squares, lying and standing by turns along every diagonal."""
    squares = 16
    y, x = np.mgrid[0:size, 0:size].astype(np.float32) * squares / size
    row, column = y.astype(int), x.astype(int)
    phase = (column - row) % 4
    lying = phase < 2
    first_row = np.where(phase == 3, row - 1, row) % squares
    first_column = np.where(phase == 1, column - 1, column) % squares
    tone = rng.random((squares, squares), dtype=np.float32)[first_row, first_column]
    fx, fy = x - column, y - row
    along = np.where(lying, np.where(phase == 0, fx, 1 - fx), np.where(phase == 2, fy, 1 - fy))
    across = np.where(lying, fy, fx)
    to_joint = np.minimum(along, np.minimum(across, 1 - across)) * size / squares
    return np.clip(to_joint / 1.4, 0, 1) * (0.5 + 0.5 * tone) + 0.2 * _cloudy(rng, size)


def _tiles(rng: np.random.Generator, size: int) -> np.ndarray:
    """Roof tiles: each course is in the shade of the one above, moss and soot over all."""
    y = np.arange(size, dtype=np.float32)[:, None] * 8 / size
    return (
        0.8 * _courses(rng, size, 8, 10, 1.6)
        + 0.25 * (y % 1)
        + 0.35 * fractal_noise(rng, size, 2, 4)
    )


def _planks(rng: np.random.Generator, size: int) -> np.ndarray:
    return 0.6 * _courses(rng, size, 1, 8, 2, 0.0) + 0.4 * _streaks(rng, size)


def _streaks(rng: np.random.Generator, size: int) -> np.ndarray:
    return fractal_noise(rng, size, 16, 3, stretch=8)


def _bark(rng: np.random.Generator, size: int) -> np.ndarray:
    """Upright furrows between ridges."""
    ridges = np.abs(fractal_noise(rng, size, 24, 3, stretch=6) - 0.5)
    return np.clip(5 * ridges, 0, 1) + 0.3 * _streaks(rng, size)


def _leaves(rng: np.random.Generator, size: int) -> np.ndarray:
    tone, relief = _stones(rng, size, 40)
    return 0.5 * fractal_noise(rng, size, 6, 3) + 0.35 * tone + 0.35 * relief


def _grain(rng: np.random.Generator, size: int) -> np.ndarray:
    """Bitumen and stone: grain of one to four texels."""
    fine = _speckle(rng, size) + value_noise(rng, size, (size // 2, size // 2))
    return 0.6 * fine + 0.5 * value_noise(rng, size, (size // 4, size // 4))


def _tracks(rng: np.random.Generator, size: int) -> np.ndarray:
    """Where wheels polish (-) and oil drips (-) across a road of two lanes; rows are metres off it."""
    y = np.arange(size, dtype=np.float32)[:, None] * LANE_TILE / size
    y = np.minimum(y, LANE_TILE - y)  # the same on both sides of the centre line
    wheels = np.exp(-(((y - 1.0) / 0.35) ** 2)) + np.exp(-(((y - 2.6) / 0.35) ** 2))
    oil = np.exp(-(((y - 1.8) / 0.22) ** 2))
    gutter = np.exp(-(((y - 5.0) / 0.3) ** 2))
    return -0.16 * wheels - 0.12 * oil * value_noise(rng, size, (1, 7)) - 0.25 * gutter


def _fresh(rng: np.random.Generator, size: int) -> np.ndarray:
    return 0.35 * _grain(rng, size) + 0.15 * fractal_noise(rng, size, 3, 3)


def _mended(rng: np.random.Generator, size: int) -> np.ndarray:
    """A footway that has been opened and closed: trenches of other mixes, and cracks; no wheel tracks."""
    return _with_patches(rng, _fresh(rng, size), 9) - 0.25 * _cracks(rng, size)


def _asphalt(rng: np.random.Generator, size: int) -> np.ndarray:
    wear = 0.5 * fractal_noise(rng, size, 5, 5) + 0.12 * value_noise(rng, size, (24, 3))
    ground = 0.5 * wear + 0.32 * _grain(rng, size) + 0.8 * _tracks(rng, size)
    return ground - 0.45 * _cracks(rng, size)


def _patched(rng: np.random.Generator, size: int) -> np.ndarray:
    """Worn asphalt with rectangles of other mixes."""
    return _with_patches(rng, _asphalt(rng, size), 7)


def _with_patches(rng: np.random.Generator, ground: np.ndarray, count: int) -> np.ndarray:
    """Rectangles of other mixes, each within a seam of tar.

    They stand out little, since they come again with every tile.
    """
    size, mix = len(ground), np.zeros_like(ground)
    y, x = np.mgrid[0:size, 0:size]
    for _ in range(count):
        top, left = rng.integers(0, size, 2)
        height, width = rng.integers(size // 24, size // 6), rng.integers(size // 16, size // 3)
        r, c = (y - top) % size, (x - left) % size
        inside = (r < height) & (c < width)
        edge = inside & ((r < 1) | (c < 1) | (r >= height - 1) | (c >= width - 1))
        mix = np.where(edge, -0.22, np.where(inside, rng.choice([-0.12, -0.07, 0.06, 0.1]), mix))
    return ground + mix


def _seams(rng: np.random.Generator, size: int) -> np.ndarray:
    """Asphalt whose joints and cracks have been poured with tar."""
    ground = 0.8 * _asphalt(rng, size)
    y, x = np.mgrid[0:size, 0:size].astype(np.float32)
    for k in range(4):
        wobble = 3 * (value_noise(rng, size, (1, 12))[:1] - 0.5) * size / 64
        along, start = (y, wobble) if k < 2 else (x, wobble.T)
        away = (along - start - rng.uniform(0, size) + size / 2) % size - size / 2
        ground = ground - 0.6 * _line(away, 2.0)
    return ground - 0.6 * _cracks(rng, size, 0.03)


def _chippings(rng: np.random.Generator, size: int) -> np.ndarray:
    tone, relief = _stones(rng, size, 64)
    return 0.6 * tone + 0.3 * relief + 0.4 * fractal_noise(rng, size, 3, 4) + _tracks(rng, size)


def _slab_road(rng: np.random.Generator, size: int) -> np.ndarray:
    """Concrete cast in bays of half the tile, their joints filled with tar."""
    y, x = np.mgrid[0:size, 0:size]
    joints = np.maximum(
        _line((x % (size // 2)) - size // 4, 1.5), _line((y % (size // 2)) - 0.5, 1.5)
    )
    bays = rng.random((2, 2), dtype=np.float32)[y * 2 // size, ((x + size // 4) * 2 // size) % 2]
    return 0.3 * bays + 0.8 * _asphalt(rng, size) - 0.8 * joints


def _setts(rng: np.random.Generator, size: int) -> np.ndarray:
    return _courses(rng, size, 20, 32, 2.0).T + 0.4 * fractal_noise(rng, size, 2, 4)


def _cobbles(rng: np.random.Generator, size: int) -> np.ndarray:
    tone, relief = _stones(rng, size, 20)
    return 0.4 * tone + 0.8 * relief + 0.2 * _cloudy(rng, size)


def _gravel(rng: np.random.Generator, size: int) -> np.ndarray:
    tone, relief = _stones(rng, size, 56)
    return 0.6 * tone + 0.4 * relief + 0.3 * _cloudy(rng, size)


def _tactile(rng: np.random.Generator, size: int) -> np.ndarray:
    """Rows of blisters that a foot can feel."""
    y, x = np.mgrid[0:size, 0:size].astype(np.float32) * 12 / size
    return np.clip(2.2 - 5 * np.hypot(x % 1 - 0.5, y % 1 - 0.5), 0, 1) + 0.3 * _cloudy(rng, size)


def _grass(rng: np.random.Generator, size: int) -> np.ndarray:
    return 0.4 * fractal_noise(rng, size, 8, 4) + 0.4 * _grain(rng, size)


def _long_grass(rng: np.random.Generator, size: int) -> np.ndarray:
    tufts = fractal_noise(rng, size, 10, 4)
    blades = fractal_noise(rng, size, 64, 2, stretch=4)
    return 0.7 * tufts + 0.5 * blades + 0.2 * _speckle(rng, size)


def _bare(rng: np.random.Generator, size: int) -> np.ndarray:
    """Grass that feet and wheels have worn through to pale earth."""
    worn = np.clip(5 * (fractal_noise(rng, size, 5, 4) - 0.55), 0, 1)
    return (1 - worn) * _grass(rng, size) + worn * (0.85 + 0.15 * _speckle(rng, size))


def _litter(rng: np.random.Generator, size: int) -> np.ndarray:
    """Fallen leaves, a few pale ones among the dark."""
    tone, relief = _stones(rng, size, 40)
    return tone**2 + 0.35 * relief + 0.5 * fractal_noise(rng, size, 3, 3)


def _earth(rng: np.random.Generator, size: int) -> np.ndarray:
    return 0.8 * fractal_noise(rng, size, 4, 6) + 0.2 * _speckle(rng, size)


def _worn(rng: np.random.Generator, size: int) -> np.ndarray:
    """Paint that traffic has rubbed off in places."""
    rubbed = np.clip(2.2 * fractal_noise(rng, size, 8, 4), 0.25, 1)
    return rubbed - 0.4 * _cracks(rng, size, 0.05) + 0.1 * _speckle(rng, size)


def _grating(rng: np.random.Generator, size: int) -> np.ndarray:
    _, x = np.mgrid[0:size, 0:size].astype(np.float32) * 10 / size
    return np.clip(4 * np.abs(x % 1 - 0.5) - 0.4, 0, 1) + 0.3 * _cloudy(rng, size)


PATTERNS: dict[str, Pattern] = {
    f.__name__.lstrip("_"): f
    for f in (
        _flat, _speckle, _cloudy, _blotchy, _plaster, _brick, _slabs, _flags, _pavers,
        _herringbone, _tiles, _planks, _streaks, _bark, _leaves, _fresh, _asphalt, _patched,
        _seams, _chippings, _slab_road, _setts, _cobbles, _gravel, _tactile, _grass,
        _long_grass, _bare, _mended, _litter, _earth, _worn, _grating,
    )
}  # fmt: skip
"""Patterns by name."""
