"""Lorries: a forward cab on a dark chassis with wheels, and one of several bodies or loads behind it."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from scene.assets.family import ROAD, Family, Size
from scene.assets.parts import cargo, lorry
from scene.assets.parts.draw import (
    SEED,
    between,
    maybe,
    near,
    perhaps,
    sample_fields,
    times,
)
from scene.assets.parts.glazing import NARROW, glazed
from scene.assets.parts.lorry import TruckParams, floor
from scene.assets.parts.palette import (
    AMBER,
    BLACK,
    CHROME,
    GLASS,
    HEADLAMP,
    PLATE,
    PLATE_YELLOW,
    SILVER,
    STEEL,
    TAILLAMP,
    TRIM,
    VAN_WHITE,
    WHITE,
    darker,
    pick,
)
from scene.assets.parts.skin import cuboid, pair
from scene.assets.parts.vehicle import (
    Hull,
    arch,
    axle,
    hull,
    hull_walls,
    lamps,
    panel,
    panels,
    panes,
    strips,
    walls,
    wrap,
)
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Parts, merge
from scene.mesh.solids import block, tube

_CAB, _TRACTOR = (0.50, 0.86), (0.44, 0.74)
"""Windscreens, as shares of the cab's height."""
_KINDS: dict[str, TruckParams] = {
    "box lorry": TruckParams("box", 8.2, 2.45, 3.55, 1.9, 2.75, (1.3, 6.2), 0.47, 0.15, _CAB, 0.2),
    "flatbed": TruckParams("flatbed", 8.0, 2.45, 1.9, 1.9, 2.75, (1.3, 6.0), 0.47, 0.2, _CAB, 0.2),
    "tipper": TruckParams("tipper", 7.8, 2.50, 2.85, 2.0, 2.95, (1.3, 5.1, 6.45), 0.5, 0.2, _CAB, 0.2),
    "articulated": TruckParams("box", 14.5, 2.50, 3.95, 2.2, 3.55, (1.4, 4.6, 11.2, 12.5), 0.5, 0.7,
                               _TRACTOR, 0.25),
    "tanker": TruckParams("tanker", 9.5, 2.45, 3.1, 2.0, 2.95, (1.4, 6.2, 7.55), 0.5, 0.25, _CAB, 0.2),
    "refuse": TruckParams("refuse", 8.8, 2.50, 3.4, 2.1, 2.85, (1.5, 5.7), 0.48, 0.2, _CAB, 0.1),
    "luton van": TruckParams("luton", 6.4, 2.15, 3.1, 2.1, 2.2, (1.05, 4.9), 0.36, 0.05, (0.5, 0.88), 0.55),
    "curtainsider": TruckParams("curtain", 9.6, 2.50, 3.8, 2.0, 3.0, (1.4, 6.4, 7.7), 0.48, 0.25, _CAB, 0.2),
    "concrete mixer": TruckParams("mixer", 8.8, 2.45, 3.7, 1.9, 2.85, (1.3, 5.6, 6.95), 0.5, 0.2, _CAB, 0.2),
    "skip lorry": TruckParams("skip", 7.0, 2.40, 2.9, 1.9, 2.7, (1.3, 5.0), 0.46, 0.25, _CAB, 0.2),
    "recovery": TruckParams("recovery", 8.2, 2.35, 2.6, 2.0, 2.6, (1.3, 5.9), 0.42, 0.25, _CAB, 0.25),
    "curtain trailer": TruckParams("curtain", 15.0, 2.50, 3.95, 2.2, 3.6, (1.4, 4.7, 11.4, 12.7), 0.5, 0.7,
                                   _TRACTOR, 0.2),
}  # fmt: skip

_CABS: tuple[Color, ...] = (
    WHITE, WHITE, (0.30, 0.018, 0.018), (0.025, 0.06, 0.19), (0.04, 0.13, 0.30), (0.03, 0.11, 0.05),
    (0.50, 0.30, 0.03), SILVER, (0.02, 0.02, 0.022), (0.48, 0.14, 0.015),
)  # fmt: skip
_BOXES: tuple[Color, ...] = (
    VAN_WHITE, VAN_WHITE, (0.40, 0.41, 0.41), (0.05, 0.10, 0.24), (0.30, 0.03, 0.03),
    (0.03, 0.13, 0.07), (0.52, 0.34, 0.03), (0.10, 0.10, 0.11),
)  # fmt: skip


class Load(NamedTuple):
    """A body or load that lorries have."""

    build: Callable[[TruckParams], Parts]
    colors: tuple[Color, ...]
    beacons: float = 0.15  # probability of beacons on the cab
    deflector: bool = False  # the cab may have a wind deflector
    matching: bool = False  # the cab may have the colour of the body


LOADS: dict[str, Load] = {
    "box": Load(lorry.box, _BOXES, deflector=True),
    "curtain": Load(lorry.curtain, _BOXES, deflector=True),
    "luton": Load(lorry.luton, _BOXES, matching=True),
    "flatbed": Load(cargo.flatbed, ((0.16, 0.11, 0.07), (0.20, 0.20, 0.20))),
    "tipper": Load(cargo.tipper, (
        (0.16, 0.16, 0.165), (0.42, 0.18, 0.02), (0.05, 0.09, 0.13), (0.30, 0.03, 0.02))),
    "tanker": Load(cargo.tanker, (CHROME, WHITE, (0.03, 0.12, 0.05), (0.50, 0.32, 0.03))),
    "refuse": Load(cargo.refuse, (
        (0.60, 0.60, 0.57), (0.52, 0.20, 0.02), (0.05, 0.16, 0.07), (0.04, 0.09, 0.25)), 0.8,
        matching=True),
    "mixer": Load(cargo.mixer, (
        WHITE, (0.50, 0.16, 0.02), SILVER, (0.03, 0.1, 0.25))),
    "skip": Load(cargo.skip, (
        (0.50, 0.33, 0.03), (0.28, 0.05, 0.03), (0.04, 0.10, 0.2), (0.20, 0.20, 0.2)), 0.8),
    "recovery": Load(cargo.recovery, ((0.50, 0.33, 0.03), CHROME, (0.25, 0.02, 0.02)), 0.8),
}  # fmt: skip


def sample_truck(rng: np.random.Generator, kind: str) -> TruckParams:
    """Draw a lorry of one body type: proportions, colours of cab and load, lettering, fittings."""
    model = _KINDS[kind]
    load = LOADS[model.load]
    body, cab = pick(rng, load.colors), pick(rng, _CABS)
    stretch = rng.uniform(0.9, 1.06)
    dark_ink = (0.03, 0.04, 0.12) if rng.random() < 0.5 else cab
    ink = WHITE if max(body) < 0.35 else dark_ink if max(dark_ink) < 0.4 else TRIM
    grille = rng.uniform(0.16, 0.24)
    return sample_fields(
        rng, model, length=model.length * stretch,
        axles=(model.axles[0], *(x * stretch for x in model.axles[1:])),
        height=times(0.9, 1.05), cab_height=times(0.95, 1.06), rake=times(0.4, 1.6),
        cab=perhaps(0.6, body, cab) if load.matching else cab, body=body,
        letters=perhaps(0.75, ink), band=perhaps(0.4, near(0.15, *_CABS)), visor=maybe(0.4),
        deflector=load.deflector and maybe(0.55), beacons=maybe(load.beacons),
        round=between(0.1, 0.28), grille=(grille, lambda rng, _: grille + rng.uniform(0.1, 0.24)),
        fill=between(0.45, 0.95), seed=SEED, glazing=glazed(0.7),
    )  # fmt: skip


def truck(p: TruckParams) -> Asset:
    """Build the lorry, its cab towards +x."""
    nose, half = p.length / 2, p.width / 2
    rim = STEEL if p.seed % 3 else (0.5, 0.5, 0.49)
    front, *others = (nose - x for x in p.axles)
    wheels = [axle(front, half + 0.03, p.wheel_radius, 0.32, rim)]
    wheels += [axle(x, half - 0.02, p.wheel_radius, 0.32, rim) for x in others]
    arches = [arch(front, y, p.wheel_radius, p.wheel_radius + 0.1, 10) for y in (half, -half)]
    return merge(*wheels, *arches, *_cab(p), *_chassis(p), *LOADS[p.load].build(p), *_tail(p))


def _cab(p: TruckParams) -> Parts:
    """Build the cab: hull, wrapped windscreen, doors, grille, lamps, steps and mirrors."""
    nose, low, width = p.length / 2, 0.38, p.width - 0.04
    middle = nose - p.cab_length / 2
    h = Hull(p.cab_length, width, low, p.cab_height, middle, p.round, 0.8 * p.round, p.rake)
    side = hull_walls(h)
    front = side.front
    foot, top = p.windscreen
    back = (p.rake * top + p.round) / p.cab_length  # share of the side lost to the screen's lean
    door, badge = (0.36, 0.97 - back), (p.grille[1] + 0.015, p.grille[1] + 0.04)
    yield hull(h, p.cab)
    yield wrap(h, 1, (foot, top), 0.02, GLASS, "glass")
    driver = 0.55 * p.glazing.side
    yield from panes(front, [(0.13, 0.87)], p.windscreen, p.glazing, (-0.55, 0.55), driver)
    yield wrap(h, 1, (0.0, 0.13), 0.12, TRIM, lift=0.03)
    yield panel(front, (0.2, 0.8), p.grille, BLACK, lift=0.015)
    yield panel(front, (0.38, 0.62), (0.03, 0.09), PLATE, lift=0.05)
    yield panel(front, (0.44, 0.56), badge, CHROME, "metal", lift=0.02)
    yield lamps(front, (0.08, 0.2), (0.14, 0.21), HEADLAMP, lift=0.035)
    yield lamps(front, (0.21, 0.24), (0.14, 0.21), AMBER, lift=0.035)
    slats = strips(np.linspace(*p.grille, 5)[1:-1], 0.006)
    yield panels(front, [(0.21, 0.79)], slats, STEEL, "metal", lift=0.025)
    for wall, u in ((side.right, door), (side.left, (1 - door[1], 1 - door[0]))):
        yield from panes(wall, [u], (foot, top - 0.03), p.glazing, (), 0.0, narrow=NARROW)
        seams = [(u[0] - 0.01, u[0] - 0.002), (u[1] + 0.002, u[1] + 0.01)]
        yield panels(wall, seams, [(0.14, top)], BLACK)
        handle = (u[0] + 0.02, u[0] + 0.1) if wall is side.right else (u[1] - 0.1, u[1] - 0.02)
        yield panel(wall, handle, (foot - 0.06, foot - 0.04), TRIM, lift=0.03)
        yield panels(wall, [u], [(0.02, 0.05), (0.1, 0.13)], BLACK, lift=0.02)
    x, y, z = nose - p.rake * foot, p.width / 2, low + foot * (p.cab_height - low)
    mirror = block((x - 0.1, y + 0.03, z), (x, y + 0.23, z + 0.5), TRIM)
    arm = (x - 0.2, y - 0.05, z + 0.5), (x - 0.05, y + 0.13, z + 0.47)
    yield pair(merge(mirror, tube(*arm, 0.02, TRIM, sides=4)))
    for y in (0.35, -0.45):
        wiper = (x + 0.03, y, z - 0.02), (x, y + 0.5, z + 0.1)
        yield tube(*wiper, 0.012, BLACK, sides=4)
    yield from _cab_fittings(p, h)


def _cab_fittings(p: TruckParams, h: Hull) -> Parts:
    """Build sun visor, wind deflector and beacons, where fitted."""
    nose, top = p.length / 2, p.windscreen[1]
    if p.visor:
        x, z = nose - p.rake * top, h.low + top * (h.high - h.low)
        yield cuboid((x - 0.05, x + 0.22), 0.45 * p.width, (z - 0.02, z + 0.1), darker(p.cab, 0.4))
    if p.deflector and p.height > h.high + 0.15:
        length, x = p.cab_length, nose - p.cab_length + 0.42 * p.cab_length
        shape = Hull(0.8 * length, 0.86 * p.width, h.high - 0.05, p.height - 0.05, x)
        yield hull(shape._replace(round=0.2, chamfer=0.15, nose=0.55 * length), p.cab)
    if p.beacons:
        low, high = h.high - 0.02, h.high + 0.18
        for y in (0.6, -0.6):
            yield tube((h.x, y, low), (h.x, y, high), 0.09, AMBER, "lamp", sides=8)


def _chassis(p: TruckParams) -> Parts:
    """Build frame rails, fuel tank, mudguards, and side guards between axles that are far apart."""
    nose, tail, bed = p.length / 2, -p.length / 2, floor(p)
    yield cuboid((tail, nose - 1), 0.45, (bed - 0.35, bed), BLACK, "metal")
    for ahead, behind in itertools.pairwise(p.axles):
        start, end = nose - behind + p.wheel_radius + 0.1, nose - ahead - p.wheel_radius - 0.1
        end = min(end, nose - p.cab_length - 0.1)
        if end - start > 1:
            for low, high in ((0.42, 0.52), (0.65, 0.75)):
                y = p.width / 2 - 0.06
                yield pair(cuboid((start, end), 0.02, (low, high), STEEL, "metal", at=y))
            y, z = -0.75 * p.width / 2, bed - 0.32
            yield tube((end - 0.9, y, z), (end - 0.1, y, z), 0.26, STEEL, "metal", sides=12)
    for x in p.axles[1:]:
        y, back = p.width / 2 - 0.02, nose - x - (p.wheel_radius + 0.05)
        flap = (back - 0.03, y - 0.4, 0.3), (back, y, bed - 0.05)
        yield pair(block(*flap, BLACK, "rubber"))


def _tail(p: TruckParams) -> Parts:
    """Build bumper bar, lamps and plate at the rear."""
    rear = walls(p.length, p.width, floor(p) - 0.45, floor(p)).rear
    yield panel(rear, (0, 1), (0.15, 0.8), TRIM, lift=0.01)
    yield lamps(rear, (0.02, 0.12), (0.25, 0.65), TAILLAMP, lift=0.02)
    yield lamps(rear, (0.13, 0.17), (0.25, 0.65), AMBER, lift=0.02)
    yield lamps(rear, (0.2, 0.34), (0.25, 0.6), (0.5, 0.2, 0.02), lift=0.02)
    yield panel(rear, (0.4, 0.6), (0.3, 0.6), PLATE_YELLOW, lift=0.02)


FAMILY = Family(
    "truck", TrainId.TRUCK, tuple(_KINDS), sample_truck, truck,
    count=39, size=Size((3.5, 30), (1.6, 5)), tone=0.85, line=("car", 0.05),
    facing="lane", stage=ROAD,
)  # fmt: skip
