"""Vehicles visible from the side: in side streets and driveways, turning, pulling out."""

from __future__ import annotations

import math

import numpy as np

from scene.assets.catalogue import draw_asset
from scene.street.instances import length
from scene.street.plot import Plot, draw_family

VEHICLES = {"car": 0.94, "truck": 0.06}
LANE_OFFSET = 1.6
"""Distance of a lane of a side street from its middle, metres."""
START, END = 8.0, 100.0
"""Range of turning vehicles in metres along the road."""


def turning(plot: Plot, share: float, rng: np.random.Generator) -> None:
    """Place vehicles across the road's direction; each place has some with the probability ``share``.

    The places are side streets, driveways, and two more where a vehicle pulls out from the kerb or turns
    round.
    """
    ground = plot.ground
    for x, side in ground.side_streets:
        _side_street(plot, x, side, share, rng)
    for x, side in ground.driveways:
        is_present, tail_in = rng.random() < share, rng.random() < 0.5
        family, ref, long = _vehicle(plot, rng, 6.0)
        y = ground.outer + 0.3 + long / 2 + float(rng.uniform(0, 1))
        if is_present:
            yaw = side * math.pi / 2 + math.pi * tail_in + 0.03 * float(rng.normal())
            plot.put(family, ref, x, side * y, yaw)
    for _ in range(2):
        _pulling_out(plot, share, rng)


def _vehicle(
    plot: Plot, rng: np.random.Generator, longest: float = 12.0
) -> tuple[str, int | str | None, float]:
    """Draw a vehicle: family, asset (None if it is too long) and length."""
    family = draw_family(VEHICLES, rng)
    ref = draw_asset(plot.street.pool, family, rng)
    if ref is None:
        return family, None, 0.0
    long = length(family, ref)
    return (family, ref, long) if long < longest else (family, None, long)


def _side_street(plot: Plot, x: float, side: float, share: float, rng: np.random.Generator) -> None:
    """Place vehicles that wait in a side street, that have entered it, and one that turns at the corner."""
    ground, drive = plot.ground, plot.street.drive
    if rng.random() >= share:
        return
    # Vehicles that leave the side street drive on the side of the local traffic.
    out = x + LANE_OFFSET * side * drive
    y = ground.half_width + 1.2
    for _ in range(int(rng.integers(0, 4))):
        family, ref, long = _vehicle(plot, rng)
        wobble = 0.04 * float(rng.normal())
        plot.put(family, ref, out, side * (y + long / 2), -side * math.pi / 2 + wobble)
        y += long + float(rng.uniform(1.2, 3))
    if rng.random() < 0.5:
        family, ref, long = _vehicle(plot, rng)
        away = ground.half_width + 1.0 + long / 2 + float(rng.uniform(0, 12))
        plot.put(family, ref, 2 * x - out, side * away, side * math.pi / 2)
    if rng.random() < 0.5:
        family, ref, long = _vehicle(plot, rng, 5.2)
        angle, near = float(rng.uniform(0.6, 1.3)), rng.random() < 0.5
        # Along an arc into the lane on this side of the centre line, or across it into the other lane.
        radius = (0.5 if near else 1.5) * ground.half_width
        turn = angle * (drive if near else -drive)
        y = ground.half_width - radius * math.sin(angle)
        x = out + side * math.copysign(radius, turn) * (1 - math.cos(angle))
        plot.put(family, ref, x, side * y, -side * math.pi / 2 + turn)


def _pulling_out(plot: Plot, share: float, rng: np.random.Generator) -> None:
    """Place a vehicle that leaves the kerb at an angle, or is across the road while it turns round."""
    half = plot.ground.half_width
    side = 1.0 if rng.random() < 0.5 else -1.0
    forward = 0.0 if side == plot.street.drive else math.pi
    heading = 1.0 if side == plot.street.drive else -1.0
    x, is_present, round_ = float(rng.uniform(START, END)), rng.random() < share, rng.random() < 0.4
    family, ref, long = _vehicle(plot, rng, 5.5)
    if not is_present:
        return
    # Towards the middle of the road: clockwise on the left side for forward traffic.
    angle = float(rng.uniform(1.1, 1.9) if round_ else rng.uniform(0.25, 0.7))
    reach = 0.5 * long * math.sin(angle) + 0.9 * abs(math.cos(angle))
    y = float(rng.uniform(0, 1)) if round_ else half - 0.4 - reach
    plot.put(family, ref, x, side * y, forward - side * heading * angle)
