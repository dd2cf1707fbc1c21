"""The forty faces of traffic signs, drawn from pictograms."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from scene.assets.parts.pictogram import (
    Layer,
    Mark,
    Outline,
    arrow,
    bicycle,
    car,
    centred,
    dot,
    line,
    moved,
    person,
    rectangle,
    regular,
    text,
    turned,
)
from scene.assets.parts.sign_boards import (
    Draw,
    Inks,
    board,
    bus_stop,
    chevrons,
    diversion,
    finger,
    plate,
    street_name,
)
from scene.mesh.asset import Color


class Face(NamedTuple):
    """The face of a sign."""

    draw: Draw  # draws the layers, the first of which is the plate
    size: float = 1.0  # relative to a round sign
    supplement: bool = True  # may have a small plate below


CIRCLE, OCTAGON, DIAMOND = regular(24), regular(8, 0.5), regular(4)
TRIANGLE, YIELD = regular(3), regular(3, 0.5)
SQUARE = rectangle(-0.85, -0.85, 0.85, 0.85)


def _plate_face(
    outline: Outline, border: str, field: str, inner: float, mark: Callable[[Inks], Mark]
) -> Draw:
    """Return the face of a plate with a mark on a field and a border.

    Args:
        outline: of the plate.
        border: ink of the border, by name.
        field: ink of the field, by name.
        inner: size of the field, as a share of the plate's.
        mark: draws the mark in given inks.
    """

    def draw(inks: Inks, rng: np.random.Generator) -> Mark:
        return plate(outline, getattr(inks, border), getattr(inks, field), inner) + mark(inks)

    return draw


_prohibits = partial(_plate_face, CIRCLE, "red", "white", 0.80)
_clearway = partial(_plate_face, CIRCLE, "red", "blue", 0.80)
_mandates = partial(_plate_face, CIRCLE, "white", "blue", 0.95)
_warns = partial(_plate_face, TRIANGLE, "red", "white", 0.70)
_informs = partial(_plate_face, SQUARE, "white", "blue", 0.95)


def _blue_plate(outline: Outline, mark: Callable[[Inks], Mark]) -> Draw:
    return _plate_face(outline, "white", "blue", 0.93, mark)


def _slash(inks: Inks, pen: float, level: int = 2) -> Mark:
    return line(((-0.55, 0.55), (0.55, -0.55)), pen, inks.red, level)


def _roundabout(color: Color) -> Mark:
    """Draw three arrows in a circle."""
    bow = tuple((float(0.5 * np.sin(a)), float(0.5 * np.cos(a))) for a in (1.0, 0.6, 0.15, -0.3))
    one_arrow = arrow(bow, 0.14, color)
    return one_arrow + turned(one_arrow, 2 * np.pi / 3) + turned(one_arrow, 4 * np.pi / 3)


def _works(inks: Inks) -> Mark:
    """Draw a digging person and a heap."""
    b = inks.black
    return (
        dot(-0.12, 0.28, 0.09, b), *line(((-0.14, 0.14), (0.0, -0.06), (-0.18, -0.34)), 0.12, b),
        *line(((-0.1, 0.1), (0.14, -0.04), (0.3, -0.3)), 0.06, b),
        Layer(((0.14, -0.36), (0.5, -0.36), (0.34, -0.16)), b),
    )  # fmt: skip


def _crossing(inks: Inks) -> Mark:
    """Draw a pedestrian on stripes in a white triangle."""
    stripes = (Layer(rectangle(u, -0.55, u + 0.1, -0.4), inks.black, 3)
               for u in (-0.4, -0.2, 0.0, 0.2))  # fmt: skip
    walker = (la._replace(level=3) for la in person(0.0, -0.08, 0.62, inks.black))
    return (Layer(moved(TRIANGLE, 0, -0.13, 0.78), inks.white), *stripes, *walker)


def _dead_end(inks: Inks) -> Mark:
    end = Layer(rectangle(-0.5, 0.2, 0.5, 0.45), inks.red, 3)
    return (*line(((0, -0.6), (0, 0.2)), 0.26, inks.white), end)


def _bar(inks: Inks) -> Mark:
    return (Layer(rectangle(-0.7, -0.17, 0.7, 0.17), inks.white),)


def _give_way(inks: Inks) -> Mark:
    return centred("GIVE", 0.08, 0.14, inks.black) + centred("WAY", -0.14, 0.14, inks.black)


def _speed(number: str) -> Draw:
    return _prohibits(lambda inks: centred(number, -0.35, 0.7, inks.black, 0.18))


_WIDE = rectangle(-1.5, -0.45, 1.5, 0.45)
_TALL = rectangle(-0.7, -1.1, 0.7, 1.1)
FACES: dict[str, Face] = {
    "give way": Face(_plate_face(YIELD, "red", "white", 0.64, _give_way), 1.25),
    "speed 30": Face(_speed("30")),
    "parking": Face(_blue_plate(SQUARE, lambda i: text("P", -0.26, -0.6, 1.2, i.white, 0.2))),
    "works": Face(_warns(_works), 1.25),
    "keep left": Face(_mandates(
        lambda i: turned(arrow(((0.0, 0.6), (0.0, -0.2)), 0.26, i.white), 0.75))),
    "direction board": Face(board("green", "white", 2.3, 1.1, 3), 1.0, False),
    "no entry": Face(_plate_face(CIRCLE, "white", "red", 0.95, _bar)),
    "street name": Face(street_name, 0.9, False),
    "stop": Face(_plate_face(
        OCTAGON, "white", "red", 0.93, lambda i: centred("STOP", -0.25, 0.48, i.white, 0.24))),
    "crossing": Face(_informs(_crossing)),
    "speed 20": Face(_speed("20"), 1.05),
    "pedestrians": Face(_warns(lambda i: person(0.0, -0.02, 0.8, i.black)), 1.2),
    "one way": Face(
        _blue_plate(_WIDE, lambda i: arrow(((-1.1, 0.0), (0.7, 0.0)), 0.24, i.white)), 1.0, False),
    "no stopping": Face(_clearway(
        lambda i: _slash(i, 0.17) + line(((-0.55, -0.55), (0.55, 0.55)), 0.17, i.red)), 0.85),
    "turn left": Face(_mandates(
        lambda i: arrow(((0.35, -0.55), (0.35, 0.1), (-0.2, 0.1)), 0.22, i.white))),
    "bus stop": Face(bus_stop, 0.8, False),
    "chevrons": Face(chevrons, 0.95, False),
    "no right turn": Face(_prohibits(lambda i: arrow(
        ((-0.3, -0.5), (-0.3, 0.1), (0.15, 0.1)), 0.16, i.black) + _slash(i, 0.15, 3))),
    "crossroads": Face(_warns(lambda i: (
        line(((0, -0.35), (0, 0.4)), 0.17, i.black)
        + line(((-0.35, 0), (0.35, 0)), 0.17, i.black))), 1.3),
    "town board": Face(board("white", "black", 1.9, 0.75, 2), 1.0, False),
    "roundabout": Face(_mandates(lambda i: _roundabout(i.white))),
    "no waiting": Face(_clearway(lambda i: _slash(i, 0.17)), 0.75),
    "cycle route": Face(_mandates(lambda i: bicycle(0.0, 0.0, 1.2, i.white, i.blue))),
    "dead end": Face(_informs(_dead_end), 0.9),
    "speed 40": Face(_speed("40"), 1.15),
    "bend": Face(_warns(lambda i: arrow(
        ((-0.1, -0.4), (-0.1, -0.1), (0.12, 0.1), (0.12, 0.2)), 0.14, i.black)), 1.15),
    "museum": Face(finger, 0.9, False),
    "no cycling": Face(_prohibits(lambda i: bicycle(0.0, 0.0, 1.05, i.black, i.white))),
    "bumps": Face(_warns(lambda i: (
        *line(((-0.45, -0.25), (0.45, -0.25)), 0.09, i.black),
        *(dot(u, -0.2, 0.16, i.black) for u in (-0.2, 0.2)))), 1.3),
    "lights ahead": Face(_warns(lambda i: (
        Layer(rectangle(-0.14, -0.4, 0.14, 0.42), i.black), dot(0, 0.28, 0.1, i.red, 3),
        dot(0, 0.01, 0.1, i.yellow, 3), dot(0, -0.26, 0.1, i.green, 3))), 1.2),
    "no overtaking": Face(_prohibits(
        lambda i: car(-0.28, 0.0, 0.48, i.red) + car(0.28, 0.0, 0.48, i.black)), 1.1),
    "diversion": Face(diversion, 1.0, False),
    "shared path": Face(_mandates(lambda i: (
        person(0.0, 0.36, 0.8, i.white) + bicycle(0.0, -0.38, 0.9, i.white, i.blue))), 0.9),
    "narrows": Face(_warns(lambda i: (
        line(((-0.3, -0.4), (-0.3, -0.1), (-0.12, 0.1), (-0.12, 0.3)), 0.1, i.black)
        + line(((0.3, -0.4), (0.3, -0.1), (0.12, 0.1), (0.12, 0.3)), 0.1, i.black))), 1.3),
    "priority": Face(_plate_face(
        DIAMOND, "black", "white", 0.95, lambda i: (Layer(regular(4, radius=0.66), i.yellow),)), 1.1),
    "motorway": Face(board("blue", "white", 1.7, 1.35, 4), 1.0, False),
    "ahead only": Face(_mandates(lambda i: arrow(((0, -0.6), (0, 0.2)), 0.24, i.white)), 1.1),
    "hospital": Face(_blue_plate(_TALL, lambda i: centred("H", -0.5, 1.0, i.white, 0.22))),
    "children": Face(_warns(
        lambda i: person(-0.2, -0.04, 0.62, i.black) + person(0.2, -0.1, 0.5, i.black)), 1.35),
    "danger": Face(_warns(
        lambda i: (*line(((0, 0.4), (0, -0.08)), 0.15, i.black), dot(0, -0.32, 0.1, i.black))), 1.1),
}  # fmt: skip
"""Faces by name."""
