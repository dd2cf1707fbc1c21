"""Cars, each a curved shell with windows, fittings and four wheels, and auto-rickshaws."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from scene.assets.family import ROAD, Family, Size
from scene.assets.parts.bodywork import ARCH_GAP, Body, Paint, axles, half_width, shell, underside
from scene.assets.parts.draw import Rule, maybe, near, perhaps, resolve
from scene.assets.parts.fittings import Fittings, fittings
from scene.assets.parts.glazing import Glazing, glazing, sample_glazing
from scene.assets.parts.palette import (
    BLACK,
    BLACK_PAINT,
    CHROME,
    DUST,
    GLASS,
    OFF_WHITE,
    STEEL,
    TRIM,
    VAN_WHITE,
    blend,
    car_paint,
    darker,
    pick,
)
from scene.assets.parts.rickshaw import Rickshaw, rickshaw, sample_rickshaw
from scene.assets.parts.van import VanSides, van_sides
from scene.assets.parts.wheel import STYLES, Wheel, wheels
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, merge, vary


class CarParams(NamedTuple):
    """One car: shape, paint, fittings, wheels and windows."""

    body: Body
    paint: Paint
    fittings: Fittings
    wheel: Wheel
    glazing: Glazing
    van: VanSides | None = None


def _common_paint(rng: np.random.Generator, value: Any) -> Color:
    return car_paint(rng)


class _Kind(NamedTuple):
    """A body style; metres, and shares of the length measured from the nose."""

    size: tuple[float, float, float]  # length, width, height
    wheelbase: float
    front: float  # m from the nose to the front axle
    radius: float  # of the wheels
    sill: float
    hood: tuple[float, float]  # height of the bonnet at nose and windscreen
    belt: float
    deck: float
    screens: tuple[float, float, float, float]  # cowl, top of it, top of the rear window, its foot
    glass: tuple[float, float]  # side windows
    pillars: tuple[float, ...]
    doors: tuple[float, ...]
    tumblehome: float = 0.22
    rails: float = 0.0  # probability of roof rails
    plastic: float = 0.25  # probability of bumpers of bare plastic
    nose: float = 0.24
    clad: bool = False  # sills may be of bare plastic
    dark_glass: bool = False  # of the rear windows
    high_lamps: bool = False  # tail lamps sit high
    plain_wheels: bool = False  # mostly caps or bare steel instead of spokes
    taxi: Any = False  # a bool, or a rule that draws it
    two_tones: bool = False  # the roof may have another colour
    van: bool = False  # closed behind the cab
    sealed: Any = False  # rear doors may have no windows; a bool or a rule
    soft_top: bool = False
    spare: Any = False  # a wheel hangs on the tail; a bool or a rule
    bed: tuple[float, float] | None = None  # shares of the length: ends of a pickup's load bed
    paint: Rule = _common_paint


_VAN_PAINTS: tuple[Color, ...] = (
    VAN_WHITE, VAN_WHITE, VAN_WHITE, (0.35, 0.015, 0.018), CHROME,
    (0.02, 0.05, 0.16), (0.50, 0.32, 0.02), (0.03, 0.12, 0.06), (0.08, 0.085, 0.09),
)  # fmt: skip
_OLD_PAINTS: tuple[Color, ...] = (
    (0.30, 0.34, 0.27), (0.45, 0.40, 0.28), (0.15, 0.27, 0.36), (0.25, 0.02, 0.02), (0.02, 0.06, 0.04),
)  # fmt: skip
_COMPANY_PAINT = perhaps(0.8, near(0.15, *_VAN_PAINTS), _common_paint)


_KINDS: dict[str, _Kind] = {
    "hatchback": _Kind(
        (4.15, 1.77, 1.47), 2.58, 0.84, 0.315, 0.18, (0.76, 0.95), 0.94, 0.96,
        (0.25, 0.42, 0.85, 0.985), (0.27, 0.86), (0.52, 0.76), (0.26, 0.52, 0.735),
    ),
    "saloon": _Kind(
        (4.60, 1.80, 1.44), 2.70, 0.88, 0.315, 0.17, (0.74, 0.95), 0.93, 0.99,
        (0.27, 0.43, 0.70, 0.83), (0.29, 0.785), (0.515, 0.715), (0.27, 0.515, 0.715),
        taxi=maybe(0.08),
    ),
    "supermini": _Kind(
        (3.85, 1.68, 1.46), 2.47, 0.78, 0.295, 0.18, (0.76, 0.96), 0.93, 0.95,
        (0.22, 0.41, 0.86, 0.985), (0.24, 0.87), (0.51, 0.76), (0.25, 0.51, 0.735),
        two_tones=True,
    ),
    "estate": _Kind(
        (4.70, 1.80, 1.48), 2.72, 0.88, 0.32, 0.17, (0.74, 0.95), 0.94, 0.97,
        (0.26, 0.41, 0.89, 0.985), (0.28, 0.93), (0.50, 0.69), (0.265, 0.50, 0.69), rails=0.65,
        high_lamps=True, taxi=maybe(0.08),
    ),
    "crossover": _Kind(
        (4.40, 1.84, 1.64), 2.65, 0.86, 0.35, 0.23, (0.90, 1.08), 1.06, 1.08,
        (0.24, 0.40, 0.87, 0.985), (0.26, 0.89), (0.51, 0.735), (0.26, 0.51, 0.73),
        tumblehome=0.19, rails=0.7, plastic=0.6,
        clad=True, high_lamps=True, two_tones=True,
    ),
    "city car": _Kind(
        (3.50, 1.62, 1.50), 2.33, 0.66, 0.275, 0.17, (0.80, 0.98), 0.95, 0.98,
        (0.18, 0.37, 0.90, 0.99), (0.20, 0.90), (0.50, 0.77), (0.22, 0.50, 0.755), plastic=0.5,
        plain_wheels=True, two_tones=True,
    ),
    "people carrier": _Kind(
        (4.60, 1.83, 1.70), 2.80, 0.90, 0.325, 0.18, (0.86, 1.08), 1.00, 1.04,
        (0.19, 0.38, 0.91, 0.988), (0.20, 0.93), (0.44, 0.66, 0.80), (0.235, 0.45, 0.665),
        rails=0.4, plastic=0.35,
        high_lamps=True, taxi=maybe(0.08),
    ),
    "three-door": _Kind(
        (3.95, 1.73, 1.40), 2.48, 0.82, 0.315, 0.15, (0.72, 0.92), 0.90, 0.95,
        (0.26, 0.44, 0.80, 0.98), (0.28, 0.84), (0.585,), (0.265, 0.59), tumblehome=0.24,
    ),
    "executive": _Kind(
        (4.92, 1.86, 1.46), 2.88, 0.90, 0.335, 0.16, (0.76, 0.97), 0.96, 1.02,
        (0.29, 0.45, 0.70, 0.83), (0.31, 0.79), (0.53, 0.72), (0.285, 0.53, 0.72), plastic=0.0,
        dark_glass=True,
    ),
    "off-roader": _Kind(
        (4.45, 1.86, 1.86), 2.65, 0.78, 0.385, 0.30, (1.06, 1.17), 1.18, 1.18,
        (0.28, 0.36, 0.955, 0.985), (0.30, 0.94), (0.53, 0.74), (0.28, 0.53, 0.735),
        tumblehome=0.12, rails=0.6, plastic=0.75, nose=0.12,
        clad=True, high_lamps=True, spare=maybe(0.6),
    ),
    "panel van": _Kind(
        (5.30, 1.98, 2.28), 3.25, 0.98, 0.34, 0.24, (0.98, 1.22), 1.20, 1.24,
        (0.15, 0.29, 0.972, 0.99), (0.165, 0.36), (), (0.19, 0.375, 0.56),
        tumblehome=0.11, plastic=0.9, nose=0.20,
        clad=True, dark_glass=True, high_lamps=True, plain_wheels=True, van=True, sealed=maybe(0.5),
        paint=_COMPANY_PAINT,
    ),
    "coupe": _Kind(
        (4.40, 1.80, 1.32), 2.58, 0.86, 0.335, 0.14, (0.68, 0.88), 0.87, 0.94,
        (0.32, 0.49, 0.67, 0.88), (0.34, 0.77), (0.64,), (0.32, 0.625), tumblehome=0.26, plastic=0.0,
    ),
    "small van": _Kind(
        (4.25, 1.78, 1.82), 2.70, 0.84, 0.31, 0.19, (0.82, 1.03), 1.00, 1.05,
        (0.21, 0.38, 0.968, 0.99), (0.23, 0.46), (), (0.24, 0.475, 0.64),
        tumblehome=0.13, plastic=0.85,
        clad=True, dark_glass=True, high_lamps=True, plain_wheels=True, van=True, sealed=True,
        paint=_COMPANY_PAINT,
    ),
    "black cab": _Kind(
        (4.58, 1.78, 1.78), 2.88, 0.84, 0.33, 0.22, (0.86, 1.02), 1.02, 1.04,
        (0.29, 0.39, 0.84, 0.955), (0.31, 0.90), (0.50, 0.725), (0.29, 0.50, 0.725),
        tumblehome=0.17, plastic=0.5, nose=0.16,
        high_lamps=True, plain_wheels=True, taxi=True,
        paint=perhaps(0.7, BLACK_PAINT, _common_paint),
    ),
    "convertible": _Kind(
        (4.05, 1.74, 1.36), 2.48, 0.84, 0.315, 0.15, (0.70, 0.90), 0.89, 0.96,
        (0.29, 0.45, 0.64, 0.77), (0.31, 0.70), (0.60,), (0.30, 0.615), plastic=0.0,
        soft_top=True,
    ),
    "pickup": _Kind(
        (5.15, 1.85, 1.76), 3.05, 0.92, 0.375, 0.29, (1.00, 1.14), 1.13, 1.10,
        (0.25, 0.36, 0.58, 0.625), (0.265, 0.60), (0.44,), (0.26, 0.44, 0.61),
        tumblehome=0.16, plastic=0.5, nose=0.16,
        clad=True, bed=(0.655, 0.955),
    ),
    "old-timer": _Kind(
        (3.85, 1.58, 1.45), 2.35, 0.72, 0.30, 0.20, (0.74, 0.94), 0.92, 0.86,
        (0.30, 0.39, 0.70, 0.86), (0.32, 0.79), (0.54,), (0.31, 0.56), tumblehome=0.24,
        plastic=0.0, nose=0.34,
        plain_wheels=True, two_tones=True, paint=near(0.15, *_OLD_PAINTS),
    ),
}  # fmt: skip
_TUK_TUK = "tuk-tuk"
_FREQUENT = (
    *("hatchback",) * 4, *("supermini",) * 3, *("saloon",) * 3, *("crossover",) * 3,
    *("estate",) * 2, "people carrier",
)  # fmt: skip
"""The most common styles on roads, repeated by how much more often they occur than the others."""


def sample_car(rng: np.random.Generator, kind: str) -> CarParams | Rickshaw:
    """Draw a car of one body style: proportions, paint, wheels, lamps and fittings."""
    if kind == _TUK_TUK:
        return sample_rickshaw(rng)
    model = _KINDS[kind]
    body = _sample_body(rng, model)
    color = resolve(rng, model.paint)
    paint = _sample_paint(rng, model, color)
    return CarParams(
        body,
        paint,
        _sample_fittings(rng, model, color),
        _sample_wheel(rng, model, body),
        sample_glazing(rng, (0.15,) if model.dark_glass else (0.15, 0.6, 0.9), 0.4),
        _sample_van(rng, paint) if model.van else None,
    )


def _sample_body(rng: np.random.Generator, model: _Kind) -> Body:
    length_factor, width_factor, height_factor = rng.uniform(
        [0.94, 0.965, 0.95], [1.06, 1.035, 1.05]
    )
    face, waist, slope, foot = rng.uniform(-1, 1, 4)
    cowl, roof_front, roof_rear, tail = model.screens
    boot = tail < 0.95
    length, height = model.size[0] * length_factor, model.size[2] * height_factor
    radius = model.radius * rng.uniform(0.95, 1.07)
    front = model.front * (0.3 + 0.7 * length_factor) + 0.02 * face
    nose = min(model.nose * rng.uniform(0.8, 1.25), front - 1.03 * (radius + ARCH_GAP) - 0.04)
    belt = model.belt * (0.5 + 0.5 * height_factor) * (1 + 0.03 * waist)
    return Body(
        length=length,
        width=model.size[1] * width_factor,
        height=height,
        wheelbase=model.wheelbase * (0.3 + 0.7 * length_factor),
        front=front,
        wheel_radius=radius,
        sill=model.sill * rng.uniform(0.9, 1.12),
        hood=min(model.hood[0] * (1 + 0.06 * face), belt - 0.06),
        cowl_height=model.hood[1] + belt - model.belt,
        belt=belt,
        deck=model.deck + belt - model.belt + (0.03 * slope if boot else 0),
        cowl=cowl + 0.015 * foot,
        roof_front=roof_front + 0.015 * foot,
        roof_rear=roof_rear + (0.02 if boot else 0.03) * min(slope, 0.3 if tail > 0.95 else 1),
        tail=tail,
        glass=(model.glass[0] + 0.015 * foot, model.glass[1]),
        pillars=model.pillars,
        tumblehome=model.tumblehome * rng.uniform(0.85, 1.12),
        nose=nose,
        stern=rng.uniform(0.08, 0.15) * (0.6 if model.van else 1),
        rake=rng.uniform(0.03, 0.13),
        crown=rng.uniform(0.045, 0.075),
        bed=model.bed,
    )


def _sample_paint(rng: np.random.Generator, model: _Kind, color: Color) -> Paint:
    glass = vary(rng, GLASS, 0.5)
    tint = rng.random()
    k = float(rng.uniform(0.0, 0.7))
    lower, rows = blend(color, DUST, k), 1
    if model.clad and rng.random() < 0.6:
        lower, rows = TRIM if rng.random() < 0.7 else (0.2, 0.2, 0.2), int(rng.integers(1, 3))
    roof, cloth = color, "paint"
    if model.soft_top:
        canvas = (BLACK, (0.10, 0.07, 0.04), (0.02, 0.03, 0.08), (0.08, 0.01, 0.01))
        roof, cloth = pick(rng, canvas), "cloth"
    elif model.two_tones and rng.random() < 0.2:
        roof = VAN_WHITE if max(color) < 0.4 else BLACK
    side = darker(glass, 0.5 + 1.2 * float(tint))
    windows = (True, not (resolve(rng, model.sealed) and rng.random() < 0.3))
    return Paint(color, lower, roof, side, glass, windows, rows, cloth, bool(rng.random() < 0.7))


def _sample_fittings(rng: np.random.Generator, model: _Kind, color: Color) -> Fittings:
    plastic = rng.random() < model.plastic
    inner, lamp_low = rng.uniform(0.42, 0.7), rng.uniform(0.58, 0.7)
    rear_low = rng.uniform(0.55, 0.62)
    taxi = resolve(rng, model.taxi)
    crest = rng.uniform(0.84, 0.93)
    hatch = model.screens[3] > 0.95 and not model.van
    return Fittings(
        lamp=(inner, lamp_low, min(lamp_low + rng.uniform(0.18, 0.3), 0.95)),
        wrap=rng.uniform(0.005, 0.06),
        grille=(rng.uniform(0.4, 0.96) * inner, crest - rng.uniform(0.12, 0.3), crest),
        slats=int(rng.integers(0, 4)),
        rear_lamp=(
            rng.uniform(0.78, 0.86) if model.high_lamps else rng.uniform(0.5, 0.75),
            rear_low,
            rng.uniform(0.9, 1.0),
        ),
        plate=bool(rng.random() < 0.6),
        bumper=TRIM if plastic else None,
        strip=TRIM if plastic and rng.random() < 0.7 else color if rng.random() < 0.3 else None,
        handles=TRIM if plastic else color if rng.random() < 0.7 else CHROME,
        mirrors=TRIM if plastic else color,
        rails=(TRIM if rng.random() < 0.5 else CHROME) if rng.random() < model.rails else None,
        spoiler=color if hatch and rng.random() < 0.4 else None,
        box=pick(rng, (BLACK, STEEL)) if rng.random() < (0.12 if model.rails else 0.0) else None,
        sign=(0.6, 0.38, 0.04) if taxi else None,
        spare=resolve(rng, model.spare),
        aerial=bool(rng.random() < 0.5),
        doors=model.doors,
        fog=bool(rng.random() < 0.6),
    )


def _sample_wheel(rng: np.random.Generator, model: _Kind, body: Body) -> Wheel:
    is_plain = rng.random() < (0.75 if model.plain_wheels else 0.25)
    style = STYLES[rng.integers(2, 4) if is_plain else rng.integers(0, 2)]
    is_dark = rng.random() < 0.2
    return Wheel(
        body.wheel_radius,
        rng.uniform(0.18, 0.23),
        style,
        int(rng.integers(5, 11)) if style != "steel" else 8,
        rng.uniform(0.60, 0.74),
        vary(rng, (0.05, 0.05, 0.05) if is_dark or style == "steel" else STEEL, 0.35),
    )


def _sample_van(rng: np.random.Generator, paint: Paint) -> VanSides:
    letters = pick(rng, ((0.3, 0.02, 0.02), (0.02, 0.06, 0.25), (0.02, 0.15, 0.05), BLACK))
    if max(paint.body) < 0.4:
        letters = pick(rng, (OFF_WHITE, (0.55, 0.4, 0.03)))
    has_name = rng.random() < 0.6
    return VanSides(
        paint.body, letters if has_name else None, int(rng.integers(2**31)), not paint.windows[1]
    )


def car(p: CarParams | Rickshaw) -> Asset:
    """Build the car, nose towards +x."""
    if isinstance(p, Rickshaw):
        return rickshaw(p)
    b = p.body
    track = float(half_width(b, np.array([0.5]))[0]) - 0.025
    return merge(
        shell(b, p.paint),
        underside(b),
        *fittings(b, p.fittings),
        *glazing(b, p.glazing, p.paint.windows),
        *([] if p.van is None else van_sides(b, p.van)),
        wheels(p.wheel, axles(b), track),
    )


FAMILY = Family(
    "car", TrainId.CAR, (*_KINDS, _TUK_TUK), sample_car, car,
    classes=(("pickup", TrainId.TRUCK),),  # Cityscapes: the loading area is apart from the cab
    count=195, size=Size((2.2, 7), (0.9, 3)), tone=0.95, line=("car", 0.9),
    facing="lane", stage=ROAD, redrawn=(175,), frequent=_FREQUENT,
)  # fmt: skip
