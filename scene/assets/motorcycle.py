"""Motorcycles with tank, engine, seat and fork, and scooters with a leg shield."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.family import ROAD, Family, Size
from scene.assets.parts.draw import integer, maybe, near, perhaps, sample_fields, times
from scene.assets.parts.palette import (
    AMBER,
    BLACK,
    BLACK_PAINT,
    HEADLAMP,
    PLATE,
    STEEL,
    TAILLAMP,
    TRIM,
    WHITE,
    darker,
)
from scene.assets.parts.skin import cuboid, pair, rounded_body
from scene.assets.parts.vehicle import card, mudguard, rod
from scene.assets.parts.wheel import Wheel, wheel
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Parts, Point, merge, translate
from scene.mesh.solids import disc, ellipsoid, polygon, tube

SADDLE: Point = (-0.18, 0.0, 0.80)
"""Top of the seat where the rider sits, m."""
BAR: Point = (0.36, 0.33, 1.02)
"""Left grip, m; the right one is its mirror image."""
FOOT: Point = (-0.02, 0.20, 0.34)
"""Left foot rest, m."""


class MotorcycleParams(NamedTuple):
    """One motorcycle; metres."""

    wheel_radius: float
    tyre: float  # width
    wheelbase: float
    scooter: bool
    fairing: float  # size: 0 none .. 1 down to the engine
    screen: float  # height of the windscreen above the bar, 0 for none
    cases: bool  # panniers and a top case
    tail: float  # m that the tail rises above the seat
    color: Color = BLACK
    seat_color: Color = BLACK
    engine_color: Color = STEEL
    second_color: Color = TRIM  # of fairing stripes, cases and side panels
    spokes: int = 5
    rim: Color = STEEL
    pipes: int = 1  # exhausts
    high_pipe: bool = False
    beak: bool = False  # a high front mudguard
    sissy: bool = False  # a backrest behind the seat
    front_box: bool = False


_KINDS: dict[str, MotorcycleParams] = {
    "naked": MotorcycleParams(0.315, 0.14, 1.42, False, 0.0, 0.0, False, 0.06),
    "scooter": MotorcycleParams(0.245, 0.12, 1.30, True, 0.0, 0.12, False, 0.02),
    "tourer": MotorcycleParams(0.320, 0.15, 1.50, False, 0.6, 0.34, True, 0.04),
    "sports": MotorcycleParams(0.310, 0.16, 1.40, False, 1.0, 0.12, False, 0.18),
    "delivery scooter": MotorcycleParams(0.240, 0.12, 1.30, True, 0.0, 0.30, True, 0.02),
    "cruiser": MotorcycleParams(0.325, 0.17, 1.58, False, 0.0, 0.0, False, 0.02, pipes=2, sissy=True),
    "adventure": MotorcycleParams(0.335, 0.13, 1.50, False, 0.35, 0.24, True, 0.08, high_pipe=True,
                                  beak=True),
    "cafe racer": MotorcycleParams(0.320, 0.13, 1.40, False, 0.2, 0.08, False, 0.12, spokes=12),
    "moped": MotorcycleParams(0.285, 0.09, 1.22, True, 0.0, 0.0, False, 0.02, spokes=12),
}  # fmt: skip

_PAINTS: tuple[Color, ...] = (
    BLACK_PAINT, (0.07, 0.07, 0.075), (0.33, 0.018, 0.018), (0.025, 0.06, 0.24), (0.04, 0.16, 0.05),
    WHITE, (0.38, 0.39, 0.40), (0.45, 0.16, 0.015),
)  # fmt: skip


def sample_motorcycle(rng: np.random.Generator, kind: str) -> MotorcycleParams:
    """Draw a motorcycle of one body type: size within 5 %, paint, wheels, exhausts, luggage."""
    model = _KINDS[kind]
    return sample_fields(
        rng, model, wheel_radius=times(0.95, 1.05), tyre=times(0.9, 1.15), wheelbase=times(0.95, 1.05),
        fairing=times(0.8, 1.2), screen=times(0.6, 1.2) if model.screen else perhaps(0.25, 0.25, 0.0),
        cases=model.cases or (not model.fairing and maybe(0.25)), tail=times(0.6, 1.4),
        color=near(0.2, *_PAINTS), seat_color=near(0.15, BLACK, TRIM, (0.09, 0.045, 0.025)),
        engine_color=near(0.15, STEEL, (0.06, 0.06, 0.062), (0.15, 0.15, 0.15)),
        second_color=near(0.2, *_PAINTS), spokes=model.spokes if model.spokes > 8 else integer(3, 8),
        rim=near(0.15, STEEL, BLACK, (0.45, 0.30, 0.05), (0.5, 0.5, 0.5)),
        pipes=2 if model.pipes == 2 else perhaps(0.3, 2, 1), front_box=model.scooter and maybe(0.3),
    )  # fmt: skip


def motorcycle(p: MotorcycleParams) -> Asset:
    """Build the motorcycle, facing +x."""
    parts = [_wheel(p, x) for x in (-p.wheelbase / 2, p.wheelbase / 2)]
    body = _scooter(p) if p.scooter else _machine(p)
    return merge(*parts, *_front(p), *body, *_extras(p))


def _wheel(p: MotorcycleParams, x: float) -> Asset:
    """Build a round tyre on a spoked rim, with a brake disc on either side."""
    half = p.tyre / 2
    spec = Wheel(p.wheel_radius, half, "spokes", p.spokes, 0.7, p.rim)
    r = p.wheel_radius
    brake = disc((0, 0.02, r), 0.4 * r, (0.2, 0.2, 0.2), "metal", axis=(0, 1, 0))
    side = merge(wheel(spec, sides=16), brake)
    return translate(pair(translate(side, (0, half, 0))), (x, 0, 0))


def _front(p: MotorcycleParams) -> Parts:
    """Build fork, handlebar, mirrors, headlamp and mudguard."""
    hub, (x, y, z) = p.wheelbase / 2, BAR
    crown = (x + 0.06, z - 0.06)
    for side in (1, -1):
        foot = (hub, side * (p.tyre / 2 + 0.035), p.wheel_radius)
        yield rod(foot, (crown[0], side * 0.09, crown[1]), 0.028, STEEL)
        inner = (crown[0], side * 0.08, z - 0.02)
        yield rod(inner, (x - 0.04, side * (y + 0.05), z), 0.018, BLACK)
        glass = (x + 0.04, side * (y - 0.02), z + 0.17)
        yield rod((x + 0.02, side * (y - 0.1), z), glass, 0.01, BLACK)
        yield ellipsoid(glass, (0.02, 0.07, 0.05), TRIM)
        grip = (x - 0.1, side * (y + 0.07), z - 0.005), (x + 0.02, side * y, z + 0.005)
        yield rod(*grip, 0.024, BLACK)
        signal = (crown[0] + 0.06, side * 0.16, z - 0.12), (0.035, 0.035, 0.025)
        yield ellipsoid(*signal, AMBER, "paint", subdivisions=0)
    if not p.fairing:
        end = (crown[0] + 0.13, 0.0, crown[1] - 0.1)
        start = (crown[0], 0.0, end[2])
        yield tube(start, end, 0.06, p.color, "paint", end_radius=0.09, sides=12, caps=False)
        yield disc(end, 0.088, HEADLAMP, "lamp", axis=(1, 0, 0), sides=12)
        yield ellipsoid((start[0] - 0.02, 0, z + 0.03), (0.03, 0.07, 0.05), BLACK)
    centre = (hub, 0.0, p.wheel_radius)
    reach = p.wheel_radius + (0.12 if p.beak else 0.025)
    yield mudguard(centre, reach, p.tyre + 0.02, tuple(np.linspace(0.5, 2.5, 8)), p.color)


def _machine(p: MotorcycleParams) -> Parts:
    """Build tank, seat, tail, engine, frame and exhaust."""
    x, _, z = SADDLE
    rear, radius = -p.wheelbase / 2, p.wheel_radius
    tail = rear - 0.12
    tank = [(0.0, 0.11, z - 0.06, z + 0.06), (0.14, 0.15, z - 0.08, z + 0.17)]
    tank += [(0.30, 0.13, z - 0.04, z + 0.18), (0.40, 0.06, z + 0.02, z + 0.12)]
    seat = [(tail, 0.05, z + p.tail, z + p.tail + 0.06), (x - 0.2, 0.12, z - 0.07, z + p.tail)]
    seat += [(x, 0.13, z - 0.09, z), (0.02, 0.09, z - 0.09, z + 0.01)]
    yield rounded_body(tank, p.color, "paint")
    yield rounded_body(seat, p.seat_color, "plain")
    yield ellipsoid((0.02, 0, 0.37), (0.27, 0.16, 0.16), p.engine_color, "metal", subdivisions=2)
    yield tube((-0.05, -0.19, 0.36), (-0.05, 0.19, 0.36), 0.11, p.engine_color, "metal", sides=12)
    yield from _cylinders(p)
    yield from _exhaust(p)
    yield rod((0.38, 0, z + 0.02), (0.22, 0, 0.3), 0.04, BLACK)
    for y in (0.1, -0.1):
        yield rod((0.3, y, z - 0.02), (-0.2, y, 0.4), 0.022, BLACK)
        cover = [(-0.3, 1.4 * y, z - 0.1), (-0.08, 1.4 * y, z - 0.1), (-0.14, 1.4 * y, 0.5)]
        yield polygon(cover, p.second_color, "paint")
        yield rod((-0.15, y, 0.42), (rear, y, radius), 0.035, BLACK)
        yield rod((rear + 0.06, y, radius), (x - 0.12, y, z - 0.05), 0.022, STEEL)
    if p.fairing:
        yield _fairing(p)


def _cylinders(p: MotorcycleParams) -> Parts:
    """Build finned cylinders that lean forward: alternating dark and bright plates."""
    for k in range(7):
        x, z = 0.02 + 0.02 * k, 0.48 + 0.032 * k
        half_width = 0.115 if k % 2 else 0.09
        color = p.engine_color if k % 2 else darker(p.engine_color, 0.3)
        yield cuboid((x - 0.11, x + 0.11), half_width, (z, z + 0.032), color, "metal")


def _exhaust(p: MotorcycleParams) -> Parts:
    """Build header pipes and silencers, on the right or on both sides."""
    rear, low = -p.wheelbase / 2, 0.24
    lift = 0.3 if p.high_pipe else 0.0
    port, bend, below = (0.26, -0.08, 0.56), (0.32, -0.12, 0.36), (0.05, -0.17, low)
    neck, tip = (-0.25, -0.19, low + 0.02 + lift), (rear - 0.1, -0.21, low + 0.16 + lift)
    pipes = merge(
        tube(port, bend, 0.026, STEEL, "metal", sides=8),
        tube(bend, below, 0.026, STEEL, "metal", sides=8),
        tube(below, neck, 0.03, STEEL, "metal", sides=8),
        tube(neck, tip, 0.05, STEEL, "metal", end_radius=0.06, sides=12),
    )
    yield pipes if p.pipes == 1 else pair(pipes)


def _fairing(p: MotorcycleParams) -> Asset:
    """Build a painted shell around the headlamp and down to the engine's sides."""
    low = 1.02 - 0.35 - 0.35 * p.fairing
    stations = [(0.10, 0.20, low, 0.72), (0.34, 0.22, low + 0.05, 0.98)]
    stations += [(0.50, 0.18, low + 0.2, 1.0), (0.62, 0.07, 0.76, 0.92)]
    stripe = [(0.08, 0.215, low + 0.05), (0.4, 0.225, low + 0.3), (0.3, 0.225, low + 0.4)]
    return merge(
        rounded_body(stations, p.color, "paint"),
        disc((0.63, 0.0, 0.85), 0.085, HEADLAMP, "lamp", axis=(1, 0, 0), sides=12),
        pair(polygon(stripe, p.second_color, "paint")),
    )


def _scooter(p: MotorcycleParams) -> Parts:
    """Build leg shield, floor, and a rear body that hides the engine."""
    x, _, z = SADDLE
    rear, radius = -p.wheelbase / 2, p.wheel_radius
    body = [(rear - 0.22, 0.07, 0.55, 0.76), (rear, 0.17, 0.36, z - 0.06)]
    body += [(x - 0.05, 0.18, 0.26, z - 0.06), (x + 0.12, 0.14, 0.2, z - 0.08)]
    seat = [(rear - 0.1, 0.08, z - 0.04, z + p.tail), (x - 0.1, 0.14, z - 0.08, z)]
    seat += [(x + 0.2, 0.09, z - 0.08, z - 0.02)]
    pipe = (-0.3, -0.19, radius), (rear - 0.1, -0.21, radius + 0.06)
    shield = [(0.26, 0.24, 0.22, 0.5), (0.38, 0.19, 0.4, 0.95), (0.46, 0.08, 0.5, 1.0)]
    yield rounded_body(body, p.color, "paint")
    yield rounded_body(seat, p.seat_color, "plain")
    yield rounded_body(shield, p.color, "paint")
    yield cuboid((x + 0.05, 0.34), 0.2, (0.2, 0.28), TRIM)
    yield tube(*pipe, 0.06, STEEL, "metal", sides=10)
    yield from _scooter_details(p)


def _scooter_details(p: MotorcycleParams) -> Parts:
    """Build side panels, front indicators, and on some a box in front."""
    x = SADDLE[0]
    low, high = [(x - 0.3, 0.186, 0.42), (x + 0.05, 0.186, 0.36)], (x - 0.02, 0.19, 0.56)
    yield pair(polygon([*low, high, (x - 0.25, 0.186, 0.6)], p.second_color, "paint"))
    yield pair(ellipsoid((0.43, 0.13, 0.72), (0.04, 0.035, 0.05), AMBER, "paint", subdivisions=0))
    if p.front_box:
        yield cuboid((0.46, 0.66), 0.15, (0.76, 0.98), p.second_color, "plain")


def _extras(p: MotorcycleParams) -> Parts:
    """Build rear lamp, plate, windscreen, luggage and backrest."""
    back = -p.wheelbase / 2 - (0.24 if p.scooter else 0.16)
    z = SADDLE[2] - 0.08 + (0 if p.scooter else p.tail)
    yield card((back, 0.0, z + 0.035), 0.12, 0.07, TAILLAMP, "lamp")
    yield card((back - 0.02, 0.0, z - 0.14), 0.2, 0.16, PLATE)
    if p.screen:
        x, top = BAR[0] + 0.14, BAR[2] + p.screen
        half_width = 0.2 if p.screen > 0.2 else 0.14
        low = [(x, -half_width, BAR[2] - 0.08), (x, half_width, BAR[2] - 0.08)]
        screen = [*low, (x - 0.14, 0.7 * half_width, top), (x - 0.14, -0.7 * half_width, top)]
        yield polygon(screen, (0.12, 0.14, 0.15), "glass")
    if p.cases:
        yield from _cases(p)
    if p.sissy:
        x = -p.wheelbase / 2 + 0.08
        yield cuboid((x, x + 0.06), 0.12, (z + 0.1, z + 0.42), p.seat_color)


def _cases(p: MotorcycleParams) -> Parts:
    """Build a delivery box on a scooter, or panniers and a top case on a tourer."""
    rear, low = -p.wheelbase / 2, SADDLE[2] + 0.06
    along = (rear - 0.25, rear + 0.17)
    if p.scooter:
        yield cuboid(along, 0.2, (low, low + 0.42), p.second_color, "plain")
    else:
        yield cuboid(along, 0.17, (low, low + 0.28), TRIM)
        for y in (0.24, -0.24):
            yield cuboid((rear - 0.28, rear + 0.22), 0.1, (0.42, 0.76), p.color, "paint", at=y)


FAMILY = Family(
    "motorcycle", TrainId.MOTORCYCLE, tuple(_KINDS), sample_motorcycle, motorcycle,
    count=18, size=Size((1.2, 3.2), (0.7, 2.0)), tone=0.4, line=("bicycle", 0.3),
    facing="either", stage=ROAD._replace(azimuth=-55),
)  # fmt: skip
