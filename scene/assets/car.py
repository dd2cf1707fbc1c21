"""Cars: a lofted body with wheel arches, a glazed cabin that leans inwards, four wheels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, Point, block, extrude, loft, merge, polygon, vary
from scene.assets._palette import (
    BLACK,
    GLASS,
    HEADLAMP,
    PLATE,
    STEEL,
    TAILLAMP,
    TRIM,
    car_paint,
    darker,
)
from scene.assets._vehicle import axle, lamps, panel


class CarParams(NamedTuple):
    """One car; metres, and shares of the length measured from the nose."""

    length: float
    width: float
    height: float
    wheelbase: float
    wheel_radius: float
    sill: float  # m from the ground to the underside
    hood: float  # m, height of the bonnet at the nose
    belt: float  # m, height of the lower edge of the windows
    deck: float  # m, height of the body at the tail
    cowl: float  # share: foot of the windscreen
    roof_front: float  # share: top of the windscreen
    roof_rear: float  # share: top of the rear window
    tail: float  # share: foot of the rear window
    glass_end: float  # share: where the side windows end
    tumblehome: float  # roof width over belt width
    color: Color = (0.4, 0.4, 0.4)
    rim: Color = STEEL
    trim: bool = False  # dark bumpers and sills
    rails: bool = False  # on the roof


_MODELS: dict[str, CarParams] = {
    "hatchback": CarParams(
        4.05, 1.76, 1.47, 2.56, 0.315, 0.19, 0.72, 0.93, 0.98, 0.23, 0.42, 0.86, 0.985, 0.90, 0.80
    ),
    "saloon": CarParams(
        4.65, 1.82, 1.45, 2.76, 0.32, 0.18, 0.70, 0.92, 0.96, 0.26, 0.42, 0.70, 0.86, 0.80, 0.78
    ),
    "estate": CarParams(
        4.65, 1.82, 1.49, 2.74, 0.32, 0.18, 0.71, 0.93, 0.96, 0.25, 0.41, 0.90, 0.985, 0.94, 0.80
    ),
    "suv": CarParams(
        4.50, 1.86, 1.68, 2.67, 0.36, 0.25, 0.88, 1.08, 1.10, 0.23, 0.38, 0.90, 0.985, 0.92, 0.83
    ),
    "van": CarParams(
        4.95, 1.94, 1.95, 3.10, 0.33, 0.21, 0.84, 1.12, 1.10, 0.17, 0.30, 0.965, 0.99, 0.40, 0.88
    ),
    "coupe": CarParams(
        4.40, 1.82, 1.33, 2.60, 0.33, 0.16, 0.66, 0.87, 0.93, 0.31, 0.47, 0.67, 0.91, 0.78, 0.76
    ),
    "city car": CarParams(
        3.55, 1.64, 1.52, 2.38, 0.285, 0.18, 0.76, 0.95, 0.98, 0.19, 0.38, 0.89, 0.985, 0.90, 0.80
    ),
    "people carrier": CarParams(
        4.60, 1.84, 1.66, 2.80, 0.33, 0.19, 0.80, 1.00, 1.02, 0.17, 0.37, 0.92, 0.985, 0.94, 0.82
    ),
}  # fmt: skip
KINDS: tuple[str, ...] = tuple(_MODELS)
"""Body styles."""


def sample_car(rng: np.random.Generator, kind: str) -> CarParams:
    """Draw a car of one body style: size within 4 %, paint, wheels and trim."""
    model = _MODELS[kind]
    long, wide, tall = rng.uniform(0.96, 1.04, 3)
    return model._replace(
        length=model.length * long,
        wheelbase=model.wheelbase * long,
        width=model.width * wide,
        height=model.height * tall,
        hood=model.hood * rng.uniform(0.96, 1.04),
        color=car_paint(rng),
        rim=vary(rng, (0.06, 0.06, 0.06) if rng.random() < 0.2 else STEEL, 0.4),
        trim=bool(rng.random() < (0.7 if kind in ("suv", "van", "city car") else 0.25)),
        rails=bool(rng.random() < (0.6 if kind in ("suv", "estate") else 0.0)),
    )


def car(params: CarParams) -> Asset:
    """The car of ``params``, nose towards +x."""
    p = params
    axles = _axles(p)
    parts = [_body(p), *_cabin(p), *_ends(p)]
    parts += [axle(x, p.width / 2 - 0.02, p.wheel_radius, 0.2, p.rim) for x in axles]
    if p.trim:
        parts += _sills(p, axles)
    return merge(*parts)


def _axles(p: CarParams) -> tuple[float, float]:
    front = p.length * 0.3
    return front, front - p.wheelbase


def _section(p: CarParams, share: float, low: float) -> np.ndarray:
    """The open cross-section of the body at ``share`` of the length: sill, crease, shoulder."""
    half = np.interp(share, [0, 0.05, 0.16, 0.84, 0.96, 1], [0.80, 0.94, 1, 1, 0.95, 0.86])
    half *= p.width / 2
    top = np.interp(
        share,
        [0, 0.03, p.cowl, p.tail, max(p.tail + 0.001, 0.985), 1],
        [p.hood - 0.07, p.hood, p.belt, max(p.belt, p.deck), p.deck, p.deck - 0.05],
    )
    crease = max(low + 0.04, 0.62 * p.hood)
    left = np.array([(0.95 * half, low), (half, crease), (0.93 * half, top)])
    line = np.concatenate([left, left[::-1] * [-1, 1]])
    return np.column_stack([np.full(6, _at(p, share)), line])


def _stations(p: CarParams) -> list[tuple[float, float]]:
    """(share of the length, height of the lower edge), with a wheel arch over each axle."""
    arch = p.wheel_radius + 0.055
    stations = [(0.0, p.sill + 0.05), (0.05, p.sill), (p.cowl, p.sill), (p.tail, p.sill)]
    stations += [(0.96, p.sill), (1.0, p.sill + 0.1)]
    for x in _axles(p):
        centre = 0.5 - x / p.length
        stations = [s for s in stations if abs(s[0] - centre) * p.length > arch + 0.02]
        for across, up in ((-1.0, None), (-0.62, 0.9), (0.62, 0.9), (1.0, None)):
            low = p.sill if up is None else p.wheel_radius + up * arch
            stations.append((centre + across * arch / p.length, low))
    return sorted(stations)


def _body(p: CarParams) -> Asset:
    sections = [_section(p, share, low) for share, low in _stations(p)]
    floor = [section[[0, -1]] for section in sections]
    return merge(
        loft(np.array(sections), p.color, "paint", closed=False),
        loft(np.array(floor), BLACK, closed=False, caps=False),
    )


def _at(p: CarParams, share: float) -> float:
    """X at a share of the length, m."""
    return p.length * (0.5 - share)


def _roofline(p: CarParams) -> tuple[float, float]:
    """Where the cabin meets the body, and the top of its windscreen; m."""
    return p.belt - 0.03, p.height - 0.03


def _beside(p: CarParams, share: float, height: float, side: int, out: float = 0.012) -> Point:
    """A point ``out`` m outside the cabin's leaning flank, left for ``side`` 1."""
    foot, _ = _roofline(p)
    lean = (height - foot) / (p.height - foot)
    half = 0.465 * p.width * (0.99 + (p.tumblehome - 0.99) * lean)
    return _at(p, share), side * (half + out), height


def _cabin(p: CarParams) -> list[Asset]:
    """Roof and pillars in body colour, with windscreen and rear window laid on."""
    foot, top = _roofline(p)
    middle = (p.roof_front + p.roof_rear) / 2
    outline = [(p.cowl, foot), (p.roof_front, top), (middle, p.height)]
    outline += [(p.roof_rear, top), (p.tail, foot)]
    width, top_width = (2 * _beside(p, 0, z, 1, 0)[1] for z in (foot, p.height))

    def screen(low: float, high: float, right: int) -> np.ndarray:
        ends = ((low, foot, right), (low, foot, -right), (high, top, -right), (high, top, right))
        return np.array([_beside(p, *end, 0) for end in ends])

    front = screen(p.cowl, p.roof_front, -1)
    rear = screen(p.tail, p.roof_rear, 1)
    shell = [(_at(p, share), z) for share, z in outline]
    return [
        extrude(shell, width, p.color, "paint", top_width=top_width),
        panel(front, (0.05, 0.95), (0.06, 0.95), GLASS, "glass"),
        panel(rear, (0.08, 0.92), (0.1, 0.92), GLASS, "glass"),
        *_flank(p, 1),
        *_flank(p, -1),
    ]


def _flank(p: CarParams, side: int) -> list[Asset]:
    """Side windows with a pillar between them, the mirror and the roof rail of one side."""
    foot, top = _roofline(p)
    low, high = p.belt + 0.03, top - 0.05
    rise = (high - foot) / (top - foot)
    front = p.cowl + (p.roof_front - p.cowl) * rise + 0.02
    rear = min(p.tail + (p.roof_rear - p.tail) * rise - 0.015, p.glass_end)
    pane = [(p.cowl + 0.04, low), (front, high), (rear, high), (p.glass_end, low)]
    parts = [polygon([_beside(p, *corner, side) for corner in pane], GLASS, "glass")]
    if p.glass_end > 0.6:  # more than one window
        x = p.cowl + 0.52 * (p.glass_end - p.cowl) + 0.03
        post = [(x - 0.01, low), (x - 0.008, high), (x + 0.012, high), (x + 0.014, low)]
        parts.append(polygon([_beside(p, *end, side, 0.02) for end in post], p.color, "paint"))
    x, y, z = _beside(p, p.cowl + 0.055, p.belt, side, 0.1)
    parts.append(block((x - 0.05, y - 0.09, z), (x + 0.05, y + 0.09, z + 0.12), TRIM))
    if p.rails:
        start, end = p.roof_front + 0.03, p.roof_rear - 0.03
        rail = [(start, 0.0), (end, 0.0), (end, 0.05), (start, 0.05)]
        corners = [_beside(p, s, p.height + up, side, -0.02) for s, up in rail]
        parts.append(polygon(corners, TRIM, "metal"))
    return parts


def _ends(p: CarParams) -> list[Asset]:
    """Lamps, grille, plates and bumpers."""
    front = _section(p, 0, p.sill + 0.05)[[5, 0, 2, 3]]
    corner = _section(p, 0.05, p.sill)
    rear = _section(p, 1, p.sill + 0.1)[[0, 5, 3, 2]]
    bumper = TRIM if p.trim else darker(p.color, 0.8)
    parts = [
        panel(front, (0, 1), (0, 0.34), bumper, lift=0.02),
        panel(front, (0.2, 0.8), (0.06, 0.26), BLACK, lift=0.03),
        panel(front, (0.27, 0.73), (0.62, 0.88), BLACK, lift=0.01),
        panel(front, (0.35, 0.65), (0.38, 0.56), PLATE, lift=0.02),
        lamps(front, (0.01, 0.24), (0.64, 0.95), HEADLAMP),
        panel(rear, (0, 1), (0, 0.3), bumper, lift=0.02),
        panel(rear, (0.34, 0.66), (0.44, 0.60), PLATE, lift=0.015),
        lamps(rear, (0.01, 0.2), (0.62, 0.93), TAILLAMP),
    ]
    nose = _section(p, 0, p.sill + 0.05)
    left = np.array([corner[1], nose[1], nose[2], corner[2]])
    for facet in (left, left[[1, 0, 3, 2]] * [1, -1, 1]):  # lamps reach round the corners
        parts.append(panel(facet, (0, 1), (0.55, 0.92), HEADLAMP, "lamp", lift=0.01))
    return parts


def _sills(p: CarParams, axles: tuple[float, float]) -> list[Asset]:
    """Dark plastic along the lower edge between the wheels."""
    reach = p.wheel_radius + 0.06
    start, end = axles[0] - reach, axles[1] + reach
    half = p.width / 2
    strips = []
    for side in (1, -1):
        low, high = side * (0.95 * half + 0.01), side * (0.98 * half + 0.01)
        ends = [(start, low), (end, low), (end, high), (start, high)]
        heights = (p.sill, p.sill, p.sill + 0.14, p.sill + 0.14)
        strips.append(polygon([(*e, z) for e, z in zip(ends, heights, strict=True)], TRIM))
    return strips
