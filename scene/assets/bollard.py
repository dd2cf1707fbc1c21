"""Bollards and beacons (class pole), low posts along kerbs and on traffic islands."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

from scene.assets.family import FOOTWAY, Family, Size
from scene.assets.parts.draw import near, sampler, times
from scene.assets.parts.palette import BOLLARD_BLUE, BOLLARD_RED, OFF_WHITE, PLATE_YELLOW
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Parts, merge
from scene.mesh.solids import box, tube, turned


class BollardParams(NamedTuple):
    """A post turned around z, or a lit box."""

    height: float  # m
    radius: float  # m, at the foot
    outline: tuple[tuple[float, float], ...]  # shares of height and radius upwards; () a box
    color: Color
    band: Color
    bands: tuple[tuple[float, float], ...]  # from and to, as shares of the height
    material: str
    sides: int = 10


_ROUND = ((0.0, 1.0), (0.93, 1.0), (0.98, 0.75), (1.0, 0.2))
_POST = BollardParams(1.0, 0.055, _ROUND, (0.22, 0.225, 0.23), OFF_WHITE, (), "metal")
_KINDS: dict[str, BollardParams] = {
    "steel": _POST,
    "cast iron": _POST._replace(
        outline=((0.0, 1.5), (0.08, 1.5), (0.1, 1.0), (0.7, 0.72), (0.74, 1.05), (0.79, 0.7),
                 (0.86, 1.0), (0.95, 0.9), (1.0, 0.2)),
        color=(0.02, 0.021, 0.023), material="paint", radius=0.075,
    ),
    "timber": _POST._replace(
        color=(0.12, 0.09, 0.065), material="wood", radius=0.1, sides=4,
        outline=((0.0, 1.0), (0.9, 1.0), (1.0, 0.6)),
    ),
    "concrete": _POST._replace(
        color=(0.28, 0.27, 0.25), material="concrete", radius=0.15, height=0.8,
        outline=((0.0, 1.0), (0.8, 0.85), (1.0, 0.5)),
    ),
    "flexible": _POST._replace(
        color=(0.55, 0.14, 0.02), radius=0.045, material="rubber", height=0.85,
        bands=((0.55, 0.68), (0.78, 0.91)), outline=((0.0, 2.0), (0.06, 1.8), (0.08, 1.0), (1.0, 1.0)),
    ),
    "keep left beacon": _POST._replace(
        outline=(), color=OFF_WHITE, band=PLATE_YELLOW, radius=0.17, height=1.1, material="lamp"
    ),
    "yellow beacon": _POST._replace(
        outline=(), color=PLATE_YELLOW, band=OFF_WHITE, radius=0.16, height=1.0, material="lamp"
    ),
    "banded": _POST._replace(
        color=BOLLARD_RED, bands=((0.2, 0.4), (0.6, 0.8)), material="paint", radius=0.05, height=1.1
    ),
}  # fmt: skip
BEACONS: tuple[str, ...] = tuple(name for name, p in _KINDS.items() if not p.outline)
"""Kinds that stand on traffic islands."""
POSTS: tuple[str, ...] = tuple(name for name in _KINDS if name not in BEACONS)


def bollard(p: BollardParams) -> Asset:
    """Build the bollard."""
    if not p.outline:
        return merge(*_beacon(p))
    around = partial(turned, material=p.material, sides=p.sides, phase=0.5)
    post = around([(z * p.height, r * p.radius) for z, r in p.outline], p.color)
    r = 1.06 * p.radius  # bands are slightly wider than the post
    bands = [around([(low * p.height, r), (high * p.height, r)], p.band) for low, high in p.bands]
    return merge(post, *bands)


def _beacon(p: BollardParams) -> Parts:
    """Build a lit box on a dark foot, with a round blue sign towards the traffic on both sides."""
    depth, width, h = 1.5 * p.radius, 2 * p.radius, p.height
    yield box((1.15 * depth, 1.15 * width, 0.12 * h), (0, 0, 0), (0.05, 0.05, 0.05), "rubber")
    yield box((depth, width, 0.5 * h), (0, 0, 0.12 * h), p.color, p.material)
    yield box((depth, width, 0.38 * h), (0, 0, 0.62 * h), p.band, p.material)
    z, r = 0.8 * h, 0.8 * p.radius
    for s in (-1, 1):
        ends = (s * depth / 2, 0, z), (s * (depth / 2 + 0.012), 0, z)
        yield tube(*ends, r, BOLLARD_BLUE, "paint", sides=14)
    for s in (-1, 1):
        foot = (s * (depth / 2 + 0.015), 0, z - 0.55 * r)
        yield box((0.004, 0.25 * r, 1.1 * r), foot, OFF_WHITE, "paint")


FAMILY = Family(
    "bollard", TrainId.POLE, tuple(_KINDS),
    sampler(_KINDS, height=times(0.88, 1.15), radius=times(0.85, 1.25), color=near(0.25), band=near(0.2)),
    bollard,
    count=16, size=Size((0.4, 2), (0.4, 2)), tone=1.0, line=None, stage=FOOTWAY,
)  # fmt: skip
