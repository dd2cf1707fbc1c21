"""What buildings there are: the parameters of each kind, drawn at random within its bounds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.mesh.asset import Color, vary

KINDS: tuple[str, ...] = (
    "terrace", "shop", "office", "apartments", "detached", "warehouse", "townhouse", "hall",
    "bay terrace", "pub", "curtain wall", "chain store", "georgian", "college", "cottage", "corner",
    "concrete block", "car park", "timbered", "mill", "bank", "modern terrace", "parade",
    "white villa",
)  # fmt: skip

Finish = tuple[Color, str]
"""Colour and material of a wall."""

BRICKS: tuple[Color, ...] = (
    (0.34, 0.285, 0.20), (0.205, 0.115, 0.085), (0.27, 0.215, 0.15), (0.135, 0.085, 0.068),
    (0.42, 0.36, 0.26), (0.17, 0.125, 0.10),
)  # fmt: skip
"""Yellow-grey gault, red, stock, dark, pale and brown brick: real walls are hardly saturated."""
RENDERS: tuple[Color, ...] = (
    (0.76, 0.75, 0.71), (0.70, 0.62, 0.46), (0.66, 0.66, 0.67), (0.60, 0.46, 0.40),
    (0.48, 0.55, 0.60), (0.62, 0.52, 0.30), (0.50, 0.54, 0.44), (0.80, 0.78, 0.72),
)  # fmt: skip
STONES: tuple[Color, ...] = ((0.42, 0.37, 0.28), (0.20, 0.175, 0.135), (0.52, 0.47, 0.37))
PAINTS: tuple[Color, ...] = (
    (0.02, 0.045, 0.18), (0.02, 0.10, 0.05), (0.33, 0.02, 0.025), (0.018, 0.018, 0.02),
    (0.62, 0.57, 0.42), (0.03, 0.20, 0.24), (0.50, 0.20, 0.02), (0.16, 0.02, 0.08),
    (0.70, 0.70, 0.68), (0.55, 0.42, 0.03),
)  # fmt: skip
SLATES: tuple[Color, ...] = (
    (0.075, 0.08, 0.09), (0.16, 0.075, 0.05), (0.12, 0.105, 0.09), (0.05, 0.05, 0.055),
)  # fmt: skip
CURTAINS: tuple[Color, ...] = ((0.5, 0.48, 0.42), (0.35, 0.30, 0.24), (0.60, 0.60, 0.58))


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
    hood: float  # how far a slab over each door or a shop's awning stands out, m; 0 for none
    balconies: tuple[int, ...]  # bays with balconies
    bay_windows: tuple[int, ...]  # bays with a bay window at the ground floor
    dormers: int  # in the front slope
    roof: str  # "flat", "gable" (ridge along the road), "front gable" or "hip"
    rise: float  # height of roof or parapet, m
    chimneys: int  # up to 2, one at either end
    tower: float  # least height of a tower at the left, m; 0 for none
    spire: float  # height of a spire on it, m
    wall: Finish
    ground_wall: Finish  # of the ground floor
    frame: Color  # around panes; sills, cornice, slabs
    accent: Color  # doors, signboard, gates, railings
    second: Color  # stripes of awnings
    roof_color: Color
    chimney: Color
    curtain: Color
    seed: int


def sample_building(rng: np.random.Generator, kind: str) -> BuildingParams:
    """Draw a building of one of ``KINDS``."""

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def one_of(colors: tuple[Color, ...], spread: float = 0.3) -> Color:
        return vary(rng, colors[rng.integers(len(colors))], spread)

    brick, paint, stone = one_of(BRICKS), one_of(PAINTS), one_of(STONES)
    bricks, plaster = (brick, "brick"), (one_of(RENDERS, 0.15), "plaster")
    stones = (stone, "concrete")
    concrete = (vary(rng, (0.31, 0.30, 0.28), 0.35), "concrete")
    either = (bricks, plaster)[rng.integers(2)]
    hooded, flat_topped = rng.random() < 0.4, rng.random() < 0.5
    white = vary(rng, (0.72, 0.72, 0.70), 0.08)
    dark = vary(rng, (0.03, 0.032, 0.035), 0.3)
    terrace = BuildingParams(
        width=between(9, 12), depth=between(8, 10), storeys=int(rng.integers(1, 3)),
        ground=between(2.8, 3.2), storey=between(2.7, 3.0), bays=4, window=(0.44, 0.60),
        panes=(2, 2), trim=("sills", "lintels", "pipe", "dish", "number"), head="flat",
        side_windows=1, ground_floor="doors", doors=((0, 3), (1, 2))[rng.integers(2)],
        hood=0.45 if hooded else 0.0, balconies=(), bay_windows=(), dormers=0, roof="gable",
        rise=between(2, 3), chimneys=2, tower=0.0, spire=0.0, wall=bricks, ground_wall=bricks,
        frame=white, accent=paint, second=one_of(RENDERS), roof_color=one_of(SLATES),
        chimney=brick, curtain=one_of(CURTAINS), seed=int(rng.integers(2**31)),
    )  # fmt: skip
    match kind:
        case "terrace":
            return terrace
        case "bay terrace":
            return terrace._replace(
                doors=(1, 2), bay_windows=(0, 3), storeys=int(rng.integers(1, 3)), chimneys=2,
                dormers=int(rng.integers(0, 3)), head=("flat", "round")[rng.integers(2)],
                ground_wall=either, trim=("sills", "strings", "lintels", "number"),
            )  # fmt: skip
        case "shop" | "parade":
            tall = int(rng.integers(1, 4))
            return terrace._replace(
                storeys=tall, ground=between(3.4, 4), bays=int(rng.integers(3, 6)),
                ground_floor="shop", ground_wall=(paint, "paint"),
                wall=plaster if kind == "shop" else bricks,
                roof="flat" if flat_topped else "gable", trim=("sills", "lintels", "sign", "cornice"),
                rise=between(0.6, 1) if flat_topped else between(1.8, 2.8),
                hood=0.6 if hooded else 0.0, chimneys=int(rng.integers(0, 3)),
                dormers=0 if flat_topped else int(rng.integers(0, 3)), second=white,
            )  # fmt: skip
        case "office":
            return terrace._replace(
                width=between(10, 13.5), depth=11.0, storeys=int(rng.integers(2, 6)), ground=3.6,
                storey=between(3.1, 3.5), bays=int(rng.integers(4, 7)),
                window=(between(0.72, 0.9), between(0.45, 0.6)), panes=(2, 1), trim=("plant",),
                side_windows=2, ground_floor="windows", hood=0.0, roof="flat", rise=1.0, chimneys=0,
                wall=(concrete, bricks, stones)[rng.integers(3)], ground_wall=(dark, "paint"),
                frame=(dark, white)[rng.integers(2)],
            )  # fmt: skip
        case "apartments":
            return terrace._replace(
                width=between(10, 13), depth=11.0, storeys=int(rng.integers(2, 5)), ground=3.0,
                storey=2.9, window=(0.5, 0.6), panes=(2, 1), trim=("dish", "number"),
                side_windows=2, doors=(2,), hood=0.5, balconies=((1, 2), (0, 3))[rng.integers(2)],
                roof="flat" if flat_topped else "hip", rise=0.9 if flat_topped else between(2, 3),
                chimneys=0, wall=either, ground_wall=plaster, accent=dark,
                frame=(dark, white)[rng.integers(2)],
            )  # fmt: skip
        case "detached":
            return terrace._replace(
                width=between(8.2, 9.5), storeys=1, bays=3, window=(0.55, 0.5), panes=(3, 2),
                side_windows=2, doors=(1,), hood=0.55, rise=between(2.4, 3.4), chimneys=1,
                roof=("hip", "front gable")[rng.integers(2)], wall=plaster, bay_windows=(0,),
                ground_wall=either, roof_color=vary(rng, (0.20, 0.08, 0.05), 0.25),
            )  # fmt: skip
        case "warehouse":
            return terrace._replace(
                width=between(11, 14), depth=12.0, storeys=1, ground=4.0, storey=between(1.8, 2.6),
                window=(0.7, 0.42), panes=(2, 1), trim=("ribs",), ground_floor="gates",
                roof="front gable", rise=between(1, 1.8), chimneys=0, frame=concrete[0],
                wall=(vary(rng, (0.24, 0.27, 0.29), 0.5), "metal"),
            )  # fmt: skip
        case "townhouse":
            return terrace._replace(
                width=between(8.5, 10.5), storeys=int(rng.integers(2, 5)), storey=between(3, 3.5),
                window=(0.42, 0.66), panes=(2, 2), doors=(3,), hood=0.0, roof="flat", rise=0.8,
                wall=plaster, ground_wall=(one_of(RENDERS), "plaster"),
                trim=("sills", "lintels", "strings", "cornice", "number"),
            )  # fmt: skip
        case "hall":
            tower = between(12, 16)
            return terrace._replace(
                width=between(9, 11.5), depth=12.0, storeys=1, ground=between(3.4, 4),
                storey=between(4.5, 6), bays=3, window=(0.34, 0.72), panes=(2, 3), side_windows=3,
                doors=(1,), hood=0.0, roof="front gable", rise=between(3.5, 5), chimneys=0,
                head="pointed", tower=tower, spire=between(5, 8) if hooded else 0.0,
                trim=("strings",), frame=dark, wall=stones, ground_wall=stones,
            )  # fmt: skip
        case "pub":
            return terrace._replace(
                width=between(9, 12), storeys=int(rng.integers(1, 3)), bays=4, doors=(1,),
                wall=plaster, ground_wall=(paint, "paint"), hood=0.5, panes=(3, 3),
                trim=("sills", "sign", "board", "pipe"), dormers=int(rng.integers(0, 3)),
            )  # fmt: skip
        case "curtain wall":
            return terrace._replace(
                width=between(10, 14), depth=12.0, storeys=int(rng.integers(4, 7)), ground=4.0,
                storey=between(2.9, 3.1), bays=int(rng.integers(6, 10)), window=(0.93, 0.74),
                panes=(1, 1), trim=("mullions", "plant"), ground_floor="windows", roof="flat",
                rise=0.7, chimneys=0, hood=0.0, side_windows=3,
                wall=(vary(rng, ((0.03, 0.05, 0.07), (0.25, 0.35, 0.38), (0.08, 0.09, 0.10))[
                    rng.integers(3)], 0.3), "glass"),
                ground_wall=(dark, "paint"), frame=(dark, white)[rng.integers(2)],
            )  # fmt: skip
        case "chain store":
            return terrace._replace(
                width=between(11, 14), depth=11.0, storeys=int(rng.integers(1, 4)), ground=4.2,
                storey=between(3.2, 3.8), bays=5, window=(0.72, 0.78), panes=(2, 3),
                trim=("cornice", "pilasters", "sign"), ground_floor="shop", hood=0.0, roof="flat",
                rise=1.1, chimneys=0, wall=(stones, plaster, concrete)[rng.integers(3)],
                ground_wall=(dark, "paint"), frame=dark,
            )  # fmt: skip
        case "georgian":
            return terrace._replace(
                width=between(9.5, 12.5), storeys=2, storey=between(3.0, 3.4), bays=5, doors=(2,),
                window=(0.46, 0.64), panes=(3, 4), hood=0.6, roof="hip", rise=between(1.6, 2.4),
                trim=("sills", "lintels", "quoins", "strings", "cornice"), frame=white,
                dormers=int(rng.integers(0, 4)),
            )  # fmt: skip
        case "college":
            return terrace._replace(
                width=between(11, 14), storeys=int(rng.integers(1, 3)), ground=3.8,
                storey=between(3.4, 4.0), bays=5, window=(0.42, 0.62), panes=(2, 2), doors=(2,),
                head="pointed", hood=0.0, roof="flat", rise=0.9, chimneys=2, wall=stones,
                ground_wall=stones, frame=one_of(STONES), trim=("strings", "battlements"),
                tower=between(11, 15) if hooded else 0.0, chimney=stone,
            )  # fmt: skip
        case "cottage":
            return terrace._replace(
                width=between(8.2, 10), storeys=1, ground=2.3, storey=1.5, bays=3, doors=(1,),
                window=(0.44, 0.68), panes=(3, 2), dormers=2, rise=between(2.6, 3.6),
                wall=(white, "plaster"), ground_wall=(white, "plaster"), frame=dark, side_windows=1,
                trim=("sills", "pipe"), chimneys=1,
            )  # fmt: skip
        case "corner":
            return terrace._replace(
                width=between(10, 12), storeys=int(rng.integers(2, 4)), ground=3.6,
                storey=between(2.9, 3.3), ground_floor="shop", ground_wall=(paint, "paint"),
                trim=("turret", "sills", "lintels", "strings"), dormers=2, bays=4, second=white,
                hood=0.6 if hooded else 0.0, wall=either,
            )  # fmt: skip
        case "concrete block":
            return terrace._replace(
                width=between(10, 14), depth=11.0, storeys=int(rng.integers(3, 6)), ground=3.0,
                storey=2.75, bays=6, window=(0.7, 0.5), panes=(2, 1), doors=(2,), hood=0.9,
                trim=("strings", "plant", "dish"), balconies=((0, 5), (1, 4))[rng.integers(2)],
                roof="flat", rise=0.9, chimneys=0, wall=concrete, ground_wall=bricks,
                side_windows=2, accent=one_of(PAINTS),
            )  # fmt: skip
        case "car park":
            return terrace._replace(
                width=between(12, 14.5), depth=12.0, storeys=int(rng.integers(2, 5)), ground=3.2,
                storey=2.9, bays=3, window=(0.93, 0.58), ground_floor="decks", trim=("mullions",),
                roof="flat", rise=0.9, chimneys=0, hood=0.0, wall=concrete, ground_wall=concrete,
                frame=dark, side_windows=0, tower=between(13, 17) if hooded else 0.0,
            )  # fmt: skip
        case "timbered":
            return terrace._replace(
                width=between(8.5, 10.5), storeys=int(rng.integers(1, 3)), bays=3, panes=(3, 3),
                window=(0.46, 0.5), doors=(1,), roof=("front gable", "gable")[rng.integers(2)],
                rise=between(2.6, 3.8), wall=(vary(rng, (0.74, 0.70, 0.58), 0.12), "plaster"),
                ground_wall=either, trim=("timbers", "sign"), frame=dark,
                accent=(0.05, 0.035, 0.025), roof_color=vary(rng, (0.17, 0.08, 0.05), 0.25),
            )  # fmt: skip
        case "mill":
            return terrace._replace(
                width=between(11, 14), depth=12.0, storeys=int(rng.integers(3, 5)), ground=3.6,
                storey=between(3.2, 3.6), bays=5, window=(0.5, 0.64), panes=(3, 4), head="round",
                ground_floor="gates", trim=("sills", "strings", "pipe"), hood=0.0,
                roof=("front gable", "gable")[rng.integers(2)], chimneys=0, frame=dark,
                wall=(one_of((BRICKS[1], BRICKS[3], BRICKS[5])), "brick"), ground_wall=bricks,
            )  # fmt: skip
        case "bank":
            return terrace._replace(
                width=between(9.5, 12.5), storeys=int(rng.integers(1, 3)), ground=4.4,
                storey=between(3.6, 4.2), bays=5, window=(0.42, 0.7), panes=(2, 3), doors=(2,),
                head="round", hood=0.0, roof="flat", rise=1.3, chimneys=0, wall=stones,
                ground_wall=stones, frame=one_of(STONES, 0.1),
                trim=("pilasters", "cornice", "strings", "board", "sills"), accent=dark,
            )  # fmt: skip
        case "modern terrace":
            return terrace._replace(
                width=between(9, 11.5), storeys=2, bays=4, window=(0.62, 0.72), panes=(1, 1),
                doors=(0, 2), hood=0.5, roof="front gable" if hooded else "gable", chimneys=0,
                wall=(vary(rng, ((0.72, 0.72, 0.70), (0.20, 0.13, 0.08))[rng.integers(2)], 0.15),
                      ("plaster", "wood")[rng.integers(2)]),
                ground_wall=bricks, frame=dark, trim=("number",), balconies=(1,), accent=dark,
            )  # fmt: skip
        case "white villa":
            return terrace._replace(
                width=between(8.5, 11), storeys=int(rng.integers(1, 3)), bays=3, doors=(1,),
                window=(0.42, 0.62), panes=(2, 2), head=("flat", "round")[rng.integers(2)],
                bay_windows=(0, 2), roof="hip", rise=between(1.8, 2.6), hood=0.6,
                wall=(white, "plaster"), ground_wall=(white, "plaster"),
                trim=("sills", "strings", "cornice", "quoins"), frame=(dark, white)[rng.integers(2)],
            )  # fmt: skip
    raise KeyError(kind)
