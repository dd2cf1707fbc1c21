"""Faces and tops of walls: blocks, stones, graffiti, ivy, railings, balusters."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scene.assets.parts.facade import upright
from scene.assets.parts.palette import BLACK, OFF_WHITE, RAILING_IRON, pick
from scene.mesh.asset import Color, Parts, solid, vary
from scene.mesh.solids import box, loft, polygon, tube, turned

RELIEF = 0.05
"""Distance of blocks from the wall behind them, m."""
PAINT = 0.032
"""Distance of bands and graffiti from the wall, m; with less they would flicker from afar."""


class WallParams(NamedTuple):
    """A straight length of wall with coping, piers, and a face and top of some kind."""

    length: float  # along x, m
    height: float  # without the coping, m
    thickness: float  # at the foot, m
    color: Color
    material: str
    second_color: Color  # of the coping, the bands or the joints
    coping: float = 0.0  # height of the coping, m; 0 for none
    ridge: bool = False  # a coping like a roof
    batter: float = 0.0  # m that the near face leans back at the top
    piers: tuple[float, ...] = ()  # x of each pier, as a share of half the length
    ball: bool = False  # on every pier
    plinth: float = 0.0  # height of a darker foot, m; 0 for none
    face: str = ""  # see ``FACES``
    top: str = ""  # see ``TOPS``
    steps: int = 1  # levels of the top along the wall
    seed: int = 0


def _blocks(p: WallParams, rng: np.random.Generator, *, rows: int, width: float) -> Parts:
    """Build courses of stones in uneven lengths and tones, with joints between them."""
    joint, half = 0.012, p.length / 2
    edges = np.linspace(0, p.height, rows + 1)
    for low, high in pairwise(edges):
        x = -half
        while x < half - 0.02:
            right = min(x + width * rng.uniform(0.6, 1.5), half)
            right = half if half - right < 0.3 * width else right
            tone = vary(rng, p.color, 0.35)
            stone = upright(x + joint, right - joint, low + joint, high - joint, 0)
            yield polygon(stone, tone, p.material)
            x = right


def _stones(p: WallParams, rng: np.random.Generator) -> Parts:
    """Build small stones in wire baskets."""
    yield from _blocks(p, rng, rows=11, width=0.16)
    for x in np.linspace(-0.5, 0.5, 4) * (p.length - 0.03):
        yield box((0.03, 0.03, p.height), (x, -0.05, 0), p.second_color, "metal")
    for z in (0.0, p.height / 2 - 0.01, p.height - 0.03):
        yield box((p.length, 0.03, 0.03), (0, -0.11, z), p.second_color, "metal")


def _weep_holes(p: WallParams, rng: np.random.Generator) -> Parts:
    """Build two rows of pipes that drain the ground behind."""
    for z in (0.35, 1.2):
        y = p.batter * z / p.height
        for x in np.linspace(-0.4, 0.4, 4) * p.length:
            yield tube((x, y + 0.02, z), (x, y - 0.05, z), 0.05, p.second_color, "plain", sides=8)


def _graffiti(p: WallParams, rng: np.random.Generator) -> Parts:
    """Build fat, illegible letters in bright paint with dark outlines."""
    paints = ((0.55, 0.05, 0.25), (0.05, 0.35, 0.5), (0.6, 0.45, 0.03), (0.1, 0.4, 0.1),
              OFF_WHITE, (0.3, 0.05, 0.4))  # fmt: skip
    paint = pick(rng, paints, 0.2)
    x, slant = -0.42 * p.length, float(rng.uniform(-0.1, 0.15))
    while x < 0.32 * p.length:
        width, low = float(rng.uniform(0.3, 0.5)), float(rng.uniform(0.25, 0.4))
        high = low + float(rng.uniform(0.8, 1.1))
        for y, grow, color in ((-PAINT, 0.04, BLACK), (-2 * PAINT, 0.0, paint)):
            turn = np.linspace(0, 2 * np.pi, 9)[:-1] + rng.uniform(0, 0.4)
            bow = np.sign(np.cos(turn)) * abs(np.cos(turn)) ** 0.5
            u = x + width / 2 + (width / 2 + grow) * bow
            v = (low + high) / 2 + ((high - low) / 2 + grow) * np.sin(turn)
            shape = np.column_stack([u + slant * np.sin(turn), np.full(8, y), v])
            faces = np.array([[0, k, k + 1] for k in range(1, 7)])
            yield solid(shape, faces, color, "paint")
        hole = (low + high) / 2 + float(rng.uniform(-0.15, 0.15))
        middle = x + width / 2
        eye = upright(middle - 0.05, middle + 0.05, hole, hole + 0.2, -3 * PAINT)
        yield polygon(eye, BLACK, "paint")
        x += width + 0.14  # letters must not share a plane


def _ribs(p: WallParams, rng: np.random.Generator) -> Parts:
    """Build level ribs between steel posts."""
    n = 15
    z = np.linspace(0.02, p.height, 2 * n)
    y = np.where((np.arange(2 * n) // 2) % 2, 0.0, -0.06)
    rings = [
        np.column_stack([np.full(2 * n, x), y - 0.032, z]) for x in (-p.length / 2, p.length / 2)
    ]
    yield loft(np.array(rings), p.color, p.material, closed=False, caps=False)
    for x in (-p.length / 2 + 0.07, 0.0, p.length / 2 - 0.07):
        yield box((0.14, 0.05, p.height + 0.06), (x, -0.125, 0), p.second_color, "metal")


def _bands(p: WallParams, rng: np.random.Generator) -> Parts:
    """Build courses and lozenges in brick of another colour."""
    half, y, middle, r = p.length / 2, -PAINT, 0.5 * p.height, 0.26
    for z in (0.12 * p.height, 0.82 * p.height):
        yield polygon(upright(-half, half, z, z + 0.11, y), p.second_color, p.material)
    for x in np.linspace(-0.375, 0.375, 4) * p.length:
        corners = [(x - r, y, middle), (x, y, middle - r), (x + r, y, middle), (x, y, middle + r)]
        yield polygon(corners, p.second_color, p.material)


def _ivy(p: WallParams, rng: np.random.Generator) -> Parts:
    """Build leaves that hang unevenly from the top."""
    for _ in range(240):
        x = float(rng.uniform(-0.47, 0.47)) * p.length
        reach = p.height * (0.35 + 0.3 * np.sin(3.1 * x + p.seed % 7))
        z, y = p.height - abs(rng.normal(0, 0.5)) * reach, -float(rng.uniform(0.05, 0.1))
        size, turn = float(rng.uniform(0.06, 0.12)), rng.uniform(0, 2 * np.pi)
        angle = turn + np.arange(4) * np.pi / 2
        z = float(np.clip(z, size + 0.02, p.height))
        depth = y + 0.35 * size * np.sin(angle + 1)
        corners = np.column_stack([x + size * np.cos(angle), depth, z + size * np.sin(angle)])
        yield polygon(corners, vary(rng, p.second_color, 0.6), "foliage")


def _profile(p: WallParams, rng: np.random.Generator) -> Parts:
    """Build slots for a fork lift at the foot, and red reflectors."""
    for x in (-0.25 * p.length, 0.25 * p.length):
        yield polygon(upright(x - 0.3, x + 0.3, 0.0, 0.08, -0.04), BLACK)
    y = 0.36 * p.thickness
    for x in (-0.3 * p.length, 0.0, 0.3 * p.length):
        yield box((0.09, 0.04, 0.09), (x, y - 0.02, 0.78 * p.height), p.second_color, "metal")


BuildDetail = Callable[[WallParams, np.random.Generator], Parts]
FACES: dict[str, BuildDetail] = {
    "blocks": partial(_blocks, rows=6, width=0.38), "beams": partial(_blocks, rows=5, width=2.2),
    "stones": _stones, "weep holes": _weep_holes,
    "graffiti": _graffiti, "ribs": _ribs, "bands": _bands, "ivy": _ivy, "profile": _profile,
}  # fmt: skip


def _railings(p: WallParams, rng: np.random.Generator) -> Parts:
    """Build iron railings on the coping."""
    low, middle = p.height + p.coping, p.thickness / 2
    for x in np.arange(-p.length / 2 + 0.3, p.length / 2 - 0.25, 0.13):
        ends = (x, middle, low), (x, middle, low + 0.72)
        yield tube(*ends, 0.013, RAILING_IRON, "paint", end_radius=0.009, sides=4)
    for z in (0.08, 0.58):
        yield box((p.length - 0.4, 0.04, 0.03), (0, middle, low + z), RAILING_IRON, "paint")


def _balusters(p: WallParams, rng: np.random.Generator) -> Parts:
    """Build turned stone balusters under a rail."""
    low, middle = p.height + p.coping, p.thickness / 2
    tiers = ((0.0, 0.07), (0.05, 0.07), (0.08, 0.04), (0.2, 0.085), (0.34, 0.045), (0.4, 0.04),
             (0.43, 0.07), (0.48, 0.07))  # fmt: skip
    yield box((p.length, 0.3, 0.13), (0, middle, low + 0.48), p.second_color, "plaster")
    for x in np.arange(-p.length / 2 + 0.35, p.length / 2 - 0.3, 0.24):
        stations = [(low + z, r) for z, r in tiers]
        yield turned(stations, p.color, p.material, 8, at=(float(x), middle))


def _mound(p: WallParams, rng: np.random.Generator) -> Parts:
    """Build ivy that has grown over the top."""
    turn = np.linspace(0, np.pi, 7)
    y, rings = p.thickness / 2 - (p.thickness / 2 + 0.09) * np.cos(turn), []
    for x in np.linspace(-0.5, 0.5, 12) * p.length:
        z = p.height - 0.02 + float(rng.uniform(0.08, 0.2)) * np.sin(turn)
        rings.append(np.column_stack([np.full(7, x), y, z]))
    yield loft(np.array(rings), p.second_color, "foliage")


TOPS: dict[str, BuildDetail] = {"railings": _railings, "balusters": _balusters, "mound": _mound}
