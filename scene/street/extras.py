"""Ingredients in addition to the lines of a street: parked rows, traffic, people, open roadsides.

Each ingredient has its own random stream, so that none changes another; with all shares at 0, a street has
only its lines.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

from scene import streams
from scene.street import furniture, people
from scene.street.open_side import open_side
from scene.street.parked import parked_row
from scene.street.plot import Plot
from scene.street.traffic import lane_rows
from scene.street.turning import turning

SIDES = (1.0, -1.0)
"""Left and right of the road."""


class Mix(NamedTuple):
    """Probabilities in [0, 1] of the ingredients without an attribute."""

    turning: float = 0.0  # vehicles across the road's direction: at side streets, drives, elsewhere
    groups: float = 0.0  # a group of people on 13 m of a sidewalk
    benches: float = 0.0  # people on a bench on 26 m of a sidewalk
    crossing: float = 0.0  # people on a crossing; half as likely at each of three other places
    riders: float = 0.0  # cyclists in the lane, on 26 m of a roadside
    cycle_stands: float = 0.0  # a row of parked bicycles on 30 m of a sidewalk
    gardens: float = 0.0  # a front garden, on about 11 m of houses
    shelters: float = 0.0  # a bus shelter at each of two places of a side
    railings: float = 0.0  # a long railing or fence on 40 m of a sidewalk
    bollards: float = 0.0  # a row of posts on 30 m of a kerb
    islands: float = 0.0  # a traffic island at each end of a crossing and at two other places
    scaffolds: float = 0.0  # scaffolding on 30 m of houses
    stalls: float = 0.0  # a row of stalls on a side
    plantings: float = 0.0  # shrubs, flowers or a hedge on 15 m of a green verge


MIX = Mix(
    turning=0.25, riders=0.2, cycle_stands=0.15, gardens=0.2, shelters=0.15, railings=0.18,
    bollards=0.12, islands=0.12, scaffolds=0.05, stalls=0.08, plantings=0.35,
)  # fmt: skip
"""The default mix, without people in groups, on benches and on crossings, who do not improve networks."""


def open_sides(share: float, seed: int) -> tuple[float, ...]:
    """Draw the sides of the road without a row of houses, each with the probability ``share``."""
    shares = streams.stream(seed, "open").random(2)
    return tuple(s for s, u in zip(SIDES, shares, strict=True) if u < share)


def extras(plot: Plot, seed: int, mix: Mix | None = None) -> None:
    """Add the ingredients to a street's lines.

    Args:
        plot: the street.
        seed: seed of the street.
        mix: the probabilities; None: ``MIX``.
    """
    mix = MIX if mix is None else mix
    params = plot.street.params
    is_open = open_sides(params.open_share, seed)

    stream = partial(streams.stream, seed)
    furniture.islands(plot, mix.islands, stream("furniture", 0))
    narrow = []
    for k, side in enumerate(SIDES):
        rng = stream("parked", k)
        is_parked = rng.random() < params.parked_share
        if is_parked and parked_row(plot, side, side in is_open, rng):
            narrow.append(side)
    turning(plot, mix.turning, stream("traffic", 1))
    lane_rows(plot, tuple(narrow), stream("traffic"))
    for k, side in enumerate(SIDES):
        if side in is_open:
            open_side(plot, side, stream("land", k))
        else:
            furniture.scaffolds(plot, side, mix.scaffolds, stream("furniture", 1 + k))
        furniture.shelters(plot, side, mix.shelters, stream("furniture", 3 + k))
        furniture.stalls(plot, side, mix.stalls, side in is_open, stream("furniture", 5 + k))
        if side not in is_open:
            furniture.gardens(plot, side, mix.gardens, stream("furniture", 7 + k))
        furniture.railings(plot, side, mix.railings, stream("furniture", 11 + k))
        furniture.bollards(plot, side, mix.bollards, stream("furniture", 9 + k))
        furniture.plantings(plot, side, mix.plantings, stream("furniture", 13 + k))
    people.crossing(plot, mix.crossing, stream("people", 0))
    for k, side in enumerate(SIDES):
        people.riders(plot, side, mix.riders, stream("people", 1 + k))
        people.cycle_stands(plot, side, mix.cycle_stands, stream("people", 3 + k))
        people.benches(plot, side, mix.benches, stream("people", 5 + k))
        people.groups(plot, side, mix.groups, stream("people", 7 + k))
