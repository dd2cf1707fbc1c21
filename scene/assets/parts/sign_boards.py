"""Inks of signs, and the faces with words: boards, street names, bus stops, fingerposts."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from scene.assets.parts.pictogram import (
    Layer,
    Mark,
    Outline,
    arrow,
    centred,
    dot,
    line,
    moved,
    rectangle,
    text,
    turned,
)
from scene.mesh.asset import Color, vary

PLACES: tuple[str, ...] = (
    "NORTH", "CENTRE", "STATION", "HILLTOP", "BARTON", "MILL END", "PORT", "WEST", "AIRPORT",
    "OLD TOWN", "LONGWICK", "ELMSTEAD", "CASTLE", "MARKET", "COLLEGE", "HOSPITAL",
)  # fmt: skip
"""Invented names and everyday words on boards."""


class Inks(NamedTuple):
    """The inks of one sign, each slightly varied."""

    red: Color
    blue: Color
    white: Color
    black: Color
    yellow: Color
    green: Color
    brown: Color

    @classmethod
    def sample(cls, rng: np.random.Generator) -> Inks:
        """Draw the inks."""
        return cls(
            vary(rng, (0.46, 0.015, 0.02), 0.2), vary(rng, (0.012, 0.07, 0.32), 0.3),
            vary(rng, (0.78, 0.78, 0.76), 0.08), vary(rng, (0.015, 0.015, 0.016), 0.2),
            vary(rng, (0.66, 0.38, 0.02), 0.2), vary(rng, (0.008, 0.12, 0.055), 0.2),
            vary(rng, (0.13, 0.045, 0.015), 0.2),
        )  # fmt: skip


Draw = Callable[[Inks, np.random.Generator], Mark]


def plate(outline: Outline, border: Color, field: Color, inner: float, sink: float = 0.0) -> Mark:
    """Draw a plate with a border; ``sink`` moves its field down."""
    return Layer(outline, border, 0), Layer(moved(outline, 0, sink, inner), field, 1)


def _small_arrow(angle: float, u: float, v: float, color: Color) -> Mark:
    """Draw a small arrow around (u, v), turned clockwise from up by ``angle``."""
    small = turned(arrow(((0.0, -0.15), (0.0, 0.05)), 0.08, color, 3.0), angle)
    return tuple(layer._replace(outline=moved(layer.outline, u, v)) for layer in small)


def board(field: str, ink: str, width: float, height: float, lines: int) -> Draw:
    """Return the face of a board with rows of places, each with an arrow."""

    def draw(inks: Inks, rng: np.random.Generator) -> Mark:
        ground, print_ = getattr(inks, field), getattr(inks, ink)
        outer = rectangle(-width, -height, width, height)
        inner = rectangle(-width + 0.07, -height + 0.07, width - 0.07, height - 0.07)
        mark: Mark = (Layer(outer, print_, 0), Layer(inner, ground, 1))
        step = 2 * (height - 0.1) / lines
        for k, word in enumerate(rng.permutation(PLACES)[:lines]):
            low, size = height - 0.1 - (k + 0.78) * step, 0.56 * step
            size = min(size, (2 * width - 0.7) / (0.8 * len(word)))
            mark += text(str(word), -width + 0.2, low, size, print_, 0.17)
            tip, middle = width - 0.35, low + size / 2
            mark += _small_arrow(float(rng.choice([0, np.pi / 2, -np.pi / 2])), tip, middle, print_)
        return mark

    return draw


def street_name(inks: Inks, rng: np.random.Generator) -> Mark:
    """Draw a street name."""
    word = str(rng.choice(PLACES)) + " " + str(rng.choice(("ROAD", "STREET", "LANE")))
    half = 0.104 * len(word) + 0.15
    base = plate(rectangle(-half, -0.26, half, 0.26), inks.black, inks.white, 0.93)
    return (*base, *centred(word, -0.12, 0.25, inks.black))


def chevrons(inks: Inks, rng: np.random.Generator) -> Mark:
    """Draw the chevrons of a bend."""
    side = 1.0 if rng.random() < 0.5 else -1.0
    mark: Mark = plate(rectangle(-2.2, -0.6, 2.2, 0.6), inks.white, inks.black, 0.95)
    for u in (-1.5, -0.5, 0.5, 1.5):
        mark += line(tuple((u + side * a, b) for a, b in ((-0.2, 0.4), (0.2, 0.0), (-0.2, -0.4))),
                     0.26, inks.white)  # fmt: skip
    return mark


def finger(inks: Inks, rng: np.random.Generator) -> Mark:
    """Draw a board that points to one side."""
    outline: Outline = ((-2.3, 0.0), (-1.9, -0.4), (1.6, -0.4), (1.6, 0.4), (-1.9, 0.4))
    word = str(rng.choice(PLACES))
    size = min(0.4, 2.9 / (0.8 * len(word)))
    return (
        *plate(outline, inks.white, inks.brown, 0.94),
        *text(word, -1.6, -0.2, size, inks.white),
    )


def bus_stop(inks: Inks, rng: np.random.Generator) -> Mark:
    """Draw a bus stop's flag."""
    base = plate(rectangle(-0.75, -1.25, 0.75, 1.05), inks.black, inks.white, 0.96)
    return (
        *base, dot(0, 0.42, 0.52, inks.red), Layer(rectangle(-0.36, 0.2, 0.36, 0.66), inks.white, 3),
        *centred("BUS", -0.48, 0.3, inks.black),
        *(Layer(rectangle(-0.55, v, 0.5, v + 0.06), inks.black) for v in (-0.7, -0.85, -1.0)),
    )  # fmt: skip


def diversion(inks: Inks, rng: np.random.Generator) -> Mark:
    """Draw a diversion sign."""
    base = plate(rectangle(-1.4, -0.6, 1.4, 0.6), inks.black, inks.yellow, 0.94)
    return (*base, *centred("DIVERTED", 0.02, 0.23, inks.black),
            *arrow(((-0.7, -0.3), (0.6, -0.3)), 0.12, inks.black))  # fmt: skip
