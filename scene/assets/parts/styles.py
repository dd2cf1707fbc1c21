"""Parameters of buildings: the rules by which those of each kind are drawn."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from scene.assets.parts.draw import between, integer, near, one_of, sample_fields
from scene.assets.parts.facade import Finish
from scene.assets.parts.palette import ANTHRACITE, BLACK_PAINT, BRIGHT_WHITE, OFF_WHITE, pick
from scene.mesh.asset import Color, vary

BRICKS: tuple[Color, ...] = (
    (0.34, 0.285, 0.20), (0.205, 0.115, 0.085), (0.27, 0.215, 0.15), (0.135, 0.085, 0.068),
    (0.42, 0.36, 0.26), (0.17, 0.125, 0.10),
)  # fmt: skip
"""Yellow-grey gault, red, stock, dark, pale and brown brick; real walls are hardly saturated."""
RENDERS: tuple[Color, ...] = (
    (0.76, 0.75, 0.71), (0.70, 0.62, 0.46), (0.66, 0.66, 0.67), (0.60, 0.46, 0.40),
    (0.48, 0.55, 0.60), (0.62, 0.52, 0.30), (0.50, 0.54, 0.44), (0.80, 0.78, 0.72),
)  # fmt: skip
STONES: tuple[Color, ...] = ((0.42, 0.37, 0.28), (0.20, 0.175, 0.135), (0.52, 0.47, 0.37))
PAINTS: tuple[Color, ...] = (
    (0.02, 0.045, 0.18), (0.02, 0.10, 0.05), (0.33, 0.02, 0.025), BLACK_PAINT,
    (0.62, 0.57, 0.42), (0.03, 0.20, 0.24), (0.50, 0.20, 0.02), (0.16, 0.02, 0.08),
    (0.70, 0.70, 0.68), (0.55, 0.42, 0.03),
)  # fmt: skip
SLATES: tuple[Color, ...] = (
    (0.075, 0.08, 0.09), (0.16, 0.075, 0.05), (0.12, 0.105, 0.09), (0.05, 0.05, 0.055),
)  # fmt: skip
CURTAINS: tuple[Color, ...] = ((0.5, 0.48, 0.42), (0.35, 0.30, 0.24), OFF_WHITE)


class BuildingParams(NamedTuple):
    """A block of storeys with a grid of windows under one roof."""

    width: float  # along x, m
    depth: float  # along y, m
    storeys: int  # above the ground floor
    ground: float  # height of the ground floor, m
    storey: float  # height of each storey above it, m
    bays: int  # windows in a row
    window: tuple[float, float]  # width and height, as shares of bay and storey
    panes: tuple[int, int]  # across and up, in each window
    trim: tuple[str, ...]  # of "sills", "lintels", "strings", "cornice", "quoins", "timbers", ...
    head: str  # of the upper windows: "flat", "round" or "pointed"
    side_windows: int  # in a row of each side wall
    ground_floor: str  # "doors", "shop", "gates", "windows" or "decks"
    doors: tuple[int, ...]  # bays with a door, where the ground floor has doors
    hood: float  # depth of a slab over each door or of a shop's awning, m; 0 for none
    balconies: tuple[int, ...]  # bays with balconies
    bay_windows: tuple[int, ...]  # bays with a bay window at the ground floor
    dormers: int  # in the front slope
    roof: str  # "flat", "gable" (ridge along the road), "front gable" or "hip"
    rise: float  # height of roof or parapet, m
    chimneys: int  # up to 2, one at either end
    tower: float  # minimum height of a tower at the left, m; 0 for none
    spire: float  # height of a spire on it, m
    wall: Finish
    ground_wall: Finish  # of the ground floor
    frame: Color  # around panes; sills, cornice, slabs
    accent: Color  # doors, signboard, gates, railings
    second_color: Color  # stripes of awnings
    roof_color: Color
    chimney: Color
    curtain: Color
    seed: int


class Choices(NamedTuple):
    """Materials and choices that are drawn for every kind in the same way."""

    paint: Color
    stone: Color
    bricks: Finish
    plaster: Finish
    stones: Finish
    concrete: Finish
    brick_or_plaster: Finish  # bricks or plaster
    has_hood: bool
    has_flat_roof: bool
    white: Color
    dark: Color


def _shop(d: Choices, wall: Finish) -> dict[str, Any]:
    """Return the rules of homes over a shop."""
    return dict(
        storeys=integer(1, 4), ground=between(3.4, 4), bays=integer(3, 6),
        ground_floor="shop", ground_wall=(d.paint, "paint"),
        wall=wall,
        roof="flat" if d.has_flat_roof else "gable", trim=("sills", "lintels", "sign", "cornice"),
        rise=between(0.6, 1) if d.has_flat_roof else between(1.8, 2.8),
        hood=0.6 if d.has_hood else 0.0, chimneys=integer(0, 3),
        dormers=0 if d.has_flat_roof else integer(0, 3), second_color=d.white,
    )  # fmt: skip


KINDS: dict[str, Callable[[Choices], dict[str, Any]]] = {
    "terrace": lambda d: {},
    "shop": lambda d: _shop(d, d.plaster),
    "office": lambda d: dict(
        width=between(10, 13.5), depth=11.0, storeys=integer(2, 6), ground=3.6,
        storey=between(3.1, 3.5), bays=integer(4, 7),
        window=(between(0.72, 0.9), between(0.45, 0.6)), panes=(2, 1), trim=("plant",),
        side_windows=2, ground_floor="windows", hood=0.0, roof="flat", rise=1.0, chimneys=0,
        wall=one_of(d.concrete, d.bricks, d.stones), ground_wall=(d.dark, "paint"),
        frame=one_of(d.dark, d.white),
    ),
    "apartments": lambda d: dict(
        width=between(10, 13), depth=11.0, storeys=integer(2, 5), ground=3.0,
        storey=2.9, window=(0.5, 0.6), panes=(2, 1), trim=("dish", "number"),
        side_windows=2, doors=(2,), hood=0.5, balconies=one_of((1, 2), (0, 3)),
        roof="flat" if d.has_flat_roof else "hip", rise=0.9 if d.has_flat_roof else between(2, 3),
        chimneys=0, wall=d.brick_or_plaster, ground_wall=d.plaster, accent=d.dark,
        frame=one_of(d.dark, d.white),
    ),
    "detached": lambda d: dict(
        width=between(8.2, 9.5), storeys=1, bays=3, window=(0.55, 0.5), panes=(3, 2),
        side_windows=2, doors=(1,), hood=0.55, rise=between(2.4, 3.4), chimneys=1,
        roof=one_of("hip", "front gable"), wall=d.plaster, bay_windows=(0,),
        ground_wall=d.brick_or_plaster, roof_color=near(0.25, (0.20, 0.08, 0.05)),
    ),
    "warehouse": lambda d: dict(
        width=between(11, 14), depth=12.0, storeys=1, ground=4.0, storey=between(1.8, 2.6),
        window=(0.7, 0.42), panes=(2, 1), trim=("ribs",), ground_floor="gates",
        roof="front gable", rise=between(1, 1.8), chimneys=0, frame=d.concrete[0],
        wall=(near(0.5, (0.24, 0.27, 0.29)), "metal"),
    ),
    "townhouse": lambda d: dict(
        width=between(8.5, 10.5), storeys=integer(2, 5), storey=between(3, 3.5),
        window=(0.42, 0.66), panes=(2, 2), doors=(3,), hood=0.0, roof="flat", rise=0.8,
        wall=d.plaster, ground_wall=(near(0.3, *RENDERS), "plaster"),
        trim=("sills", "lintels", "strings", "cornice", "number"),
    ),
    "hall": lambda d: dict(
        tower=between(12, 16), width=between(9, 11.5), depth=12.0, storeys=1, ground=between(3.4, 4),
        storey=between(4.5, 6), bays=3, window=(0.34, 0.72), panes=(2, 3), side_windows=3,
        doors=(1,), hood=0.0, roof="front gable", rise=between(3.5, 5), chimneys=0,
        head="pointed", spire=between(5, 8) if d.has_hood else 0.0,
        trim=("strings",), frame=d.dark, wall=d.stones, ground_wall=d.stones,
    ),
    "bay terrace": lambda d: dict(
        doors=(1, 2), bay_windows=(0, 3), storeys=integer(1, 3), chimneys=2,
        dormers=integer(0, 3), head=one_of("flat", "round"),
        ground_wall=d.brick_or_plaster, trim=("sills", "strings", "lintels", "number"),
    ),
    "pub": lambda d: dict(
        width=between(9, 12), storeys=integer(1, 3), bays=4, doors=(1,),
        wall=d.plaster, ground_wall=(d.paint, "paint"), hood=0.5, panes=(3, 3),
        trim=("sills", "sign", "board", "pipe"), dormers=integer(0, 3),
    ),
    "curtain wall": lambda d: dict(
        width=between(10, 14), depth=12.0, storeys=integer(4, 7), ground=4.0,
        storey=between(2.9, 3.1), bays=integer(6, 10), window=(0.93, 0.74),
        panes=(1, 1), trim=("mullions", "plant"), ground_floor="windows", roof="flat",
        rise=0.7, chimneys=0, hood=0.0, side_windows=3,
        wall=(near(0.3, (0.03, 0.05, 0.07), (0.25, 0.35, 0.38), (0.08, 0.09, 0.10)), "glass"),
        ground_wall=(d.dark, "paint"), frame=one_of(d.dark, d.white),
    ),
    "chain store": lambda d: dict(
        width=between(11, 14), depth=11.0, storeys=integer(1, 4), ground=4.2,
        storey=between(3.2, 3.8), bays=5, window=(0.72, 0.78), panes=(2, 3),
        trim=("cornice", "pilasters", "sign"), ground_floor="shop", hood=0.0, roof="flat",
        rise=1.1, chimneys=0, wall=one_of(d.stones, d.plaster, d.concrete),
        ground_wall=(d.dark, "paint"), frame=d.dark,
    ),
    "georgian": lambda d: dict(
        width=between(9.5, 12.5), storeys=2, storey=between(3.0, 3.4), bays=5, doors=(2,),
        window=(0.46, 0.64), panes=(3, 4), hood=0.6, roof="hip", rise=between(1.6, 2.4),
        trim=("sills", "lintels", "quoins", "strings", "cornice"), frame=d.white,
        dormers=integer(0, 4),
    ),
    "college": lambda d: dict(
        width=between(11, 14), storeys=integer(1, 3), ground=3.8,
        storey=between(3.4, 4.0), bays=5, window=(0.42, 0.62), panes=(2, 2), doors=(2,),
        head="pointed", hood=0.0, roof="flat", rise=0.9, chimneys=2, wall=d.stones,
        ground_wall=d.stones, frame=near(0.3, *STONES), trim=("strings", "battlements"),
        tower=between(11, 15) if d.has_hood else 0.0, chimney=d.stone,
    ),
    "cottage": lambda d: dict(
        width=between(8.2, 10), storeys=1, ground=2.3, storey=1.5, bays=3, doors=(1,),
        window=(0.44, 0.68), panes=(3, 2), dormers=2, rise=between(2.6, 3.6),
        wall=(d.white, "plaster"), ground_wall=(d.white, "plaster"), frame=d.dark, side_windows=1,
        trim=("sills", "pipe"), chimneys=1,
    ),
    "corner": lambda d: dict(
        width=between(10, 12), storeys=integer(2, 4), ground=3.6,
        storey=between(2.9, 3.3), ground_floor="shop", ground_wall=(d.paint, "paint"),
        trim=("turret", "sills", "lintels", "strings"), dormers=2, bays=4, second_color=d.white,
        hood=0.6 if d.has_hood else 0.0, wall=d.brick_or_plaster,
    ),
    "concrete block": lambda d: dict(
        width=between(10, 14), depth=11.0, storeys=integer(3, 6), ground=3.0,
        storey=2.75, bays=6, window=(0.7, 0.5), panes=(2, 1), doors=(2,), hood=0.9,
        trim=("strings", "plant", "dish"), balconies=one_of((0, 5), (1, 4)),
        roof="flat", rise=0.9, chimneys=0, wall=d.concrete, ground_wall=d.bricks,
        side_windows=2, accent=near(0.3, *PAINTS),
    ),
    "car park": lambda d: dict(
        width=between(12, 14.5), depth=12.0, storeys=integer(2, 5), ground=3.2,
        storey=2.9, bays=3, window=(0.93, 0.58), ground_floor="decks", trim=("mullions",),
        roof="flat", rise=0.9, chimneys=0, hood=0.0, wall=d.concrete, ground_wall=d.concrete,
        frame=d.dark, side_windows=0, tower=between(13, 17) if d.has_hood else 0.0,
    ),
    "timbered": lambda d: dict(
        width=between(8.5, 10.5), storeys=integer(1, 3), bays=3, panes=(3, 3),
        window=(0.46, 0.5), doors=(1,), roof=one_of("front gable", "gable"),
        rise=between(2.6, 3.8), wall=(near(0.12, (0.74, 0.70, 0.58)), "plaster"),
        ground_wall=d.brick_or_plaster, trim=("timbers", "sign"), frame=d.dark,
        accent=(0.05, 0.035, 0.025), roof_color=near(0.25, (0.17, 0.08, 0.05)),
    ),
    "mill": lambda d: dict(
        width=between(11, 14), depth=12.0, storeys=integer(3, 5), ground=3.6,
        storey=between(3.2, 3.6), bays=5, window=(0.5, 0.64), panes=(3, 4), head="round",
        ground_floor="gates", trim=("sills", "strings", "pipe"), hood=0.0,
        roof=one_of("front gable", "gable"), chimneys=0, frame=d.dark,
        wall=(near(0.3, *BRICKS[1::2]), "brick"), ground_wall=d.bricks,
    ),
    "bank": lambda d: dict(
        width=between(9.5, 12.5), storeys=integer(1, 3), ground=4.4,
        storey=between(3.6, 4.2), bays=5, window=(0.42, 0.7), panes=(2, 3), doors=(2,),
        head="round", hood=0.0, roof="flat", rise=1.3, chimneys=0, wall=d.stones,
        ground_wall=d.stones, frame=near(0.1, *STONES),
        trim=("pilasters", "cornice", "strings", "board", "sills"), accent=d.dark,
    ),
    "modern terrace": lambda d: dict(
        width=between(9, 11.5), storeys=2, bays=4, window=(0.62, 0.72), panes=(1, 1),
        doors=(0, 2), hood=0.5, roof="front gable" if d.has_hood else "gable", chimneys=0,
        wall=(near(0.15, BRIGHT_WHITE, (0.20, 0.13, 0.08)), one_of("plaster", "wood")),
        ground_wall=d.bricks, frame=d.dark, trim=("number",), balconies=(1,), accent=d.dark,
    ),
    "parade": lambda d: _shop(d, d.bricks),
    "white villa": lambda d: dict(
        width=between(8.5, 11), storeys=integer(1, 3), bays=3, doors=(1,),
        window=(0.42, 0.62), panes=(2, 2), head=one_of("flat", "round"),
        bay_windows=(0, 2), roof="hip", rise=between(1.8, 2.6), hood=0.6,
        wall=(d.white, "plaster"), ground_wall=(d.white, "plaster"),
        trim=("sills", "strings", "cornice", "quoins"), frame=one_of(d.dark, d.white),
    ),
}  # fmt: skip
"""Values and rules by which a kind differs from a terrace."""


def sample_building(rng: np.random.Generator, kind: str) -> BuildingParams:
    """Draw a building of one kind."""
    brick, paint, stone = (pick(rng, colors, 0.3) for colors in (BRICKS, PAINTS, STONES))
    bricks, plaster = (brick, "brick"), (pick(rng, RENDERS, 0.15), "plaster")
    choices = Choices(
        paint=paint, stone=stone, bricks=bricks, plaster=plaster, stones=(stone, "concrete"),
        concrete=(vary(rng, (0.31, 0.30, 0.28), 0.35), "concrete"),
        brick_or_plaster=(bricks, plaster)[rng.integers(2)], has_hood=bool(rng.random() < 0.4),
        has_flat_roof=bool(rng.random() < 0.5), white=vary(rng, BRIGHT_WHITE, 0.08),
        dark=vary(rng, ANTHRACITE, 0.3),
    )  # fmt: skip
    terrace = BuildingParams(
        width=float(rng.uniform(9, 12)), depth=float(rng.uniform(8, 10)), storeys=int(rng.integers(1, 3)),
        ground=float(rng.uniform(2.8, 3.2)), storey=float(rng.uniform(2.7, 3.0)), bays=4,
        window=(0.44, 0.60), panes=(2, 2), trim=("sills", "lintels", "pipe", "dish", "number"),
        head="flat", side_windows=1, ground_floor="doors", doors=((0, 3), (1, 2))[rng.integers(2)],
        hood=0.45 if choices.has_hood else 0.0, balconies=(), bay_windows=(), dormers=0, roof="gable",
        rise=float(rng.uniform(2, 3)), chimneys=2, tower=0.0, spire=0.0, wall=bricks, ground_wall=bricks,
        frame=choices.white, accent=paint, second_color=pick(rng, RENDERS, 0.3),
        roof_color=pick(rng, SLATES, 0.3), chimney=brick, curtain=pick(rng, CURTAINS, 0.3),
        seed=int(rng.integers(2**31)),
    )  # fmt: skip
    return sample_fields(rng, terrace, **KINDS[kind](choices))
