"""Paint on the road: lines, crossings, arrows, words, parking bays, box junctions and hatching.

All shapes are outlines [n, 4, 2] in metres along and across the road, before it bends. Words and arrows are
drawn as the driver sees them, u to the right and v ahead, and turned to the direction of their lane.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from scene.mesh.quads import rectangles, strokes

WIDTH = 0.12
"""Width of a painted line, metres."""
LINES_START, LINES_END = -6.0, 200.0
"""Range of lines in metres along the road; beyond, they are thinner than a pixel."""
SEGMENT = 5.0
"""Length of the pieces of long lines in metres; each piece is worn differently."""

# Strokes of capital letters in a box of 1 x 1: (u, v) to (u, v).
_FONT: dict[str, str] = {
    "A": "00-.5 1 .5 1-10 .2 .4-.8 .4", "B": "00-01 01-.8 1 .8 1-.8 .5 0 .5-1 .5 1 .5-10 10-00",
    "C": "11-01 01-00 00-10", "E": "11-01 01-00 00-10 0 .5-.8 .5",
    "H": "00-01 10-11 0 .5-1 .5", "K": "00-01 0 .4-11 .3 .6-10",
    "L": "01-00 00-10", "O": "00-01 01-11 11-10 10-00", "P": "00-01 01-11 11-1 .5 1 .5-0 .5",
    "R": "00-01 01-11 11-1 .5 1 .5-0 .5 .4 .5-10", "S": "11-01 01-0 .5 0 .5-1 .5 1 .5-10 10-00",
    "T": "01-11 .5 1-.5 0", "U": "01-00 00-10 10-11",
    "W": "01-.25 0 .25 0-.5 .7 .5 .7-.75 0 .75 0-11",
}  # fmt: skip
WORDS: tuple[tuple[str, ...], ...] = (
    ("SLOW",),
    ("KEEP", "CLEAR"),
    ("BUS", "STOP"),
    ("STOP",),
    ("SCHOOL",),
)
"""Words on roads, line by line as they appear to the driver."""


class Legend(NamedTuple):
    """A word or arrow in a lane."""

    kind: str  # of ARROWS, or of WORDS joined by spaces
    x: float  # foot, metres along the road
    y: float  # middle, metres left of the centre line
    heading: float  # 1 with the camera's traffic, -1 against it


def _letter_strokes(letter: str) -> np.ndarray:
    numbers = _FONT[letter].replace("-", " ")
    tokens: list[float] = []
    for token in numbers.split():
        # Two adjacent digits are two integer coordinates.
        tokens += (
            [float(c) for c in token] if token.isdigit() and len(token) > 1 else [float(token)]
        )
    return np.array(tokens).reshape(-1, 2, 2)


def word(lines: tuple[str, ...], letter_width: float = 0.42, height: float = 2.0) -> np.ndarray:
    """A word in letters stretched along the road; the first line is the farthest."""
    parts = []
    for row, text in enumerate(lines):
        for k, letter in enumerate(text):
            stroke = _letter_strokes(letter) * [letter_width, height]
            left = (k - len(text) / 2) * 1.45 * letter_width + 0.22 * letter_width
            parts.append(stroke + [left, 1.35 * height * (len(lines) - 1 - row)])
    ends = np.concatenate(parts)
    return strokes(ends[:, 0], ends[:, 1], 0.13)


def _triangle(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> np.ndarray:
    """The triangle with tip ``b`` as an outline of four corners; its two halves meet at the tip."""
    return np.array([[b, c, ((a[0] + c[0]) / 2, (a[1] + c[1]) / 2), a]], float)


def _ahead() -> np.ndarray:
    shaft = rectangles(*np.array([-0.08, 0.08, 0.0, 2.6]))
    return np.concatenate([shaft, _triangle((-0.35, 2.6), (0, 4.0), (0.35, 2.6))])


def _turn() -> np.ndarray:
    shaft = rectangles(*np.array([-0.08, 0.08, 0.0, 2.0]))
    bend = strokes(np.array([[0.0, 1.9]]), np.array([[0.45, 2.8]]), 0.18)
    return np.concatenate([shaft, bend, _triangle((0.2, 3.1), (1.0, 3.1), (0.65, 2.1))])


ARROWS: dict[str, Callable[[], np.ndarray]] = {
    "ahead": _ahead,
    "right": _turn,
    "left": lambda: _turn() * [-1, 1],
    "ahead or right": lambda: np.concatenate([_ahead(), _turn()[1:] - [0, 0.8]]),
    "ahead or left": lambda: np.concatenate([_ahead(), (_turn()[1:] - [0, 0.8]) * [-1, 1]]),
}
"""Arrows by name."""


def legend(mark: Legend) -> np.ndarray:
    """The outlines of a word or arrow on the road."""
    local = ARROWS[mark.kind]() if mark.kind in ARROWS else word(tuple(mark.kind.split()))
    x = mark.x + mark.heading * local[..., 1]
    return np.stack([x, mark.y - mark.heading * local[..., 0]], axis=2)


def dashes(y: float, dash: float, gap: float, width: float = WIDTH) -> np.ndarray:
    """A broken line ``y`` metres from the centre line."""
    start = np.arange(LINES_START, LINES_END, dash + gap)
    return rectangles(start, start + dash, np.array(y - width / 2), np.array(y + width / 2))


def line(y: float, width: float = WIDTH) -> np.ndarray:
    """A continuous line, in pieces."""
    return dashes(y, SEGMENT, 0.0, width)


def clear_of(outlines: np.ndarray, places: tuple[tuple[float, float], ...]) -> np.ndarray:
    """The outlines that do not reach into ``places``: start and end in metres along the road."""
    low, high = outlines[..., 0].min(axis=1), outlines[..., 0].max(axis=1)
    keep = np.ones(len(outlines), bool)
    for start, end in places:
        keep &= (high <= start) | (low >= end)
    return outlines[keep]


def zebra(x: float, half_width: float, depth: float = 3.0, pitch: float = 1.0) -> np.ndarray:
    """Stripes across the road, centred on ``x``."""
    y = np.arange(-half_width + 0.35, half_width - pitch / 2, pitch)
    return rectangles(np.array(x - depth / 2), np.array(x + depth / 2), y, y + pitch / 2)


def studs(x: float, half_width: float, depth: float = 2.6) -> np.ndarray:
    """Two rows of squares across the road: a crossing with lights."""
    y = np.arange(-half_width + 0.2, half_width - 0.2, 0.55)
    rows = [rectangles(np.array(x + d - 0.06), np.array(x + d + 0.06), y, y + 0.2)
            for d in (-depth / 2, depth / 2)]  # fmt: skip
    return np.concatenate(rows)


def give_way(x: float, y0: float, y1: float, heading: float) -> np.ndarray:
    """A row of teeth across a lane that point at the waiting driver."""
    y = np.arange(y0 + 0.2, y1 - 0.5, 0.75)
    teeth = np.stack([_triangle((x, v), (x - 0.6 * heading, v + 0.25), (x, v + 0.5))[0] for v in y])
    return teeth


def parking(y_kerb: float, side: float, style: str, depth: float = 2.0) -> np.ndarray:
    """Bays along the kerb at ``side * y_kerb``: closed "boxes", or "ticks" at the corners only."""
    inner = side * (y_kerb - depth)
    edge = np.arange(LINES_START, 150.0, 5.6)
    low, high = sorted((inner, side * (y_kerb - 0.15)))
    if style == "boxes":
        ends = rectangles(edge, edge + 0.1, np.array(low), np.array(high))
        return np.concatenate([ends, dashes(inner, 5.6, 0.0, 0.1)])
    tick = rectangles(edge, edge + 0.1, np.array(inner - 0.35), np.array(inner + 0.35))
    bar = rectangles(edge - 0.5, edge + 0.6, np.array(inner - 0.05), np.array(inner + 0.05))
    return np.concatenate([tick, bar])


def hatching(x0: float, x1: float, half: float = 0.55) -> np.ndarray:
    """Diagonal bars between two lines along the middle of the road."""
    x = np.arange(x0, x1 - 1.2, 1.6)
    flat = np.zeros_like(x)
    bars = strokes(
        np.stack([x, flat - half], axis=1), np.stack([x + 1.2, flat + half], axis=1), 0.22
    )
    sides = [rectangles(x, x + 1.6, np.array(y - 0.06), np.array(y + 0.06)) for y in (-half, half)]
    return np.concatenate([bars, *sides])


def box_junction(x0: float, x1: float, half_width: float) -> np.ndarray:
    """A box junction: a rectangle of crossing diagonals."""
    edge = half_width - 0.35
    corners = np.array([[x0, -edge], [x1, -edge], [x1, edge], [x0, edge]])
    frame = strokes(corners, np.roll(corners, -1, axis=0), 0.15)
    offset = np.arange(x0 - 2 * edge + 1.8, x1, 1.8)
    start = np.maximum(offset, x0)
    end = np.minimum(offset + 2 * edge, x1)
    rising = strokes(
        np.stack([start, start - offset - edge], axis=1),
        np.stack([end, end - offset - edge], axis=1),
        0.1,
    )
    return np.concatenate([frame, rising, rising * [1, -1]])
