"""Vehicles in the lanes: queues at lights, and moving traffic with gaps."""

from __future__ import annotations

import math

import numpy as np

from scene.assets.catalogue import draw_asset
from scene.assets.rider import MOUNT
from scene.streams import child
from scene.street.instances import length
from scene.street.parked import clear
from scene.street.plot import LINE_END, LINE_START, Plot, draw_family, draw_kind

VEHICLES = {"car": 0.88, "truck": 0.05, "bus": 0.035, "rider": 0.035}
"""Families of the traffic; riders on motorcycles."""
ROW = 2.1
"""Width of a row of parked cars, metres."""
LANE = 2.8
"""Least width in metres of each of two lanes."""
QUEUE_GAP, MOVING_GAP = (1.3, 3.6), (5.0, 20.0)
"""Metres between bumpers."""
MOVING = 0.4
"""Share of full lanes with moving traffic."""
PLATOON = (4, 14)
"""Range of the number of vehicles between gaps."""
ON_MOTORCYCLES = tuple(name for name, mount in MOUNT.items() if mount == "motorcycle")


def lane_centres(plot: Plot, side: float, parked: bool) -> list[float]:
    """Centres of the lanes of a side in metres from the centre line: one, or two on a wide road."""
    width = plot.ground.half_width - (ROW if parked else 0.4)
    count = 2 if width > 2 * LANE else 1
    return [(k + 0.5) * width / count for k in range(count)]


def lane_rows(plot: Plot, parked: tuple[float, ...], rng: np.random.Generator) -> None:
    """Fill lanes, each with the probability ``queue_share``.

    Args:
        plot: the street.
        parked: sides with a row of parked cars at the kerb.
        rng: consumed.
    """
    for side in (1.0, -1.0):
        lanes = [child(rng) for _ in range(2)]
        for centre, lane_rng in zip(lane_centres(plot, side, side in parked), lanes, strict=False):
            if lane_rng.random() < plot.street.params.queue_share:
                _fill(plot, side, centre, lane_rng)


def _fill(plot: Plot, side: float, centre: float, rng: np.random.Generator) -> None:
    """Fill one lane in platoons; queues keep crossings and box junctions free."""
    ground, pool = plot.ground, plot.street.pool
    forward = 0.0 if side == plot.street.drive else math.pi
    moving = rng.random() < MOVING
    gaps = MOVING_GAP if moving else QUEUE_GAP
    closed = [] if moving else [*((x - 3.2, x + 3.2) for x in ground.crosswalks), *ground.boxes]
    x = LINE_START + float(rng.uniform(0, 25))
    left = int(rng.integers(*PLATOON))
    while x < LINE_END:
        family = draw_family(VEHICLES, rng)
        ref = (
            draw_kind(pool, family, ON_MOTORCYCLES, rng)
            if family == "rider"
            else draw_asset(pool, family, rng)
        )
        gap, drift, wobble = rng.uniform(*gaps), 0.12 * rng.normal(), 0.015 * rng.normal()
        chance, pause = rng.random(), float(rng.uniform(12, 40))
        if ref is None:
            x += 5.0
            continue
        long = max(length(family, ref), 2.2)
        y = side * (centre + min(max(float(drift), -0.25), 0.25))
        stands = clear(closed, x, x + long) and plot.put(
            family, ref, x + long / 2, y, forward + float(wobble), chance=chance, spare=0.3
        )
        if not stands:
            x += 0.9
            continue
        left -= 1
        x += long + float(gap)
        if left == 0:
            x, left = x + pause, int(rng.integers(*PLATOON))
