"""Lorries: a forward cab on a dark chassis with wheels, and one of several loads behind it."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, block, loft, merge, vary
from scene.assets._palette import (
    AMBER,
    BLACK,
    GLASS,
    HEADLAMP,
    PLATE,
    STEEL,
    TAILLAMP,
    TRIM,
    darker,
    pick,
)
from scene.assets._vehicle import arch, axle, hull, lamps, panel, walls


class TruckParams(NamedTuple):
    """One lorry; metres, x measured back from the nose."""

    load: str  # "box", "flatbed", "tipper", "tanker", or "refuse"
    length: float
    width: float
    height: float  # of the load
    cab_length: float
    cab_height: float
    axles: tuple[float, ...]  # x of each
    wheel_radius: float
    gap: float  # between cab and load
    windscreen: tuple[float, float]  # share of the cab's height
    rake: float  # m that the cab's roof is set back
    cab: Color = (0.5, 0.5, 0.5)
    body: Color = (0.6, 0.6, 0.6)
    stripe: Color | None = None  # lettering on the sides of a box


_GRAVEL: Color = (0.16, 0.13, 0.10)
_CAB = (0.50, 0.86)
_MODELS: dict[str, TruckParams] = {
    "box lorry": TruckParams("box", 8.2, 2.45, 3.55, 1.9, 2.75, (1.3, 6.2), 0.47, 0.15, _CAB, 0.2),
    "flatbed": TruckParams("flatbed", 8.0, 2.45, 1.9, 1.9, 2.75, (1.3, 6.0), 0.47, 0.2, _CAB, 0.2),
    "tipper": TruckParams(
        "tipper", 7.8, 2.50, 2.85, 2.0, 2.95, (1.3, 5.1, 6.45), 0.5, 0.2, _CAB, 0.2
    ),
    "articulated": TruckParams(
        "box", 14.5, 2.50, 3.95, 2.2, 3.55, (1.4, 4.6, 11.2, 12.5), 0.5, 0.7, (0.44, 0.74), 0.25
    ),
    "tanker": TruckParams(
        "tanker", 9.5, 2.45, 3.1, 2.0, 2.95, (1.4, 6.2, 7.55), 0.5, 0.25, _CAB, 0.2
    ),
    "refuse": TruckParams("refuse", 8.8, 2.50, 3.4, 2.1, 2.85, (1.5, 5.7), 0.48, 0.2, _CAB, 0.1),
    "luton van": TruckParams(
        "box", 6.4, 2.15, 3.1, 2.1, 2.3, (1.05, 4.9), 0.36, 0.05, (0.5, 0.88), 0.45
    ),
}
KINDS: tuple[str, ...] = tuple(_MODELS)
"""Body types."""

_CABS: tuple[Color, ...] = (
    (0.62, 0.62, 0.60),
    (0.62, 0.62, 0.60),
    (0.30, 0.018, 0.018),
    (0.025, 0.06, 0.19),
    (0.04, 0.13, 0.30),
    (0.03, 0.11, 0.05),
    (0.50, 0.30, 0.03),
    (0.30, 0.31, 0.32),
)
_LOADS: dict[str, tuple[Color, ...]] = {
    "box": ((0.64, 0.64, 0.62), (0.40, 0.41, 0.41), (0.05, 0.10, 0.24), (0.30, 0.03, 0.03)),
    "flatbed": ((0.16, 0.11, 0.07), (0.20, 0.20, 0.20)),
    "tipper": ((0.16, 0.16, 0.165), (0.42, 0.18, 0.02), (0.05, 0.09, 0.13)),
    "tanker": ((0.42, 0.43, 0.44), (0.62, 0.62, 0.60)),
    "refuse": ((0.60, 0.60, 0.57), (0.52, 0.20, 0.02), (0.05, 0.16, 0.07)),
}


def sample_truck(rng: np.random.Generator, kind: str) -> TruckParams:
    """Draw a lorry of one body type: size within 6 %, colours of cab and load."""
    model = _MODELS[kind]
    body = pick(rng, _LOADS[model.load])
    lettered = model.load == "box" and rng.random() < 0.6
    cab = pick(rng, _CABS)
    long = rng.uniform(0.95, 1.06)
    return model._replace(
        length=model.length * long,
        axles=(model.axles[0], *(x * long for x in model.axles[1:])),
        height=model.height * rng.uniform(0.94, 1.05),
        cab=body if model.load == "refuse" and rng.random() < 0.5 else cab,
        body=body,
        stripe=vary(rng, cab if max(cab) < 0.4 else TRIM) if lettered else None,
    )


def truck(params: TruckParams) -> Asset:
    """The lorry of ``params``, its cab towards +x."""
    p = params
    nose = p.length / 2
    sides = 8 if len(p.axles) > 2 else 10
    half = p.width / 2
    wheels = [
        axle(nose - x, half + out, p.wheel_radius, 0.32, STEEL, rim_share=0.5, sides=sides)
        for x, out in zip(p.axles, (0.01, -0.02, -0.02, -0.02), strict=False)
    ]
    front = nose - p.axles[0]
    arches = [arch(front, y, p.wheel_radius, p.wheel_radius + 0.1) for y in (half, -half)]
    return merge(*wheels, *arches, *_cab(p), *_chassis(p), *_LOAD_PARTS[p.load](p), *_tail(p))


def _floor(p: TruckParams) -> float:
    """Height of the load bed, m."""
    return 2 * p.wheel_radius + 0.12


def _bed(p: TruckParams) -> tuple[float, float, float]:
    """Centre x, length and width of the load."""
    length = p.length - p.cab_length - p.gap
    return -p.length / 2 + length / 2, length, p.width


def _cab(p: TruckParams) -> list[Asset]:
    """The forward cab: hull, glazing, grille, lamps and mirrors."""
    nose, low, width = p.length / 2, 0.38, p.width - 0.04
    middle = nose - p.cab_length / 2
    side = walls(p.cab_length, width, low, p.cab_height, x=middle)
    front = side.front.copy()
    front[2:, 0] -= p.rake
    foot, top = p.windscreen
    back = p.rake * top / p.cab_length + 0.05  # share of the side lost to the windscreen's lean
    door = (0.42, 0.97 - back)
    parts = [
        hull(p.cab_length, width, low, p.cab_height, p.cab, x=middle, nose=p.rake, chamfer=0.12),
        panel(front, (0.05, 0.95), (foot, top), GLASS, "glass"),
        panel(side.right, door, (foot, top - 0.03), GLASS, "glass"),
        panel(side.left, (1 - door[1], 1 - door[0]), (foot, top - 0.03), GLASS, "glass"),
        panel(front, (0, 1), (0, 0.13), TRIM, lift=0.02),
        panel(front, (0.22, 0.78), (0.22, foot - 0.08), BLACK),
        panel(front, (0.38, 0.62), (0.03, 0.1), PLATE, lift=0.03),
        lamps(front, (0.03, 0.19), (0.15, 0.23), HEADLAMP),
    ]
    eyes = low + foot * (p.cab_height - low)
    for y in (p.width / 2 + 0.13, -p.width / 2 - 0.13):
        x = nose - p.rake * foot
        parts.append(block((x - 0.1, y - 0.1, eyes), (x, y + 0.1, eyes + 0.5), TRIM))
    return parts


def _chassis(p: TruckParams) -> list[Asset]:
    """Frame rails, and side guards between the axles that are far apart."""
    nose, tail, floor = p.length / 2, -p.length / 2, _floor(p)
    parts = [block((tail, -0.45, floor - 0.35), (nose - 1, 0.45, floor), BLACK, "metal")]
    for ahead, behind in itertools.pairwise(p.axles):
        start, end = nose - behind + p.wheel_radius + 0.1, nose - ahead - p.wheel_radius - 0.1
        start, end = start, min(end, nose - p.cab_length - 0.1)
        if end - start > 1:
            for y in (p.width / 2 - 0.06, 0.06 - p.width / 2):
                low, high = (start, y - 0.03, 0.45), (end, y + 0.03, floor - 0.1)
                parts.append(block(low, high, TRIM, "metal"))
    return parts


def _tail(p: TruckParams) -> list[Asset]:
    """Bumper bar, lamps and plate at the rear."""
    rear = walls(p.length, p.width, _floor(p) - 0.4, _floor(p)).rear
    return [
        panel(rear, (0, 1), (0.15, 0.75), TRIM, lift=0.01),
        lamps(rear, (0.02, 0.17), (0.25, 0.65), TAILLAMP, lift=0.02),
        panel(rear, (0.4, 0.6), (0.3, 0.6), PLATE, lift=0.02),
    ]


def _box(p: TruckParams) -> list[Asset]:
    x, length, width = _bed(p)
    low = _floor(p)
    side = walls(length, width, low, p.height, x=x)
    parts = [
        block((x - length / 2, -width / 2, low), (x + length / 2, width / 2, p.height), p.body),
        panel(side.rear, (0.485, 0.515), (0.04, 0.96), TRIM),
    ]
    parts += [panel(wall, (0, 1), (0, 0.03), TRIM) for wall in (*side[:2], side.rear)]
    if p.stripe is not None:
        parts += [panel(wall, (0.12, 0.88), (0.38, 0.66), p.stripe) for wall in side[:2]]
    return parts


def _flatbed(p: TruckParams) -> list[Asset]:
    x, length, width = _bed(p)
    low, half = _floor(p), width / 2
    front, rear = x + length / 2, x - length / 2
    parts = [
        block((rear, -half, low), (front, half, low + 0.14), p.body, "wood"),
        block((front - 0.08, -half, low), (front, half, p.height + 0.4), STEEL, "metal"),
    ]
    stacks = ((0.32, 0.75, 0.62, BLACK), (0.78, 0.5, 0.95, p.body), (0.55, 0.42, 0.4, STEEL))
    for share, wide, tall, color in stacks:  # crates and pallets
        middle, reach = rear + share * length, 0.1 * length
        corner = (middle - reach, -wide * half, low + 0.14)
        far = (middle + reach, wide * half, low + 0.14 + tall * (p.height - low))
        parts.append(block(corner, far, color, "wood"))
    return parts


def _tipper(p: TruckParams) -> list[Asset]:
    x, length, width = _bed(p)
    low, half, high = _floor(p), width / 2, p.height
    lower = [(x - length / 2, half - 0.1, low), (x + length / 2, half - 0.1, low)]
    upper = [(x - length / 2 - 0.1, half, high), (x + length / 2, half, high)]
    ring = [
        np.array([*line, *(np.array(line[::-1]) * [1, -1, 1])], float) for line in (lower, upper)
    ]
    heap = ring[1] * [0.94, 0.9, 1] - [0, 0, 0.12]
    parts = [
        loft(ring, p.body, "metal"),
        loft([heap, heap * [0.4, 0.3, 1] + [0.6 * x, 0, 0.45]], _GRAVEL, "concrete"),
        block((x + length / 2, -half, high - 0.1), (x + length / 2 + 0.7, half, high), p.body),
    ]
    for share in (0.12, 0.37, 0.63, 0.88):  # ribs
        for side in (1, -1):
            post = x + (share - 0.5) * length
            low_corner = (post - 0.05, side * (half - 0.02) - 0.05, low)
            high_corner = (post + 0.05, side * (half - 0.02) + 0.05, high)
            parts.append(block(low_corner, high_corner, p.body, "metal"))
    return parts


def _tanker(p: TruckParams) -> list[Asset]:
    x, length, width = _bed(p)
    low, radius = _floor(p), (p.height - _floor(p)) / 2
    middle = low + radius
    angle = np.arange(12) * np.pi / 6
    loop = np.column_stack([np.cos(angle) * 0.49 * width, middle + np.sin(angle) * radius])
    rings = []
    for share, scale in ((-0.5, 0.82), (-0.47, 1.0), (0.47, 1.0), (0.5, 0.82)):
        scaled = (loop - [0, middle]) * scale + [0, middle]
        rings.append(np.column_stack([np.full(12, x + share * length), scaled]))
    walkway = (x - 0.4 * length, -0.3, p.height - 0.04), (x + 0.4 * length, 0.3, p.height + 0.06)
    side = walls(0.94 * length, width + 0.01, low + 0.75 * radius, low + 1.25 * radius, x=x)
    return [
        loft(rings, p.body, "paint"),
        block(*walkway, TRIM),
        block((x - length / 2, -0.5, low - 0.1), (x + length / 2, 0.5, low + 0.15), TRIM),
        *(panel(wall, (0, 1), (0.1, 0.5), p.cab, lift=-0.01) for wall in side[:2]),
        panel(side.rear, (0.42, 0.58), (0.2, 0.8), AMBER, lift=0.03 * length + 0.01),
    ]


def _refuse(p: TruckParams) -> list[Asset]:
    """A hopper body whose rear loader hangs lower than its floor and leans out."""
    x, length, width = _bed(p)
    low, half = _floor(p), width / 2
    tail, split = x - length / 2, x - length / 2 + 1.5
    side = walls(x + length / 2 - split, width, low, p.height, x=(x + length / 2 + split) / 2)
    outline = np.array([(split, 0.55), (split, p.height), (tail + 0.7, p.height), (tail, 1.6)])
    outline = np.concatenate([outline, [(tail + 0.15, 0.55)]])
    rings = [np.column_stack([outline[:, 0], np.full(5, y), outline[:, 1]]) for y in (half, -half)]
    back = [(tail, half, 1.6), (tail, -half, 1.6), (tail + 0.7, -half, p.height)]
    slope = np.array([*back, (tail + 0.7, half, p.height)])
    parts = [
        block((split, -half, low), (x + length / 2, half, p.height - 0.15), p.body),
        loft(rings, darker(p.body, 0.8), "paint"),
        panel(slope, (0.12, 0.88), (0.02, 0.45), BLACK),
        panel(slope, (0, 1), (0.62, 0.72), AMBER),
    ]
    parts += [panel(wall, (0.1, 0.9), (0.25, 0.45), p.cab) for wall in side[:2]]
    for share in (0.05, 0.5, 0.95):  # ribs
        parts += [
            panel(wall, (share - 0.02, share + 0.02), (0, 0.94), TRIM, lift=0.02)
            for wall in side[:2]
        ]
    return parts


_LOAD_PARTS: dict[str, Callable[[TruckParams], list[Asset]]] = {
    "box": _box,
    "flatbed": _flatbed,
    "tipper": _tipper,
    "tanker": _tanker,
    "refuse": _refuse,
}
