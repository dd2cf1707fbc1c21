"""Traffic sign plates that hang on a signpost at x = y = 0 and face the camera (-x).

A plate is a stack of convex outlines, each a little nearer to the camera: border, field, symbol.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, Point, box, merge, polygon, vary
from scene.assets.signpost import MAX_RADIUS, MIN_HEIGHT

KINDS: tuple[str, ...] = (
    "speed limit", "warning", "direction", "stop", "parking", "board", "give way", "no entry",
    "works",
)  # fmt: skip

Outline = tuple[tuple[float, float], ...]
"""Corners (to the viewer's right, up) around the edge of a convex shape, in plate radii."""

LAYER = 0.006
"""Distance between the layers of a plate (metres)."""

RED: Color = (0.42, 0.02, 0.025)
BLUE: Color = (0.015, 0.07, 0.30)
WHITE: Color = (0.68, 0.68, 0.66)
BLACK: Color = (0.02, 0.02, 0.02)
YELLOW: Color = (0.60, 0.36, 0.02)
GREEN: Color = (0.01, 0.13, 0.06)
BROWN: Color = (0.13, 0.045, 0.015)
GREY: Color = (0.26, 0.27, 0.28)


def _regular(corners: int, turn: float = 0.0, radius: float = 1.0) -> Outline:
    angle = 2 * np.pi * (np.arange(corners) + turn) / corners
    return tuple((float(radius * np.sin(a)), float(radius * np.cos(a))) for a in angle)


def _rectangle(left: float, low: float, right: float, high: float) -> Outline:
    return ((left, low), (right, low), (right, high), (left, high))


CIRCLE, OCTAGON = _regular(16), _regular(8, turn=0.5)
TRIANGLE, YIELD = _regular(3), _regular(3, turn=0.5)
SQUARE = _rectangle(-0.8, -0.8, 0.8, 0.8)


class Layer(NamedTuple):
    """One flat shape of a plate."""

    outline: Outline
    color: Color


class TrafficSignParams(NamedTuple):
    """A plate of several layers, and perhaps a small plate below it."""

    centre: float  # height of the plate's centre, m
    radius: float  # size of the plate, m: its outlines are in this unit
    layers: tuple[Layer, ...]  # back to front; the first is the whole plate
    supplement: Color | None  # colour of a small plate below, or no such plate
    back: Color


def _scaled(outline: Outline, factor: float) -> Outline:
    return tuple((factor * u, factor * v) for u, v in outline)


def _ringed(outline: Outline, border: Color, field: Color, inner: float) -> tuple[Layer, ...]:
    return Layer(outline, border), Layer(_scaled(outline, inner), field)


def _number(color: Color, width: float, height: float) -> tuple[Layer, ...]:
    """A blocky 30."""
    w, h, pen = width, height, 0.14
    three = [_rectangle(-w, z - pen / 2, -0.06, z + pen / 2) for z in (h - pen / 2, 0, pen / 2 - h)]
    three.append(_rectangle(-0.06 - pen, -h, -0.06, h))
    zero = [_rectangle(x, -h, x + pen, h) for x in (0.06, w - pen)]
    zero += [_rectangle(0.06, z, w, z + pen) for z in (-h, h - pen)]
    return tuple(Layer(outline, color) for outline in three + zero)


def _arrow(color: Color, turn: float) -> tuple[Layer, ...]:
    """An arrow through the centre, pointing up turned clockwise by ``turn`` radians."""
    cos, sin = np.cos(turn), np.sin(turn)
    shapes = (_rectangle(-0.13, -0.65, 0.13, 0.25), ((-0.42, 0.15), (0.42, 0.15), (0.0, 0.7)))
    return tuple(
        Layer(tuple((float(cos * u + sin * v), float(cos * v - sin * u)) for u, v in shape), color)
        for shape in shapes
    )


def _text(
    rng: np.random.Generator, color: Color, lines: int, width: float, height: float
) -> Iterator[Layer]:
    """Rows of words as bars of uneven length, and an arrow at the end of the first."""
    step = 2 * height / lines
    for line in range(lines):
        top = height - (line + 0.25) * step
        right = float(rng.uniform(-0.1, 0.6)) * width
        yield Layer(_rectangle(-0.85 * width, top - 0.5 * step, right, top), color)
        tip = 0.9 * width
        head = ((tip - step / 2, top), (tip, top - step / 4), (tip - step / 2, top - step / 2))
        yield Layer(head, color)


def sample_traffic_sign(rng: np.random.Generator, kind: str) -> TrafficSignParams:
    """Draw a sign of one of ``KINDS``."""
    red, blue, white = vary(rng, RED, 0.25), vary(rng, BLUE, 0.3), vary(rng, WHITE, 0.15)
    radius = float(rng.uniform(0.30, 0.42))
    match kind:
        case "speed limit":
            layers = (*_ringed(CIRCLE, red, white, 0.78), *_number(BLACK, 0.5, 0.38))
        case "warning":
            bar = Layer(_rectangle(-0.09, -0.12, 0.09, 0.42), BLACK)
            dot = Layer(_rectangle(-0.09, -0.32, 0.09, -0.18), BLACK)
            layers = (*_ringed(TRIANGLE, red, white, 0.68), bar, dot)
            radius *= 1.25
        case "direction":
            turns = (-np.pi / 2, 0.0, np.pi / 2, np.pi * 3 / 4)
            layers = (*_ringed(CIRCLE, white, blue, 0.94), *_arrow(white, rng.choice(turns)))
        case "stop":
            letters = (_rectangle(x, -0.24, x + 0.24, 0.24) for x in (-0.66, -0.3, 0.06, 0.42))
            word = (Layer(letter, white) for letter in letters)
            layers = (*_ringed(OCTAGON, white, red, 0.93), *word)
        case "parking":
            strokes = (
                _rectangle(-0.35, -0.6, -0.12, 0.6), _rectangle(-0.35, 0.4, 0.35, 0.6),
                _rectangle(-0.35, -0.1, 0.35, 0.1), _rectangle(0.15, -0.1, 0.38, 0.6),
            )  # fmt: skip
            layers = (*_ringed(SQUARE, white, blue, 0.93), *(Layer(s, white) for s in strokes))
        case "board":
            fields = (
                (GREEN, WHITE),
                (WHITE, BLACK),
                (BROWN, WHITE),
                (BLUE, WHITE),
                (YELLOW, BLACK),
            )
            field, ink = fields[rng.integers(len(fields))]
            width, height = float(rng.uniform(1.6, 2.4)), float(rng.uniform(0.8, 1.3))
            plate, inner = (_rectangle(-w, -h, w, h) for w, h in
                            ((width, height), (width - 0.1, height - 0.1)))  # fmt: skip
            lines = int(rng.integers(2, 4))
            layers = (
                Layer(plate, ink), Layer(inner, vary(rng, field, 0.2)),
                *_text(rng, ink, lines, width, 0.85 * height),
            )  # fmt: skip
        case "give way":
            layers = _ringed(YIELD, red, white, 0.62)
            radius *= 1.25
        case "no entry":
            layers = (
                *_ringed(CIRCLE, white, red, 0.95),
                Layer(_rectangle(-0.7, -0.17, 0.7, 0.17), white),
            )
        case "works":
            yellow = vary(rng, YELLOW, 0.2)
            layers = (
                *_ringed(_regular(4), BLACK, yellow, 0.9),
                *_arrow(BLACK, float(rng.uniform(-1, 1))),
            )
            radius *= 1.2
        case _:
            raise ValueError(f"unknown kind of traffic sign {kind!r}; known: {', '.join(KINDS)}")
    supplements = (None, None, None, white, YELLOW, blue)
    return TrafficSignParams(
        centre=float(rng.uniform(2.1, MIN_HEIGHT - 0.05)), radius=radius, layers=layers,
        supplement=None if kind == "board" else supplements[rng.integers(len(supplements))],
        back=vary(rng, GREY, 0.2),
    )  # fmt: skip


def _face(layer: Layer, params: TrafficSignParams, x: float) -> Asset:
    """A layer in the plane ``x``; the viewer's right is -y."""
    corners: list[Point] = [
        (x, -u * params.radius, params.centre + v * params.radius) for u, v in layer.outline
    ]
    return polygon(corners, layer.color, "paint")


def traffic_sign(params: TrafficSignParams) -> Asset:
    """Build the sign."""
    p = params
    back = -MAX_RADIUS - LAYER
    plate = p.layers[0]
    # Symbols may share a plane: only border, field and symbol lie over one another.
    faces = [
        _face(layer, p, back - LAYER * min(depth + 1, 3)) for depth, layer in enumerate(p.layers)
    ]
    rear = _face(Layer(plate.outline, p.back), p, back)
    low = p.centre + p.radius * min(v for _, v in plate.outline)
    extra = box(
        (LAYER, 1.3 * p.radius, 0.45 * p.radius), (back, 0, low - 0.55 * p.radius),
        p.supplement or p.back, "paint",
    )  # fmt: skip
    return merge(rear, *faces, *((extra,) if p.supplement else ()))
