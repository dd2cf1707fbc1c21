"""What else stands in a street, beside its lines: parked rows, traffic, people, open roadsides.

Each ingredient draws from a stream of its own, so none moves another's numbers, and with all shares at 0 a
street is that of its lines alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.street.lines import Setting
from scene.street.open_side import open_side
from scene.street.parked import parked_row
from scene.street.people import crossing, cycle_stands, groups, riders
from scene.street.placing import Standing
from scene.street.plot import Plot
from scene.street.traffic import lane_rows

OPEN, PARKED, QUEUES, PEOPLE, LAND = 30, 31, 32, 33, 34
"""Streams of random numbers."""
SIDES = (1.0, -1.0)
"""Left and right of the road."""


class Mix(NamedTuple):
    """How likely each ingredient without an attribute of its own is, in [0, 1]."""

    groups: float = 0.0  # people together on 13 m of a sidewalk
    crossing: float = (
        0.0  # people on a crossing of the road; half as likely at each of three other places
    )
    riders: float = 0.0  # cyclists in the lane, on 26 m of a roadside
    cycle_stands: float = 0.0  # a row of parked bicycles on 30 m of a sidewalk


MIX = Mix()
"""What streets have where nothing else is said."""


def open_sides(setting: Setting, seed: int) -> tuple[float, ...]:
    """The sides of the road without a row of houses."""
    rng = np.random.default_rng([seed, OPEN])
    shares = rng.random(2)
    return tuple(s for s, u in zip(SIDES, shares, strict=True) if u < setting.params.open_share)


def extras(
    setting: Setting, seed: int, standing: list[Standing], mix: Mix | None = None
) -> list[Standing]:
    """What comes to the objects that stand on a street's lines.

    Args:
        setting: the street.
        seed: of the street.
        standing: what is there.
        mix: shares; None: ``MIX``.
    """
    mix = MIX if mix is None else mix
    plot, params = Plot(setting, standing), setting.params
    is_open = open_sides(setting, seed)
    rng = np.random.default_rng([seed, PARKED])
    narrow = []
    for side in SIDES:
        row_rng = np.random.default_rng(rng.integers(2**32))
        if row_rng.random() < params.parked_share and parked_row(
            plot, side, side in is_open, row_rng
        ):
            narrow.append(side)
    lane_rows(plot, tuple(narrow), np.random.default_rng([seed, QUEUES]))
    people_rngs = [np.random.default_rng([seed, PEOPLE, k]) for k in range(4)]
    crossing(plot, mix.crossing, people_rngs[0])
    for side in SIDES:
        riders(plot, side, mix.riders, people_rngs[1])
        cycle_stands(plot, side, mix.cycle_stands, people_rngs[2])
        groups(plot, side, mix.groups, people_rngs[3])
    land_rng = np.random.default_rng([seed, LAND])
    for side in SIDES:
        side_rng = np.random.default_rng(land_rng.integers(2**32))
        if side in is_open:
            open_side(plot, side, side_rng)
    return plot.added
