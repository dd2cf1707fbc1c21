"""Pictograms on plates: shapes, letters, arrows, people, bicycles, cars; the unit is the plate's radius.

Every mark is a tuple of flat convex layers; u points to the viewer's right, v up.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scene.mesh.asset import Color

Outline = tuple[tuple[float, float], ...]
"""Corners (u, v) around the edge of a convex shape."""


class Layer(NamedTuple):
    """One flat convex shape of a plate."""

    outline: Outline
    color: Color
    level: int = 2  # 0 the plate, 1 its field, 2 symbols, 3 symbols on symbols


Mark = tuple[Layer, ...]


def regular(corners: int, turn: float = 0.0, radius: float = 1.0) -> Outline:
    """Return a regular polygon, its first corner on top, turned by ``turn`` corners."""
    angle = 2 * np.pi * (np.arange(corners) + turn) / corners
    return tuple((float(radius * np.sin(a)), float(radius * np.cos(a))) for a in angle)


def rectangle(left: float, low: float, right: float, high: float) -> Outline:
    """Return an upright rectangle."""
    return ((left, low), (right, low), (right, high), (left, high))


def moved(outline: Outline, u: float, v: float, scale: float = 1.0) -> Outline:
    """Scale an outline, then move it."""
    return tuple((u + scale * a, v + scale * b) for a, b in outline)


def turned(mark: Mark, angle: float) -> Mark:
    """Turn a mark clockwise by ``angle`` radians."""
    cos, sin = float(np.cos(angle)), float(np.sin(angle))
    return tuple(
        layer._replace(
            outline=tuple((cos * u + sin * v, cos * v - sin * u) for u, v in layer.outline)
        )
        for layer in mark
    )


def dot(u: float, v: float, radius: float, color: Color, level: int = 2) -> Layer:
    """Draw a disc."""
    return Layer(moved(regular(12), u, v, radius), color, level)


def line(points: Outline, pen: float, color: Color, level: int = 2) -> Mark:
    """Draw a line of width ``pen`` through ``points``, with square joints."""
    strokes = []
    for (u0, v0), (u1, v1) in pairwise(points):
        along = np.array([u1 - u0, v1 - v0])
        along *= pen / 2 / max(float(np.hypot(*along)), 1e-9)
        a, b = np.array([u0, v0]) - along, np.array([u1, v1]) + along
        side = np.array([-along[1], along[0]])
        corners = (a - side, b - side, b + side, a + side)
        strokes.append(Layer(tuple((float(u), float(v)) for u, v in corners), color, level))
    return tuple(strokes)


def arrow(points: Outline, pen: float, color: Color, head: float = 2.6) -> Mark:
    """Draw a line with an arrow head that reaches beyond the last point."""
    (u0, v0), (u1, v1) = points[-2:]
    along = np.array([u1 - u0, v1 - v0])
    along /= np.hypot(*along)
    side, end, half_width = np.array([-along[1], along[0]]), np.array([u1, v1]), head * pen / 2
    tip = (end + half_width * side, end - half_width * side, end + 1.5 * half_width * along)
    return (*line(points, pen, color), Layer(tuple((float(u), float(v)) for u, v in tip), color))


# Strokes of characters on a grid of 3 columns and 5 rows: "xy" is a point, "," starts a new stroke.
_GLYPHS: dict[str, str] = {
    "0": "00 20 24 04 00", "1": "13 14 10", "2": "04 24 22 02 00 20", "3": "04 24 20 00,02 22",
    "4": "04 02 22,24 20", "5": "24 04 02 22 20 00", "6": "24 04 00 20 22 02", "A": "00 14 20,01 21",
    "B": "00 04 23 02 21 00", "C": "24 04 00 20", "D": "00 04 13 11 00", "E": "24 04 00 20,02 12",
    "G": "24 04 00 20 22 12", "H": "00 04,20 24,02 22", "I": "10 14", "K": "00 04,24 02 20",
    "L": "04 00 20", "M": "00 04 12 24 20", "N": "00 04 20 24", "O": "00 20 24 04 00",
    "P": "00 04 24 22 02", "R": "00 04 24 22 02 20", "S": "24 04 02 22 20 00", "T": "04 24,14 10",
    "U": "04 00 20 24", "V": "04 10 24", "W": "04 00 12 20 24", "X": "00 24,04 20",
    "Y": "04 12 24,12 10",
}  # fmt: skip


def text(
    word: str, left: float, low: float, height: float, color: Color, bold: float = 0.2
) -> Mark:
    """Draw a word from (``left``, ``low``); letters are 0.8 of their height apart."""
    mark: Mark = ()
    for k, letter in enumerate(word):
        for stroke in _GLYPHS.get(letter, "").split(",") if letter in _GLYPHS else ():
            points = tuple(
                (left + height * (0.8 * k + 0.27 * int(at[0])), low + height * int(at[1]) / 4)
                for at in stroke.split()
            )
            mark += line(points, bold * height, color)
    return mark


def centred(word: str, low: float, height: float, color: Color, bold: float = 0.2) -> Mark:
    """Draw a word with its middle at u = 0."""
    return text(word, -0.4 * height * len(word) + 0.13 * height, low, height, color, bold)


def person(u: float, v: float, size: float, color: Color) -> Mark:
    """Draw a pedestrian, ``size`` high around (u, v)."""

    def at(*points: tuple[float, float]) -> Outline:
        return tuple((u + size * a, v + size * b) for a, b in points)

    pen = 0.11 * size
    return (
        dot(u + 0.02 * size, v + 0.4 * size, 0.1 * size, color),
        *line(at((0.0, 0.25), (0.0, -0.05)), 1.8 * pen, color),
        *line(at((0.0, -0.05), (-0.08, -0.25), (-0.22, -0.45)), pen, color),
        *line(at((0.0, -0.05), (0.13, -0.24), (0.15, -0.47)), pen, color),
        *line(at((0.0, 0.24), (-0.18, 0.08), (-0.2, -0.05)), 0.7 * pen, color),
        *line(at((0.0, 0.24), (0.16, 0.1), (0.24, 0.02)), 0.7 * pen, color),
    )


def bicycle(u: float, v: float, size: float, color: Color, field: Color) -> Mark:
    """Draw a bicycle ``size`` long around (u, v) on ``field``."""

    def at(*points: tuple[float, float]) -> Outline:
        return tuple((u + size * a, v + size * b) for a, b in points)

    wheels = tuple(
        layer
        for side in (-0.3, 0.3)
        for layer in (
            dot(u + side * size, v - 0.12 * size, 0.2 * size, color),
            dot(u + side * size, v - 0.12 * size, 0.14 * size, field, 3),
        )
    )
    pen = 0.05 * size
    frame = (
        *line(at((-0.3, -0.12), (-0.1, 0.14), (0.18, 0.14), (0.0, -0.12), (-0.3, -0.12)), pen,
              color, 3),
        *line(at((0.3, -0.12), (0.16, 0.25), (0.27, 0.25)), pen, color, 3),
        *line(at((-0.18, 0.22), (-0.04, 0.22)), 1.4 * pen, color, 3),
    )  # fmt: skip
    return wheels + frame


def car(u: float, v: float, size: float, color: Color) -> Mark:
    """Draw a car from the front, ``size`` wide around (u, v)."""

    def at(outline: Outline) -> Layer:
        return Layer(moved(outline, u, v, size), color)

    return (
        at(rectangle(-0.5, -0.2, 0.5, 0.08)),
        at(((-0.42, 0.08), (0.42, 0.08), (0.3, 0.36), (-0.3, 0.36))),
        at(rectangle(-0.46, -0.36, -0.28, -0.2)),
        at(rectangle(0.28, -0.36, 0.46, -0.2)),
    )
