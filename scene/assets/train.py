"""Rail vehicles on the building line: trams, railcars, locomotives and wagons.

Unlike for other vehicles, the origin is the base centre of the near side: the near face is in y = 0 and
faces -y, the body extends to y > 0.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from scene.assets.family import FRONTAGE, Family, Size
from scene.assets.parts.draw import (
    SEED,
    between,
    integer,
    maybe,
    near,
    perhaps,
    sample_fields,
    times,
)
from scene.assets.parts.glazing import EMPTY, Glazing, glazed
from scene.assets.parts.palette import (
    AMBER,
    BLACK,
    GLASS,
    HEADLAMP,
    OFF_WHITE,
    STEEL,
    TAILLAMP,
    TRIM,
    WHITE,
    darker,
)
from scene.assets.parts.skin import Span, cuboid
from scene.assets.parts.vehicle import (
    Hull,
    Walls,
    axle,
    hoop,
    hull,
    hull_walls,
    lamps,
    lettering,
    panel,
    panels,
    panes,
    rod,
    strips,
    tank,
    walls,
    window_row,
    wrap,
)
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Parts, merge, translate
from scene.mesh.solids import loft, tube


class TrainParams(NamedTuple):
    """One vehicle on rails; metres."""

    body: str  # see ``_BODIES``
    length: float
    width: float
    height: float
    floor: float  # lower edge of the body
    sections: int
    rake: float  # m that the roof is set back at the ends
    color: Color = (0.3, 0.02, 0.02)
    band: Color = (0.6, 0.6, 0.6)
    pantograph: bool = True
    bays: int = 3  # windows of a section
    face: Color | None = None  # of the ends
    round: float = 0.3  # radius of the corners
    seed: int = 0  # of the lettering
    glazing: Glazing = EMPTY


_KINDS: dict[str, TrainParams] = {
    "tram": TrainParams("tram", 18.0, 2.40, 3.40, 0.25, 3, 0.7),
    "commuter": TrainParams("railcar", 19.5, 2.80, 3.85, 0.95, 2, 0.45),
    "locomotive": TrainParams("locomotive", 15.0, 2.85, 3.95, 1.00, 1, 0.5),
    "goods wagon": TrainParams("hopper", 12.5, 2.75, 3.50, 1.10, 1, 0.0),
    "container wagon": TrainParams("container", 14.0, 2.50, 3.75, 1.15, 1, 0.0),
    "old tram": TrainParams("tram", 11.5, 2.25, 3.30, 0.45, 1, 0.15),
    "tank wagon": TrainParams("tank", 13.0, 2.70, 3.70, 1.15, 1, 0.0),
    "high-speed": TrainParams("railcar", 20.0, 2.85, 3.80, 0.80, 1, 2.6),
}

_LIVERIES: tuple[Color, ...] = (
    (0.36, 0.016, 0.018), (0.50, 0.30, 0.025), (0.025, 0.08, 0.25), (0.03, 0.15, 0.07),
    OFF_WHITE, (0.33, 0.34, 0.35),
)  # fmt: skip
"""Red, yellow, blue, green, white and silver."""
_FREIGHT: tuple[Color, ...] = (
    (0.14, 0.055, 0.03), (0.16, 0.16, 0.165), (0.04, 0.09, 0.18), (0.05, 0.11, 0.06), (0.36, 0.12, 0.02),
)  # fmt: skip
"""Rust, grey, blue, green and orange."""


def sample_train(rng: np.random.Generator, kind: str) -> TrainParams:
    """Draw a vehicle of one type: length within 6 %, height within 2 %, livery."""
    model = _KINDS[kind]
    freight = _BODIES[model.body].freight
    paints, bands = (_FREIGHT, _FREIGHT) if freight else (_LIVERIES, (*_LIVERIES, TRIM, WHITE))
    return sample_fields(
        rng, model, color=near(0.15, *paints), length=times(0.94, 1.06), height=times(0.98, 1.02),
        band=near(0.15, *bands), pantograph=maybe(0.8), bays=integer(2, 5),
        face=perhaps(0.5, near(0.15, *_LIVERIES)), round=between(0.2, 0.5), rake=times(0.8, 1.2),
        seed=SEED, glazing=glazed(0.6),
    )  # fmt: skip


def train(p: TrainParams) -> Asset:
    """Build the vehicle along x, its near face in y = 0."""
    body = _BODIES[p.body]
    wire = _pantograph(p) if p.pantograph and body.wired else ()
    return translate(merge(*_bogies(p), *body.build(p), *wire), (0, p.width / 2 + 0.04, 0))


def _bogies(p: TrainParams) -> Parts:
    """Build two bogies of two axles, and the dark frame between them."""
    radius = _BODIES[p.body].wheel_radius
    half = p.width / 2 - 0.12
    for middle in (-0.33 * p.length, 0.33 * p.length):
        for x in (middle - 0.95, middle + 0.95):
            yield axle(x, half, radius, 0.14, None, sides=16)
        if p.floor > radius + 0.1:
            span, high = (middle - 1.5, middle + 1.5), (radius + 0.05, p.floor + 0.02)
            yield cuboid(span, half + 0.03, high, BLACK, "metal")
    if p.floor > 0.8:
        span = (-0.18 * p.length, 0.18 * p.length)
        yield cuboid(span, p.width / 2 - 0.25, (0.35, p.floor), TRIM, "metal")


def _pantograph(p: TrainParams) -> Parts:
    """Build a bent arm and its contact bar on the roof."""
    top, x = p.height, 0.12 * p.length
    elbow, head, high = (x - 0.7, 0.0, top + 0.55), x + 0.25, top + 1.1
    yield cuboid((x - 0.6, x + 0.6), 0.5, (top - 0.02, top + 0.16), TRIM)
    yield rod((x + 0.3, 0, top), elbow, 0.035, STEEL)
    yield rod(elbow, (head, 0.0, high), 0.03, STEEL)
    yield rod((head, -0.75, high), (head, 0.75, high), 0.03, STEEL)


def _shape(p: TrainParams) -> Hull:
    return Hull(p.length, p.width, p.floor, p.height, 0.0, p.round, 0.3, p.rake, p.rake)


def _cab_ends(p: TrainParams, side: Walls, glass: Span) -> Parts:
    """Build windscreens that reach round the corners, lamps, couplers and destination boards."""
    shape = _shape(p)
    for end, face, lamp in ((1, side.front, HEADLAMP), (-1, side.rear, TAILLAMP)):
        if p.face is not None:
            yield wrap(shape, end, (0.1, glass[0]), 0.5, p.face, "paint", lift=0.008)
        yield wrap(shape, end, glass, 0.15, GLASS, "glass")
        yield wrap(shape, end, (0, 0.1), 0.3, TRIM)
        yield from panes(face, [(0.16, 0.49), (0.51, 0.84)], glass, p.glazing, (0.0,), 0.0)
        yield lamps(face, (0.15, 0.26), (0.18, 0.25), lamp, lift=0.03)
        yield panel(face, (0.25, 0.75), (glass[1] + 0.015, glass[1] + 0.08), BLACK, lift=0.02)
        yield lettering(face, (0.3, 0.7), (glass[1] + 0.025, glass[1] + 0.07), AMBER, p.seed)
        x, z = end * p.length / 2, p.floor
        yield cuboid((x - 0.25, x + 0.25), 0.15, (z - 0.1, z + 0.15), TRIM)


def _passenger(p: TrainParams, bays: int, doors: int, glass: Span) -> Parts:
    """Build sections with a continuous dark window band, doors, a coloured band and cab ends."""
    side = hull_walls(_shape(p))
    inset = (p.rake * glass[1] + p.round + 0.1) / p.length
    yield hull(_shape(p), p.color)
    yield from _cab_ends(p, side, (glass[0] - 0.03, glass[1]))
    coolers = np.array((-0.3, 0.35) if p.seed % 2 else (-0.12, 0.3, -0.38))
    for x in coolers * (p.length - 2 * p.rake):  # on the roof
        yield cuboid((x - 1.1, x + 1.1), 0.7, (p.height - 0.05, p.height + 0.22), TRIM, "metal")
    for wall in side[:2]:
        yield from window_row(wall, bays, (inset, 1 - inset), glass, p.glazing, 0.1)
        low = (0.05, 0.2) if p.seed % 3 else (glass[1] + 0.02, glass[1] + 0.09)
        yield panel(wall, (inset, 1 - inset), low, p.band, "paint")
        yield lettering(wall, (0.6, 0.75), (0.22, glass[0] - 0.03), p.band, p.seed)
        for share in inset + (1 - 2 * inset) * (np.arange(doors) + 0.5) / doors:
            u = share - 0.7 / p.length, share + 0.7 / p.length
            yield panel(wall, u, (0.02, glass[1] + 0.03), p.band, "paint", lift=0.025)
            leaves = ((u[0] + 0.008, share - 0.003), (share + 0.003, u[1] - 0.008))
            yield from panes(wall, leaves, (0.3, glass[1]), p.glazing, lift=0.035)
    for joint in np.linspace(-0.5, 0.5, p.sections + 1)[1:-1] * p.length:
        half = p.width / 2 + 0.03
        yield cuboid((joint - 0.3, joint + 0.3), half, (p.floor, p.height - 0.2), BLACK)


def _tram(p: TrainParams) -> Parts:
    return _passenger(p, p.bays * (p.sections + 2), max(2, p.sections + 1), (0.36, 0.82))


def _railcar(p: TrainParams) -> Parts:
    return _passenger(p, 6 + 2 * p.bays, 2 if p.rake > 1 else 4, (0.42, 0.78))


def _locomotive(p: TrainParams) -> Parts:
    side = hull_walls(_shape(p))
    yield hull(_shape(p), p.color)
    yield from _cab_ends(p, side, (0.52, 0.84))
    for wall in side[:2]:
        yield panel(wall, (0.04, 0.96), (0.06, 0.22), p.band)
        yield lettering(wall, (0.35, 0.65), (0.28, 0.46), p.band, p.seed)
        yield from panes(wall, ((0.06, 0.11), (0.89, 0.94)), (0.52, 0.84), p.glazing)
        for start in (0.2, 0.36, 0.52, 0.68):  # ventilation grilles
            grille, slats = (start, start + 0.12), [(v, v + 0.012) for v in (0.6, 0.66, 0.72, 0.78)]
            yield panel(wall, grille, (0.55, 0.82), TRIM, "metal")
            yield panels(wall, [grille], slats, STEEL, lift=0.02)
    reach = p.length / 2 + 0.4
    for y in (-0.88, 0.88):  # buffers, one bar through the length for a pair
        yield cuboid((-reach, reach), 0.16, (0.9, 1.2), TRIM, at=y)


def _hopper(p: TrainParams) -> Parts:
    """Build an open wagon with ribs, narrower below, heaped with ballast or coal."""
    half, end = p.width / 2, p.length / 2 - 0.4
    plan = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
    levels = ((0.8, 0.6, p.floor - 0.2), (1, 0.97, p.floor + 0.9), (1, 0.97, p.height))
    rings = [plan * [end * length, half * width, 0] + [0, 0, z] for length, width, z in levels]
    heap = [rings[2] - [0, 0, 0.05], plan * [0.7 * end, 0.3 * half, 0] + [0, 0, p.height + 0.35]]
    yield loft(rings, p.color, "metal")
    yield loft(heap, (0.05, 0.048, 0.045), "concrete")
    yield cuboid((-p.length / 2, p.length / 2), 0.5, (0.85, 1.1), BLACK, "metal")
    for wall in walls(2 * end, 0.97 * p.width, p.floor + 0.9, p.height)[:2]:
        ribs = strips(np.linspace(0.02, 0.98, 9), 0.012)
        yield panels(wall, ribs, [(0, 1)], darker(p.color), "metal")


def _container(p: TrainParams) -> Parts:
    """Build two containers on a flat wagon."""
    half, end = p.width / 2, p.length / 2
    yield cuboid((-end, end), half, (p.floor - 0.25, p.floor), BLACK, "metal")
    for start, stop, color in ((-end + 0.3, -0.1, p.color), (0.1, end - 0.3, p.band)):
        yield cuboid((start, stop), half, (p.floor, p.height), color, "metal")
        side = walls(stop - start, p.width, p.floor, p.height, x=(start + stop) / 2)
        for wall in side[:2]:
            folds = strips(np.linspace(0.04, 0.96, 9), 0.018)
            yield panels(wall, folds, [(0.05, 0.95)], darker(color), "metal")


def _tank(p: TrainParams) -> Parts:
    """Build a long tank with bands, a dome and a ladder on a flat frame."""
    half, end = p.width / 2, p.length / 2
    radius = (p.height - p.floor) / 2
    angle = np.arange(24) * np.pi / 12
    loop = np.column_stack([np.cos(angle), np.sin(angle)]) * radius
    ends = ((0.97, 0.5), (0.95, 0.8), (0.91, 0.96), (0.86, 1.0))
    middle = p.floor + radius
    yield cuboid((-end, end), half, (p.floor - 0.3, p.floor), BLACK, "metal")
    yield tank(loop, 0.0, middle, end, ends, p.color)
    dome = (0, 0, p.height - 0.1), (0, 0, p.height + 0.25)
    yield tube(*dome, 0.5, darker(p.color), "metal", sides=12)
    for share in (-0.6, -0.2, 0.2, 0.6):
        yield hoop(loop, (share * end - 0.06, share * end + 0.06), middle, 1.01, p.band)
    for x in (0.3, 0.7):
        yield rod((x, -radius - 0.02, p.floor), (x, -0.4, p.height), 0.025, STEEL)
    for wall in walls(1.4 * end, 2 * radius + 0.02, middle - 0.25, middle + 0.25)[:2]:
        yield lettering(wall, (0.2, 0.8), (0.1, 0.9), p.band, p.seed)


class Body(NamedTuple):
    """A type of body above the bogies."""

    build: Callable[[TrainParams], Parts]
    freight: bool = False  # painted like goods wagons
    wired: bool = False  # may have a pantograph
    wheel_radius: float = 0.44  # m


_BODIES: dict[str, Body] = {
    "tram": Body(_tram, wired=True, wheel_radius=0.30),
    "railcar": Body(_railcar, wired=True),
    "locomotive": Body(_locomotive, wired=True),
    "hopper": Body(_hopper, freight=True),
    "container": Body(_container, freight=True),
    "tank": Body(_tank, freight=True),
}


FAMILY = Family(
    "train", TrainId.TRAIN, tuple(_KINDS), sample_train, train,
    count=8, size=Size((5, 60), (2, 6)), tone=0.7, line=("building", 0.04),
    facing="road", front="right", stage=FRONTAGE,
)  # fmt: skip
