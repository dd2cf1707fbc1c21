"""Street lamps and telegraph poles (class pole); arms reach over the road (-y)."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, Point, box, merge, tube, vary

KINDS: tuple[str, ...] = ("arm", "curved", "double", "lantern", "telegraph", "globe")

GLOW: Color = (0.75, 0.72, 0.6)
"""Lamp glass by day."""


class LampParams(NamedTuple):
    """A tapering column, arms that leave its top, and one sort of head."""

    height: float  # of the column, m
    radius: float  # at the foot, m
    foot: float  # height of the thicker foot, m
    arms: tuple[float, ...]  # y reached by each arm, m
    rise: float  # of the arm's end over the column's top, m
    bend: float  # 0 a straight arm .. 1 one that leaves the column upright
    head: str  # "tray", "lantern", "globe" or "crossbars"
    head_size: float  # length of a tray, height of a lantern, diameter of a globe, m
    color: Color
    material: str


def sample_lamp(rng: np.random.Generator, kind: str) -> LampParams:
    """Draw a lamp of one of ``KINDS``."""
    steels = ((0.30, 0.31, 0.32), (0.20, 0.22, 0.21), (0.33, 0.31, 0.28), (0.10, 0.11, 0.11))
    steel = vary(rng, steels[rng.integers(len(steels))], 0.2)
    cast = vary(rng, ((0.02, 0.02, 0.025), (0.02, 0.06, 0.04))[rng.integers(2)], 0.3)
    arm = LampParams(
        height=float(rng.uniform(6.5, 8.6)), radius=float(rng.uniform(0.07, 0.10)), foot=1.2,
        arms=(-float(rng.uniform(0.9, 2.0)),), rise=float(rng.uniform(0.1, 0.35)), bend=0.0,
        head="tray", head_size=float(rng.uniform(0.6, 0.9)), color=steel, material="metal",
    )  # fmt: skip
    match kind:
        case "arm":
            return arm
        case "curved":
            rise = float(rng.uniform(0.8, 1.0))
            return arm._replace(bend=1.0, height=arm.height - 0.8, rise=rise)
        case "double":
            return arm._replace(arms=(arm.arms[0], -arm.arms[0]), bend=float(rng.uniform(0, 0.6)))
        case "lantern":
            return arm._replace(
                height=float(rng.uniform(3.4, 4.4)), arms=(), head="lantern", foot=0.9,
                radius=0.08, head_size=float(rng.uniform(0.55, 0.75)), color=cast,
                material="paint",
            )  # fmt: skip
        case "telegraph":
            return arm._replace(
                height=float(rng.uniform(7.0, 8.8)), radius=float(rng.uniform(0.10, 0.12)),
                arms=(), head="crossbars", foot=0.0, material="bark",
                head_size=float(rng.uniform(1.2, 1.8)), color=vary(rng, (0.13, 0.09, 0.06), 0.25),
            )  # fmt: skip
        case "globe":
            return arm._replace(
                height=float(rng.uniform(3.6, 5.0)), arms=(), head="globe",
                head_size=float(rng.uniform(0.4, 0.55)),
                color=steel if rng.random() < 0.5 else cast,
            )  # fmt: skip
    raise ValueError(f"unknown kind of lamp {kind!r}; known: {', '.join(KINDS)}")


def _arm(params: LampParams, reach: float) -> list[Asset]:
    """A bent tube from the column's top to ``reach``, and the tray at its end."""
    p = params
    t = np.linspace(0, 1, 4 if p.bend else 2)
    straight, arc = t, np.sin(t * np.pi / 2)
    y = reach * ((1 - p.bend) * straight + p.bend * (1 - np.cos(t * np.pi / 2)))
    z = p.height + p.rise * ((1 - p.bend) * straight + p.bend * arc)
    points: list[Point] = [(0.0, float(a), float(b)) for a, b in zip(y, z, strict=True)]
    tubes = [
        tube(a, b, 0.5 * p.radius, p.color, p.material, sides=4, caps=False)
        for a, b in pairwise(points)
    ]
    side = np.sign(reach)
    centre, top = y[-1] + side * 0.3 * p.head_size, z[-1]
    tray = box((0.28, p.head_size, 0.12), (0, centre, top - 0.06), p.color, p.material)
    glass = box((0.22, 0.7 * p.head_size, 0.06), (0, centre, top - 0.12), GLOW, "lamp")
    return [*tubes, tray, glass]


def _lantern(params: LampParams) -> list[Asset]:
    """A four-sided glass that widens upwards under a pointed roof."""
    p, size = params, params.head_size
    base, eaves, top = p.height, p.height + 0.65 * size, p.height + size
    wide = 0.42 * size
    return [
        tube((0, 0, base), (0, 0, eaves), 0.5 * wide, GLOW, "lamp", end_radius=wide, sides=4),
        tube((0, 0, eaves), (0, 0, top), 1.15 * wide, p.color, p.material, end_radius=0.05,
             sides=4),
        box((0.7, 0.04, 0.04), (0, 0, base - 0.35), p.color, p.material),
    ]  # fmt: skip


def _globe(params: LampParams) -> list[Asset]:
    p, r = params, params.head_size / 2
    levels = p.height + r * np.array([0.0, 0.6, 1.4, 2.0])
    radii = r * np.array([0.45, 1.0, 1.0, 0.4])
    return [
        tube((0, 0, levels[i]), (0, 0, levels[i + 1]), radii[i], GLOW, "lamp",
             end_radius=radii[i + 1], sides=6, caps=i == 2)
        for i in range(3)
    ]  # fmt: skip


def _crossbars(params: LampParams) -> list[Asset]:
    """Two crossbars with insulators."""
    p = params
    parts = []
    for z in (p.height - 0.35, p.height - 0.95):
        parts.append(box((0.1, p.head_size, 0.12), (0.1, 0, z), p.color, "wood"))
        for y in np.array([-0.45, 0.45]) * p.head_size:
            parts.append(box((0.07, 0.07, 0.16), (0.1, y, z + 0.12), (0.5, 0.5, 0.48), "paint"))
    return parts


def lamp(params: LampParams) -> Asset:
    """Build the lamp."""
    p = params
    column = tube((0, 0, 0), (0, 0, p.height), p.radius, p.color, p.material,
                  end_radius=0.65 * p.radius, sides=6, caps=False)  # fmt: skip
    parts = [column]
    if p.foot:
        foot = tube((0, 0, 0), (0, 0, p.foot), 1.5 * p.radius, p.color, p.material,
                    end_radius=0.95 * p.radius, sides=6, caps=False)  # fmt: skip
        parts.append(foot)
    for reach in p.arms:
        parts += _arm(p, reach)
    heads = {"lantern": _lantern, "globe": _globe, "crossbars": _crossbars}
    if p.head in heads:
        parts += heads[p.head](p)
    return merge(*parts)
