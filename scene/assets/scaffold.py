"""Scaffolding in front of facades (class building): tubes and decks from y = 0 back towards the wall."""

from __future__ import annotations

from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np

from scene.assets.family import FRONTAGE, Family, Size
from scene.assets.parts.draw import SEED, between, integer, near, sample_fields
from scene.assets.parts.palette import BOARDS, SCAFFOLD_STEEL
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Parts, Point, merge, shade
from scene.mesh.solids import box, polygon, tube

LIFT = 2.0
"""Height of a storey (metres)."""


class ScaffoldParams(NamedTuple):
    """One scaffold; metres."""

    bays: int
    bay: float
    depth: float
    lifts: int
    steel: Color
    boards: Color
    net: Color  # of nets, and of the hoarding
    netted: float  # share of the bays that have a net
    hoarding: bool
    fan: bool
    seed: int


_NETS: tuple[Color, ...] = (
    (0.05, 0.20, 0.10), (0.10, 0.20, 0.36), (0.46, 0.46, 0.44), (0.24, 0.24, 0.23),
)  # fmt: skip
_HOARDINGS: tuple[Color, ...] = ((0.03, 0.10, 0.28), (0.50, 0.50, 0.48), BOARDS)
_SCAFFOLD = ScaffoldParams(3, 2.0, 1.0, 3, SCAFFOLD_STEEL, BOARDS, _NETS[0], 0.0, False, False, 0)
_KINDS: dict[str, dict[str, Any]] = {
    "tubes": {},
    "netted": dict(netted=1.0),
    "over a hoarding": dict(hoarding=True, net=near(0.25, *_HOARDINGS)),
    "with a fan": dict(netted=0.3, fan=True),
    "netted over a hoarding": dict(netted=0.8, hoarding=True, fan=True),
}


def sample_scaffold(rng: np.random.Generator, kind: str) -> ScaffoldParams:
    """Draw a scaffold of one kind."""
    rules = dict(
        bays=integer(3, 6), bay=between(1.8, 2.3), depth=between(0.9, 1.25), lifts=integer(2, 5),
        steel=near(0.3), boards=near(0.3), net=near(0.25, *_NETS), seed=SEED,
    )  # fmt: skip
    return sample_fields(rng, _SCAFFOLD, **{**rules, **_KINDS[kind]})


def scaffold(p: ScaffoldParams) -> Asset:
    """Build the scaffold, centred in x."""
    rng = np.random.default_rng(p.seed)
    x = np.linspace(-p.bays * p.bay / 2, p.bays * p.bay / 2, p.bays + 1).tolist()
    return merge(*_frame(p, x, rng), *_sheets(p, x, rng))


def _frame(p: ScaffoldParams, x: list[float], rng: np.random.Generator) -> Parts:
    """Build posts at ``x``, tubes, decks with toe boards, and braces."""
    length, top = p.bays * p.bay, p.lifts * LIFT

    def rod(a: Point, b: Point) -> Asset:
        return tube(a, b, 0.03, p.steel, "metal", sides=5, caps=False)

    for post_x, y in product(x, (0.05, p.depth)):
        yield rod((post_x, y, 0), (post_x, y, top + 1.1))
        yield box((0.16, 0.1, 0.02), (post_x, y, 0), p.steel)
    end, width = length / 2 + 0.2, p.depth / 4
    for z in LIFT * np.arange(1.0, p.lifts + 1):
        for y, level in ((0.05, z - 0.06), (p.depth, z - 0.06), (0.02, z + 0.5), (0.02, z + 1.0)):
            yield rod((-end, y, level), (end, y, level))
        for post_x in x:
            yield rod((post_x, -0.05, z - 0.1), (post_x, p.depth + 0.05, z - 0.1))
        for k in range(4):
            place = (0, 0.05 + (k + 0.5) * width, z)
            deck = box((length, 0.92 * width, 0.04), place, p.boards, "wood")
            yield shade(deck, np.full(12, rng.uniform(0.8, 1.2)))
        yield box((length, 0.03, 0.16), (0, 0.09, z + 0.04), p.boards, "wood")
    for k, lift in product(range(0, p.bays, 2), range(p.lifts)):
        yield rod((x[k], -0.02, max(lift * LIFT, 0.05)), (x[k + 1], -0.02, (lift + 1) * LIFT))


def _sheets(p: ScaffoldParams, x: list[float], rng: np.random.Generator) -> Parts:
    """Build nets over bays, a hoarding around the foot, and a fan that catches falling objects."""
    first = 1 if p.hoarding or p.fan else 0
    for k in range(p.bays):
        for lift in range(first, p.lifts):
            if rng.random() >= p.netted:
                continue
            low, high = lift * LIFT + 0.1, (lift + 1) * LIFT + 0.06
            sag = float(rng.uniform(0.0, 0.06))
            a, b = x[k] + 0.04, x[k + 1] - 0.04
            corners = [(a, -0.07, low), (b, -0.07 - sag, low), (b, -0.07, high), (a, -0.07, high)]
            net = polygon(corners, p.net, "plaster")
            yield shade(net, np.full(2, rng.uniform(0.85, 1.15)))
    if p.hoarding:
        size = (0.98 * (x[1] - x[0]), 0.03, LIFT - 0.15)
        for a, b in pairwise(x):
            board = box(size, ((a + b) / 2, -0.08, 0), p.net, "wood")
            yield shade(board, np.full(12, rng.uniform(0.88, 1.12)))
    if p.fan:
        a, b, low, high = x[0], x[-1], LIFT + 0.1, LIFT + 0.75
        fan = [(a, 0.0, low), (b, 0.0, low), (b, -0.85, high), (a, -0.85, high)]
        yield polygon(fan, p.boards, "wood")


FAMILY = Family(
    "scaffold", TrainId.BUILDING, tuple(_KINDS), sample_scaffold, scaffold,
    count=15, size=Size((3, 40), (3, 40)), tone=0.8, line=None, facing="road", front="right",
    stage=FRONTAGE,
)  # fmt: skip
