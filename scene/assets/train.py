"""Trains: trams, railcars, locomotives and wagons that stand on the building line.

Unlike other vehicles the origin is at the base centre of the near side: the near face lies on
y = 0, facing -y, and the body extends to y > 0.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, block, loft, merge, translate
from scene.assets._palette import AMBER, BLACK, GLASS, HEADLAMP, STEEL, TAILLAMP, TRIM, darker, pick
from scene.assets._vehicle import Walls, axle, hull, lamps, panel, rod, walls, window_row


class TrainParams(NamedTuple):
    """One vehicle on rails; metres."""

    body: str  # "tram", "railcar", "locomotive", "hopper" or "container"
    length: float
    width: float
    height: float
    floor: float  # lower edge of the body
    sections: int
    rake: float  # m that the roof is set back at the ends
    color: Color = (0.3, 0.02, 0.02)
    band: Color = (0.6, 0.6, 0.6)
    pantograph: bool = True


_MODELS: dict[str, TrainParams] = {
    "tram": TrainParams("tram", 18.0, 2.40, 3.40, 0.25, 3, 0.7),
    "commuter": TrainParams("railcar", 19.5, 2.80, 3.85, 0.95, 2, 0.45),
    "locomotive": TrainParams("locomotive", 15.0, 2.85, 3.95, 1.00, 1, 0.5),
    "goods wagon": TrainParams("hopper", 12.5, 2.75, 3.50, 1.10, 1, 0.0),
    "container wagon": TrainParams("container", 14.0, 2.50, 3.75, 1.15, 1, 0.0),
    "old tram": TrainParams("tram", 11.5, 2.25, 3.30, 0.45, 1, 0.15),
}
KINDS: tuple[str, ...] = tuple(_MODELS)
"""Vehicle types."""

_LIVERIES: tuple[Color, ...] = (
    (0.36, 0.016, 0.018),  # red
    (0.50, 0.30, 0.025),  # yellow
    (0.025, 0.08, 0.25),  # blue
    (0.03, 0.15, 0.07),  # green
    (0.60, 0.60, 0.58),  # white
    (0.33, 0.34, 0.35),  # silver
)
_FREIGHT: tuple[Color, ...] = (
    (0.14, 0.055, 0.03),  # rust
    (0.16, 0.16, 0.165),  # grey
    (0.04, 0.09, 0.18),  # blue
    (0.05, 0.11, 0.06),  # green
    (0.36, 0.12, 0.02),  # orange
)


def sample_train(rng: np.random.Generator, kind: str) -> TrainParams:
    """Draw a vehicle of one type: length within 6 %, height within 2 %, livery."""
    model = _MODELS[kind]
    freight = model.body in ("hopper", "container")
    color = pick(rng, _FREIGHT if freight else _LIVERIES)
    return model._replace(
        length=model.length * rng.uniform(0.94, 1.06),
        height=model.height * rng.uniform(0.98, 1.02),
        color=color,
        band=pick(rng, _FREIGHT if freight else (*_LIVERIES, TRIM, (0.62, 0.62, 0.60))),
        pantograph=bool(rng.random() < 0.8),
    )


def train(params: TrainParams) -> Asset:
    """The vehicle of ``params`` along x, its near face on y = 0."""
    p = params
    parts = [*_bogies(p), *_BODIES[p.body](p)]
    if p.pantograph and p.body in ("tram", "railcar", "locomotive"):
        parts += _pantograph(p)
    return translate(merge(*parts), (0, p.width / 2 + 0.04, 0))


def _bogies(p: TrainParams) -> list[Asset]:
    """Two bogies of two axles, and the dark frame between them."""
    radius = 0.30 if p.body == "tram" else 0.44
    half = p.width / 2 - 0.12
    parts = []
    for middle in (-0.33 * p.length, 0.33 * p.length):
        for x in (middle - 0.95, middle + 0.95):
            parts.append(axle(x, half, radius, 0.14, None, sides=8))
        low, high = (
            (middle - 1.5, -half - 0.03, radius),
            (middle + 1.5, half + 0.03, p.floor + 0.02),
        )
        if p.floor > radius + 0.1:
            parts.append(block((low[0], low[1], radius + 0.05), high, BLACK, "metal"))
    if p.floor > 0.8:
        corner = (0.18 * p.length, p.width / 2 - 0.25, p.floor)
        parts.append(block((-corner[0], -corner[1], 0.35), corner, TRIM, "metal"))
    return parts


def _pantograph(p: TrainParams) -> list[Asset]:
    """A bent arm and its contact bar on the roof."""
    top, x = p.height, 0.12 * p.length
    elbow, head = (x - 0.7, 0.0, top + 0.55), (x + 0.25, 0.0, top + 1.1)
    bar = [(head[0], y, head[2]) for y in (-0.75, 0.75)]
    return [
        block((x - 0.6, -0.5, top - 0.02), (x + 0.6, 0.5, top + 0.16), TRIM),
        rod((x + 0.3, 0, top), elbow, 0.035, STEEL),
        rod(elbow, head, 0.03, STEEL),
        rod(bar[0], bar[1], 0.03, STEEL),
    ]


def _face(wall: np.ndarray, rake: float) -> np.ndarray:
    """An end wall whose top is set back towards the middle."""
    leaning = wall.copy()
    leaning[2:, 0] -= np.sign(leaning[2:, 0]) * rake
    return leaning


def _cab_ends(p: TrainParams, side: Walls, glass: tuple[float, float]) -> list[Asset]:
    """Windscreens, lamps and a destination board at either end."""
    parts = []
    for wall, lamp in ((side.front, HEADLAMP), (side.rear, TAILLAMP)):
        face = _face(wall, p.rake)
        parts += [
            panel(face, (0.08, 0.92), glass, GLASS, "glass"),
            panel(face, (0, 1), (0, 0.1), TRIM),
            lamps(face, (0.08, 0.22), (0.18, 0.25), lamp),
            panel(face, (0.25, 0.75), (glass[1] + 0.015, glass[1] + 0.07), AMBER, lift=0.02),
        ]
    return parts


def _passenger(p: TrainParams, bays: int, doors: int, glass: tuple[float, float]) -> list[Asset]:
    """Sections with a continuous dark window band, doors, a coloured band and cab ends."""
    side = walls(p.length, p.width, p.floor, p.height)
    inset = (p.rake + 0.2) / p.length
    parts = [
        hull(
            p.length, p.width, p.floor, p.height, p.color,
            nose=p.rake, tail=p.rake, chamfer=0.25,
        )
    ]  # fmt: skip
    parts += _cab_ends(p, side, (glass[0] - 0.03, glass[1]))
    for wall in side[:2]:
        parts.append(window_row(wall, bays, (inset, 1 - inset), glass, 0.1))
        parts.append(panel(wall, (0, 1), (0.05, 0.2), p.band))
        for share in (np.arange(doors) + 0.5) / doors:
            u = share - 0.7 / p.length, share + 0.7 / p.length
            parts.append(panel(wall, u, (0.02, glass[1] + 0.03), p.band, "paint", lift=0.025))
            for leaf in ((u[0] + 0.008, share - 0.003), (share + 0.003, u[1] - 0.008)):
                parts.append(panel(wall, leaf, (0.3, glass[1]), GLASS, "glass", lift=0.035))
    for joint in np.linspace(-0.5, 0.5, p.sections + 1)[1:-1] * p.length:
        low, high = (
            (joint - 0.3, -p.width / 2 - 0.03, p.floor),
            (joint + 0.3, p.width / 2 + 0.03, 0),
        )
        parts.append(block(low, (high[0], high[1], p.height - 0.2), BLACK))
    return parts


def _tram(p: TrainParams) -> list[Asset]:
    return _passenger(
        p, 3 * p.sections + 3 * (p.sections == 1), max(2, p.sections + 1), (0.36, 0.82)
    )


def _railcar(p: TrainParams) -> list[Asset]:
    return _passenger(p, 9, 4, (0.42, 0.78))


def _locomotive(p: TrainParams) -> list[Asset]:
    side = walls(p.length, p.width, p.floor, p.height)
    parts = [
        hull(
            p.length, p.width, p.floor, p.height, p.color,
            nose=p.rake, tail=p.rake, chamfer=0.3,
        )
    ]  # fmt: skip
    parts += _cab_ends(p, side, (0.52, 0.84))
    for wall in side[:2]:
        parts.append(panel(wall, (0, 1), (0.06, 0.22), p.band))
        for u in ((0.06, 0.11), (0.89, 0.94)):
            parts.append(panel(wall, u, (0.52, 0.84), GLASS, "glass"))
        for start in (0.2, 0.36, 0.52, 0.68):  # ventilation grilles
            parts.append(panel(wall, (start, start + 0.12), (0.55, 0.82), TRIM, "metal"))
    reach = p.length / 2 + 0.4
    return parts + [  # buffers, one bar through the length for a pair
        block((-reach, y - 0.16, 0.9), (reach, y + 0.16, 1.2), TRIM) for y in (-0.88, 0.88)
    ]


def _hopper(p: TrainParams) -> list[Asset]:
    """An open wagon with ribs, narrower below, heaped with ballast or coal."""
    half, end = p.width / 2, p.length / 2 - 0.4
    plan = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
    rings = [
        plan * [end * long, half * wide, 0] + [0, 0, z]
        for long, wide, z in (
            (0.8, 0.6, p.floor - 0.2),
            (1, 0.97, p.floor + 0.9),
            (1, 0.97, p.height),
        )
    ]
    heap = [rings[2] - [0, 0, 0.05], plan * [0.7 * end, 0.3 * half, 0] + [0, 0, p.height + 0.35]]
    parts = [loft(rings, p.color, "metal"), loft(heap, (0.05, 0.048, 0.045), "concrete")]
    parts.append(block((-p.length / 2, -0.5, 0.85), (p.length / 2, 0.5, 1.1), BLACK, "metal"))
    for wall in walls(2 * end, 0.97 * p.width, p.floor + 0.9, p.height)[:2]:
        for share in np.linspace(0.02, 0.98, 9):  # ribs
            rib = (share - 0.012, share + 0.012)
            parts.append(panel(wall, rib, (0, 1), darker(p.color), "metal"))
    return parts


def _container(p: TrainParams) -> list[Asset]:
    """Two containers on a flat wagon."""
    half, end = p.width / 2, p.length / 2
    frame = block((-end, -half, p.floor - 0.25), (end, half, p.floor), BLACK, "metal")
    parts = [frame]
    for start, stop, color in ((-end + 0.3, -0.1, p.color), (0.1, end - 0.3, p.band)):
        low, high = (start, -half, p.floor), (stop, half, p.height)
        parts.append(block(low, high, color, "metal"))
        side = walls(stop - start, p.width, p.floor, p.height, x=(start + stop) / 2)
        for wall in side[:2]:
            for share in np.linspace(0.04, 0.96, 9):  # corrugation
                stripe = (share - 0.018, share + 0.018)
                parts.append(panel(wall, stripe, (0.05, 0.95), darker(color), "metal"))
    return parts


_BODIES: dict[str, Callable[[TrainParams], list[Asset]]] = {
    "tram": _tram,
    "railcar": _railcar,
    "locomotive": _locomotive,
    "hopper": _hopper,
    "container": _container,
}
