"""Street lamps and telegraph poles (class pole) whose arms reach over the road (-y)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from scene.assets.family import Family, Size
from scene.assets.parts.draw import near, sample_fields, times
from scene.assets.parts.palette import (
    GLOW,
    LAMP_CONCRETE,
    LAMP_GREEN,
    LAMP_IRON,
    LAMP_STEEL,
    LAMP_TIMBER,
)
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Parts, merge
from scene.mesh.solids import box, loft, tube, turned


class LampParams(NamedTuple):
    """A tapering column in a base sleeve, arms from its top, and one kind of head."""

    height: float  # of the column, m
    radius: float  # at the foot, m
    foot: float  # height of the thicker foot, m; 0 for none
    arms: tuple[float, ...]  # y of each arm's end, m
    rise: float  # of the arm's end above its start, m
    bend: float  # 0 a straight arm .. 1 an arm that leaves the column upright
    head: str  # see ``_HEADS``; at the end of every arm, or on the column without arms
    head_size: float  # m, see the function of the head
    color: Color
    material: str
    below: float = 0.0  # m from the top down to the arms
    rings: int = 0  # collars around the column
    stay: bool = False  # a rod from the column to the arm
    box: bool = False  # a fuse box or a poster at eye level
    spread: float = 0.12  # of the height within the kind, as a share


_COLUMN = LampParams(7.4, 0.09, 1.2, (-1.4,), 0.2, 0.0, "tray", 0.75, LAMP_STEEL, "metal")
_IRON = _COLUMN._replace(color=LAMP_IRON, material="paint", arms=(), rise=0.0, foot=0.9)
_POLE = _COLUMN._replace(color=LAMP_TIMBER, material="bark", arms=(), foot=0.0, radius=0.12, height=8.0,
                        spread=0.08)  # fmt: skip
_KINDS: dict[str, LampParams] = {
    "arm": _COLUMN,
    "swan neck": _COLUMN._replace(bend=1.0, rise=1.0, height=6.6, arms=(-1.8,), spread=0.1),
    "double": _COLUMN._replace(arms=(-1.5, 1.5), bend=0.5, rise=0.5, height=7.8, spread=0.08),
    "lantern": _IRON._replace(height=3.9, head="lantern", head_size=0.7, rings=3),
    "telegraph": _POLE._replace(head="crossbars", head_size=1.6),
    "globe": _IRON._replace(height=4.2, head="globe", head_size=0.48, color=LAMP_STEEL, spread=0.1),
    "led blade": _COLUMN._replace(head="blade", head_size=0.85, arms=(-0.5,), rise=0.05, radius=0.075,
                                 foot=0.0, color=(0.05, 0.052, 0.056), spread=0.15),
    "heritage bracket": _IRON._replace(height=5.6, head="bell", head_size=0.5, arms=(-0.9,), rise=0.25,
                                       bend=1.0, below=0.35, stay=True, rings=2, color=LAMP_GREEN,
                                       spread=0.08),
    "concrete": _COLUMN._replace(color=LAMP_CONCRETE, material="concrete", radius=0.13, foot=1.6, bend=0.9,
                                rise=0.7, arms=(-1.2,), head_size=0.6, height=6.8, spread=0.08),
    "post top": _IRON._replace(height=4.8, head="disc", head_size=0.62, foot=0.0,
                               color=(0.06, 0.062, 0.066)),
    "telephone": _POLE._replace(head="drop wires", head_size=0.5, box=True, height=7.2),
    "twin lantern": _IRON._replace(height=4.5, head="lantern", head_size=0.6, arms=(-0.65, 0.65),
                                   rise=0.2, bend=1.0, below=0.3, rings=3, spread=0.06),
    "catenary mast": _COLUMN._replace(height=7.6, radius=0.13, arms=(-2.6,), rise=0.35,
                                     head="insulator", head_size=0.3, below=1.0, stay=True, foot=0.6,
                                     color=(0.075, 0.085, 0.08), spread=0.06),
    "floodlight": _COLUMN._replace(height=8.6, radius=0.13, arms=(), head="flood", head_size=1.5,
                                  spread=0.04),
    "bollard": _IRON._replace(height=1.0, radius=0.09, foot=0.0, head="louvre", head_size=0.28,
                              color=(0.045, 0.046, 0.05), spread=0.15),
    "camera pole": _COLUMN._replace(height=5.4, radius=0.1, foot=1.6, arms=(-0.7,), rise=0.0, below=0.4,
                                   head="camera", head_size=0.4, box=True, color=(0.13, 0.135, 0.14)),
}  # fmt: skip


def sample_lamp(rng: np.random.Generator, kind: str) -> LampParams:
    """Draw a lamp of one kind."""
    p = _KINDS[kind]
    return sample_fields(
        rng, p, height=times(1 - p.spread, 1 + p.spread), radius=times(0.9, 1.1),
        arms=times(0.85, 1.1), rise=times(0.85, 1.1), head_size=times(0.9, 1.15), color=near(0.3),
    )  # fmt: skip


def _pipe(points: np.ndarray, radius: float, p: LampParams, sides: int = 6) -> Asset:
    """Build a bent pipe in the plane x = 0 through ``points`` (y, z)."""
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    turn = np.arange(sides) * 2 * np.pi / sides
    across, up = radius * np.cos(turn), radius * np.sin(turn)
    rings = [
        np.column_stack([across, y - up * dz, z + up * dy])
        for (y, z), (dy, dz) in zip(points, along, strict=True)
    ]
    return loft(np.array(rings), p.color, p.material)


def _arm(p: LampParams, reach: float) -> tuple[list[Asset], float]:
    """Build a pipe from the column to y = ``reach``; return it with the height of its end."""
    start = p.height - p.below
    t = np.linspace(0, 1, 9 if p.bend else 2)
    y = reach * ((1 - p.bend) * t + p.bend * (1 - np.cos(t * np.pi / 2)))
    z = start + p.rise * ((1 - p.bend) * t + p.bend * np.sin(t * np.pi / 2))
    parts = [_pipe(np.column_stack([y, z]), 0.42 * p.radius, p)]
    if p.stay:
        rod = np.array([(0.0, start + (0.9 if p.bend == 0 else -0.6)), (0.75 * reach, z[-1])])
        parts.append(_pipe(rod, 0.18 * p.radius, p, 4))
    return parts, float(z[-1])


def _housing(p: LampParams, y: float, z: float, side: float, high: float, width: float) -> Parts:
    """Build a flat housing that extends outwards from (y, z), with the lit glass below."""
    n, size = 8, p.head_size
    turn = np.arange(n) * 2 * np.pi / n + np.pi / n
    outline = np.column_stack([0.5 * width * np.cos(turn) * 1.08, 0.5 * size * np.sin(turn) * 1.08])
    centre = y + side * 0.35 * size
    rings = [
        np.column_stack([k * outline[:, 0], centre + k * outline[:, 1], np.full(n, z + dz)])
        for k, dz in ((0.92, -0.5 * high), (1.0, 0.0), (0.6, 0.5 * high))
    ]
    yield loft(np.array(rings), p.color, p.material)
    below = (0, centre + side * 0.1 * size, z - 0.5 * high - 0.03)
    yield box((0.72 * width, 0.6 * size, 0.03), below, GLOW, "lamp")


def _lantern(p: LampParams, y: float, z: float, side: float) -> Parts:
    """Build a four-sided glass that widens upwards under a pointed roof."""
    s = p.head_size
    eaves, radius = z + 0.6 * s, 0.4 * s
    low, high = 0.56 * radius, 1.02 * radius
    yield tube((0, y, z), (0, y, eaves), 0.55 * radius, GLOW, "lamp", end_radius=radius, sides=4)
    for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        ends = (low * a, y + low * b, z), (high * a, y + high * b, eaves)
        yield tube(*ends, 0.02, p.color, p.material, sides=4)
    tiers = [(share, width * radius) for share, width in ((0.0, 1.2), (0.12, 0.75), (0.3, 0.3))]
    tiers += [(0.38, 0.06), (0.46, 0.02)]
    yield turned(
        [(eaves + share * s, r) for share, r in tiers], p.color, p.material, 8, at=(0.0, y)
    )
    if not p.arms:  # a rest for a ladder
        yield box((0.04, 0.7, 0.04), (0, y, z - 0.4), p.color, p.material)


def _globe(p: LampParams, y: float, z: float, side: float) -> Parts:
    r = p.head_size / 2
    level = np.linspace(-0.9, 1.0, 8) * np.pi / 2
    ball = [(z + r + r * np.sin(a), max(r * np.cos(a), 0.01)) for a in level]
    yield turned(ball, GLOW, "lamp", 12, at=(0.0, y))
    yield turned([(z - 0.06, 0.07), (z + 0.06, 0.13)], p.color, p.material, at=(0.0, y))


def _bell(p: LampParams, y: float, z: float, side: float) -> Parts:
    """Build a hanging bell with glass below."""
    s = p.head_size
    bell = [(z - 0.62 * s, 0.5 * s), (z - 0.4 * s, 0.42 * s), (z - 0.22 * s, 0.2 * s), (z, 0.05)]
    glass = [(z - 0.85 * s, 0.05), (z - 0.76 * s, 0.26 * s), (z - 0.6 * s, 0.36 * s)]
    yield turned(bell, p.color, p.material, 12, at=(0.0, y))
    yield turned(glass, GLOW, "lamp", 12, at=(0.0, y))


def _disc(p: LampParams, y: float, z: float, side: float) -> Parts:
    """Build a flat hat on a short clear cylinder."""
    r = p.head_size / 2
    hat = [(z + 0.3, r), (z + 0.34, r), (z + 0.42, 0.3 * r)]
    yield turned([(z, 0.4 * r), (z + 0.3, 0.5 * r)], GLOW, "lamp", 10, at=(0.0, y))
    yield turned(hat, p.color, p.material, 14, at=(0.0, y))


def _louvre(p: LampParams, y: float, z: float, side: float) -> Parts:
    """Build rings around a low light."""
    r, step = 1.15 * p.radius, p.head_size / 4
    yield turned([(z, 0.8 * r), (z + 4 * step, 0.8 * r)], GLOW, "lamp", at=(0.0, y))
    for k in range(1, 5):
        edges = [(z + k * step, r), (z + (k + 0.45) * step, r)]
        yield turned(edges, p.color, p.material, at=(0.0, y))


def _insulator(p: LampParams, y: float, z: float, side: float) -> Parts:
    """Build the holder of a contact wire: a strut and a ribbed insulator."""
    ribs = [(z - 0.05 * k, 0.07 if k % 2 else 0.04) for k in range(7)][::-1]
    yield turned(ribs, (0.12, 0.05, 0.03), "paint", at=(0.0, y))
    yield box((0.05, 0.5, 0.05), (0, y - 0.25 * side, z - 0.4), p.color, p.material)


def _flood(p: LampParams, y: float, z: float, side: float) -> Parts:
    """Build four floodlights on a bar."""
    s = p.head_size
    yield box((0.1, p.head_size, 0.1), (0, 0, z), p.color, p.material)
    for share in (-0.42, -0.15, 0.15, 0.42):
        yield box((0.2, 0.24 * s, 0.3), (-0.1, share * s, z + 0.1), p.color, p.material)
        yield box((0.02, 0.2 * s, 0.24), (-0.21, share * s, z + 0.13), GLOW, "lamp")


def _camera(p: LampParams, y: float, z: float, side: float) -> Parts:
    """Build two cameras and a dome."""
    white = (0.5, 0.5, 0.49)
    dome = [(z - 0.34, 0.03), (z - 0.28, 0.12), (z - 0.16, 0.15), (z, 0.14)]
    yield turned(dome, (0.03, 0.03, 0.035), "glass", at=(0.0, y))
    for share in (0.35, 0.75):
        yield box((0.42, 0.14, 0.14), (-0.1, share * y, z + 0.05), white, "paint")


def _crossbars(p: LampParams, y: float, z: float, side: float) -> Parts:
    """Build two crossbars with insulators, and a transformer below them."""
    yield tube((0.22, 0, z - 1.9), (0.22, 0, z - 1.25), 0.2, (0.12, 0.125, 0.13), "metal", sides=10)
    for low in (z - 0.35, z - 0.95):
        yield box((0.1, p.head_size, 0.12), (0.1, 0, low), p.color, "wood")
        for insulator_y in np.array([-0.46, -0.2, 0.2, 0.46]) * p.head_size:
            bell = [(low + 0.12, 0.03), (low + 0.17, 0.05), (low + 0.25, 0.045), (low + 0.3, 0.02)]
            yield turned(bell, (0.4, 0.4, 0.38), "paint", 6, at=(0.0, float(insulator_y)))


def _drop_wires(p: LampParams, y: float, z: float, side: float) -> Parts:
    """Build a ring for wires, steps up both sides, and a box."""
    yield turned([(z - 0.3, 0.22), (z - 0.24, 0.22)], p.color, "metal", 8)
    for level in np.arange(2.6, z - 0.6, 0.45):
        yield box((0.03, 0.34, 0.03), (0, 0, level), (0.1, 0.1, 0.1), "metal")
    yield box((0.22, 0.2, 0.3), (0.14, 0, z - 1.1), (0.03, 0.03, 0.03))


_HEADS: dict[str, Callable[[LampParams, float, float, float], Parts]] = {
    "tray": partial(_housing, high=0.17, width=0.3), "blade": partial(_housing, high=0.06, width=0.36),
    "lantern": _lantern, "globe": _globe, "bell": _bell, "disc": _disc,
    "louvre": _louvre, "insulator": _insulator, "flood": _flood,
    "camera": _camera, "crossbars": _crossbars, "drop wires": _drop_wires,
}  # fmt: skip


def lamp(p: LampParams) -> Asset:
    """Build the lamp."""
    r = p.radius
    column = [(0.0, r), (0.5 * p.height, 0.82 * r), (p.height, 0.6 * r)]
    parts = [turned(column, p.color, p.material)]
    if p.foot:
        foot = [(0.0, 1.7 * r), (0.08, 1.7 * r), (0.12, 1.45 * r), (0.9 * p.foot, 1.4 * r),
                (p.foot, r)]  # fmt: skip
        parts.append(turned(foot, p.color, p.material))
    for z in np.linspace(p.foot, p.height, p.rings + 2)[1:-1]:
        bead = [(z - 0.06, 0.9 * r), (z, 1.35 * r), (z + 0.06, 0.9 * r)]
        parts.append(turned(bead, p.color, p.material))
    if p.box:
        parts.append(box((0.12, 0.26, 0.42), (-r - 0.05, 0, 1.35), (0.3, 0.3, 0.29), "paint"))
    for reach in p.arms:
        pipes, end = _arm(p, reach)
        parts += pipes
        parts += _HEADS[p.head](p, reach, end, float(np.sign(reach)))
    if not p.arms:
        parts += _HEADS[p.head](p, 0.0, p.height, 1.0)
    return merge(*parts)


FAMILY = Family(
    "lamp", TrainId.POLE, tuple(_KINDS), sample_lamp, lamp,
    count=16, size=Size((2, 18), (2, 18)), tone=2.1, line=("pole", 0.4),
    facing="road",
)  # fmt: skip
