"""A roadside without houses: a park, water or a field up to the background, which closes the horizon."""

from __future__ import annotations

import math

import numpy as np

from scene.assets.catalogue import draw_in_season
from scene.assets.paving import PATH
from scene.street.background import BEHIND
from scene.street.parked import kept_free
from scene.street.plot import LINE_END, LINE_START, Plot, draw_kind
from scene.street.rows import carpet, run

KINDS = {"park": 0.5, "water": 0.22, "field": 0.28}
"""Kinds of open sides."""
STEEP = 2.0
"""Slope in per cent above which there is no water along the road."""
ROUNDING = 1e-6
"""Tolerance of this slope in per cent, since attributes come from unit values in single precision."""
REACH = BEHIND - 2.0
"""Outer edge of an open side, metres from the centre line."""
RAILINGS = ("spear railings", "rails", "pedestrian guard", "bow top", "cross rails", "chain link",
            "bollard and chain", "wires")  # fmt: skip
LOW_WALLS = ("piered", "railing top", "balustrade", "rubble stone", "sleepers")
HEDGES = ("hedge", "beech hedge", "laurel")
AREA = {"park": 75.0, "water": 30.0, "field": 500.0}
"""Square metres for each tree."""
SPAN = (LINE_START, LINE_END)


def open_side(plot: Plot, side: float, rng: np.random.Generator) -> None:
    """Fill one open side of the road."""
    shares = np.array(list(KINDS.values()))
    if plot.street.params.gradient > STEEP + ROUNDING:
        shares[list(KINDS).index("water")] = 0
    kind = str(rng.choice(list(KINDS), p=shares / shares.sum()))
    edge = plot.ground.outer + 0.35
    match kind:
        case "park":
            _boundary(plot, side, edge, 0.7, rng)
            _paths(plot, side, rng)
        case "water":
            bank = edge + float(rng.uniform(0.3, 4.0))
            _boundary(plot, side, edge, 1.0, rng)
            ref = draw_kind(plot.street.pool, "land", ("water", "green water"), rng)
            carpet(plot, "land", ref, (SPAN[0], 190.0), (bank, REACH), side)
            if bank - edge > 2.0:
                _trees(plot, side, (edge + 0.8, bank - 0.5), AREA[kind], rng)
            return
        case _:
            _boundary(plot, side, edge, 0.8, rng)
            ref = draw_kind(
                plot.street.pool, "land", ("ploughed", "crop", "stubble", "meadow"), rng
            )
            carpet(plot, "land", ref, (SPAN[0], 190.0), (edge + 1.0, REACH), side)
            run(
                plot,
                "bush",
                draw_kind(plot.street.pool, "bush", HEDGES, rng),
                side * REACH,
                SPAN,
                [],
            )
    _trees(plot, side, (edge + 1.5, REACH), AREA[kind], rng)


def _boundary(plot: Plot, side: float, edge: float, share: float, rng: np.random.Generator) -> None:
    """Place railings, a low wall or a hedge with gates along the sidewalk, with the probability ``share``."""
    family, kinds = (("fence", RAILINGS), ("wall", LOW_WALLS), ("bush", HEDGES))[
        int(rng.choice(3, p=[0.55, 0.2, 0.25]))
    ]
    ref = draw_kind(plot.street.pool, family, kinds, rng)
    gates = [(x, x + 2.5) for x in rng.uniform(*SPAN, 4).tolist()]
    if rng.random() < share:
        run(plot, family, ref, side * edge, SPAN, [*kept_free(plot.ground, side), *gates])


def _paths(plot: Plot, side: float, rng: np.random.Generator) -> None:
    """Place a path along the road, and some that lead away from it."""
    kinds = ("asphalt path", "gravel path", "slab path", "brick path")
    ref = draw_kind(plot.street.pool, "paving", kinds, rng)
    along = plot.ground.outer + float(rng.uniform(4, 14))
    if rng.random() < 0.6:
        carpet(plot, "paving", ref, (SPAN[0], 100.0), (along, along + 0.5), side)
    for x in rng.uniform(0, 90, int(rng.integers(0, 4))).tolist():
        angle = float(rng.uniform(0.25, 0.5)) * math.pi
        for step in np.arange(0.5, (REACH - plot.ground.outer) / PATH[0]) * PATH[0]:
            place = x + step * math.cos(angle), plot.ground.outer + step * math.sin(angle)
            plot.lay("paving", ref, float(place[0]), float(side * place[1]), side * angle)


def _trees(
    plot: Plot, side: float, reach: tuple[float, float], area: float, rng: np.random.Generator
) -> None:
    """Place trees and bushes between ``reach`` metres from the centre line, some of them in groups."""
    pool, bare = plot.street.pool, plot.street.params.bare_tree_share
    count = int((SPAN[1] - SPAN[0]) * (reach[1] - reach[0]) / area * rng.uniform(0.4, 1.4))
    for _ in range(max(count, 0)):
        x, y = float(rng.uniform(*SPAN)), float(rng.uniform(*reach))
        for _ in range(1 if rng.random() < 0.7 else 3):
            family = "tree" if rng.random() < 0.75 else "bush"
            ref = draw_in_season(pool, family, bare, rng)
            plot.put(
                family, ref, x, side * y, float(rng.uniform(-math.pi, math.pi)), bare=area < 300
            )
            x, y = x + 3 * float(rng.normal()), float(np.clip(y + 3 * rng.normal(), *reach))
