"""Forty faces of traffic signs, drawn from pictograms."""

from __future__ import annotations

from collections.abc import Callable
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
    """What one sign shows."""

    draw: Draw  # layers, the first of them the plate
    size: float = 1.0  # of its unit over that of a round sign
    supplement: bool = True  # may have a small plate below


CIRCLE, OCTAGON, DIAMOND = regular(24), regular(8, 0.5), regular(4)
TRIANGLE, YIELD = regular(3), regular(3, 0.5)
SQUARE = rectangle(-0.85, -0.85, 0.85, 0.85)


def _prohibits(mark: Callable[[Inks], Mark], slash: bool = False) -> Draw:
    def draw(inks: Inks, rng: np.random.Generator) -> Mark:
        bar = line(((-0.55, 0.55), (0.55, -0.55)), 0.15, inks.red, 3) if slash else ()
        return (*plate(CIRCLE, inks.red, inks.white, 0.80), *mark(inks), *bar)

    return draw


def _mandates(mark: Callable[[Inks], Mark]) -> Draw:
    return lambda inks, rng: (*plate(CIRCLE, inks.white, inks.blue, 0.95), *mark(inks))


def _warns(mark: Callable[[Inks], Mark]) -> Draw:
    return lambda inks, rng: (*plate(TRIANGLE, inks.red, inks.white, 0.70), *mark(inks))


def _informs(mark: Callable[[Inks], Mark], outline: Outline = SQUARE) -> Draw:
    return lambda inks, rng: (*plate(outline, inks.white, inks.blue, 0.93), *mark(inks))


def _roundabout(color: Color) -> Mark:
    """Three arrows that chase one another."""
    bow = tuple((float(0.5 * np.sin(a)), float(0.5 * np.cos(a))) for a in (1.0, 0.6, 0.15, -0.3))
    one = arrow(bow, 0.14, color)
    return one + turned(one, 2 * np.pi / 3) + turned(one, 4 * np.pi / 3)


def _works(inks: Inks) -> Mark:
    """Someone who digs, and the heap."""
    b = inks.black
    return (
        dot(-0.12, 0.28, 0.09, b), *line(((-0.14, 0.14), (0.0, -0.06), (-0.18, -0.34)), 0.12, b),
        *line(((-0.1, 0.1), (0.14, -0.04), (0.3, -0.3)), 0.06, b),
        Layer(((0.14, -0.36), (0.5, -0.36), (0.34, -0.16)), b),
    )  # fmt: skip


def _crossing(inks: Inks, rng: np.random.Generator) -> Mark:
    stripes = (Layer(rectangle(u, -0.55, u + 0.1, -0.4), inks.black, 3)
               for u in (-0.4, -0.2, 0.0, 0.2))  # fmt: skip
    walker = (la._replace(level=3) for la in person(0.0, -0.08, 0.62, inks.black))
    white = Layer(moved(TRIANGLE, 0, -0.13, 0.78), inks.white)
    return (*plate(SQUARE, inks.white, inks.blue, 0.95), white, *stripes, *walker)


def _dead_end(inks: Inks, rng: np.random.Generator) -> Mark:
    return (
        *plate(SQUARE, inks.white, inks.blue, 0.95), *line(((0, -0.6), (0, 0.2)), 0.26, inks.white),
        Layer(rectangle(-0.5, 0.2, 0.5, 0.45), inks.red, 3),
    )  # fmt: skip


def _priority(inks: Inks, rng: np.random.Generator) -> Mark:
    gold = Layer(regular(4, radius=0.66), inks.yellow)
    return (*plate(DIAMOND, inks.black, inks.white, 0.95), gold)


def _stop(inks: Inks, rng: np.random.Generator) -> Mark:
    return (
        *plate(OCTAGON, inks.white, inks.red, 0.93),
        *centred("STOP", -0.25, 0.48, inks.white, 0.24),
    )


def _give_way(inks: Inks, rng: np.random.Generator) -> Mark:
    return (*plate(YIELD, inks.red, inks.white, 0.64), *centred("GIVE", 0.08, 0.14, inks.black),
            *centred("WAY", -0.14, 0.14, inks.black))  # fmt: skip


def _no_entry(inks: Inks, rng: np.random.Generator) -> Mark:
    bar = Layer(rectangle(-0.7, -0.17, 0.7, 0.17), inks.white)
    return (*plate(CIRCLE, inks.white, inks.red, 0.95), bar)


def _clearway(cross: bool) -> Draw:
    def draw(inks: Inks, rng: np.random.Generator) -> Mark:
        bars = line(((-0.55, 0.55), (0.55, -0.55)), 0.17, inks.red)
        if cross:
            bars += line(((-0.55, -0.55), (0.55, 0.55)), 0.17, inks.red)
        return (*plate(CIRCLE, inks.red, inks.blue, 0.80), *bars)

    return draw


def _speed(number: str) -> Draw:
    return _prohibits(lambda inks: centred(number, -0.35, 0.7, inks.black, 0.18))


_WIDE = rectangle(-1.5, -0.45, 1.5, 0.45)
_TALL = rectangle(-0.7, -1.1, 0.7, 1.1)
FACES: dict[str, Face] = {
    "give way": Face(_give_way, 1.25),
    "speed 30": Face(_speed("30")),
    "parking": Face(_informs(lambda i: text("P", -0.26, -0.6, 1.2, i.white, 0.2))),
    "works": Face(_warns(_works), 1.25),
    "keep left": Face(
        _mandates(lambda i: turned(arrow(((0.0, 0.6), (0.0, -0.2)), 0.26, i.white), 0.75))
    ),
    "direction board": Face(board("green", "white", 2.3, 1.1, 3), 1.0, False),
    "no entry": Face(_no_entry),
    "street name": Face(street_name, 0.9, False),
    "stop": Face(_stop),
    "crossing": Face(_crossing),
    "speed 20": Face(_speed("20"), 1.05),
    "pedestrians": Face(_warns(lambda i: person(0.0, -0.02, 0.8, i.black)), 1.2),
    "one way": Face(
        _informs(lambda i: arrow(((-1.1, 0.0), (0.7, 0.0)), 0.24, i.white), _WIDE), 1.0, False
    ),
    "no stopping": Face(_clearway(True), 0.85),
    "turn left": Face(
        _mandates(lambda i: arrow(((0.35, -0.55), (0.35, 0.1), (-0.2, 0.1)), 0.22, i.white))
    ),
    "bus stop": Face(bus_stop, 0.8, False),
    "chevrons": Face(chevrons, 0.95, False),
    "no right turn": Face(
        _prohibits(lambda i: arrow(((-0.3, -0.5), (-0.3, 0.1), (0.15, 0.1)), 0.16, i.black), True)
    ),
    "crossroads": Face(
        _warns(
            lambda i: (
                *line(((0, -0.35), (0, 0.4)), 0.17, i.black),
                *line(((-0.35, 0), (0.35, 0)), 0.17, i.black),
            )
        ),
        1.3,
    ),
    "town board": Face(board("white", "black", 1.9, 0.75, 2), 1.0, False),
    "roundabout": Face(_mandates(lambda i: _roundabout(i.white))),
    "no waiting": Face(_clearway(False), 0.75),
    "cycle route": Face(_mandates(lambda i: bicycle(0.0, 0.0, 1.2, i.white, i.blue))),
    "dead end": Face(_dead_end, 0.9),
    "speed 40": Face(_speed("40"), 1.15),
    "bend": Face(
        _warns(
            lambda i: arrow(((-0.1, -0.4), (-0.1, -0.1), (0.12, 0.1), (0.12, 0.2)), 0.14, i.black)
        ),
        1.15,
    ),
    "museum": Face(finger, 0.9, False),
    "no cycling": Face(_prohibits(lambda i: bicycle(0.0, 0.0, 1.05, i.black, i.white))),
    "bumps": Face(
        _warns(
            lambda i: (
                *line(((-0.45, -0.25), (0.45, -0.25)), 0.09, i.black),
                dot(-0.2, -0.2, 0.16, i.black),
                dot(0.2, -0.2, 0.16, i.black),
            )
        ),
        1.3,
    ),
    "lights ahead": Face(
        _warns(
            lambda i: (
                Layer(rectangle(-0.14, -0.4, 0.14, 0.42), i.black),
                dot(0, 0.28, 0.1, i.red, 3),
                dot(0, 0.01, 0.1, i.yellow, 3),
                dot(0, -0.26, 0.1, i.green, 3),
            )
        ),
        1.2,
    ),
    "no overtaking": Face(
        _prohibits(lambda i: car(-0.28, 0.0, 0.48, i.red) + car(0.28, 0.0, 0.48, i.black)), 1.1
    ),
    "diversion": Face(diversion, 1.0, False),
    "shared path": Face(
        _mandates(
            lambda i: person(0.0, 0.36, 0.8, i.white) + bicycle(0.0, -0.38, 0.9, i.white, i.blue)
        ),
        0.9,
    ),
    "narrows": Face(
        _warns(
            lambda i: (
                line(((-0.3, -0.4), (-0.3, -0.1), (-0.12, 0.1), (-0.12, 0.3)), 0.1, i.black)
                + line(((0.3, -0.4), (0.3, -0.1), (0.12, 0.1), (0.12, 0.3)), 0.1, i.black)
            )
        ),
        1.3,
    ),
    "priority": Face(_priority, 1.1),
    "motorway": Face(board("blue", "white", 1.7, 1.35, 4), 1.0, False),
    "ahead only": Face(_mandates(lambda i: arrow(((0, -0.6), (0, 0.2)), 0.24, i.white)), 1.1),
    "hospital": Face(_informs(lambda i: centred("H", -0.5, 1.0, i.white, 0.22), _TALL)),
    "children": Face(
        _warns(lambda i: person(-0.2, -0.04, 0.62, i.black) + person(0.2, -0.1, 0.5, i.black)), 1.35
    ),
    "danger": Face(
        _warns(
            lambda i: (*line(((0, 0.4), (0, -0.08)), 0.15, i.black), dot(0, -0.32, 0.1, i.black))
        ),
        1.1,
    ),
}
"""Every face by its name."""
