"""What lies along a sidewalk: a strip of grass or earth, or paving up to the houses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.look.surfaces import DRIVES, FORECOURTS, SIDEWALK_TONE, VERGES, Coat, sample_coat

LEAST, LEAST_FOOTWAY = 0.55, 1.2
"""Of a verge's width, and of the paving that stays beside it, metres."""
DEEPEST = 10.0
"""Houses farther behind the sidewalk than this have land before them, metres."""
UNDER = 1.5
"""Paving reaches below houses so far, since they stand a little back, metres."""
PLACES = {"kerb": 0.65, "rear": 0.27, "whole": 0.08}
"""Where a verge lies: between kerb and sidewalk, behind the sidewalk, or there is no sidewalk beside it."""


class Side(NamedTuple):
    """One side of the road; metres from the centre line."""

    verge: tuple[float, float] = (0.0, 0.0)  # from and to; no verge where both are one
    green: Coat | None = None  # the verge's
    rear: float = 0.0  # to where paving goes on behind the sidewalk
    court: Coat | None = None  # that paving's
    drive: Coat | None = None  # of driveways; None: as concrete as the sidewalk
    drive_end: float = 0.0  # to where they go


NO_SIDES = (Side(), Side())


def sample_side(
    rng: np.random.Generator,
    share: float,
    inner: float,
    outer: float,
    front: float | None,
    sidewalk: Coat,
) -> Side:
    """Draw one side.

    Args:
        rng: consumed.
        share: probability of a verge; with the rest, paving reaches up to houses that are near.
        inner: where the kerb ends, metres from the centre line.
        outer: where the sidewalk ends.
        front: where the houses begin; None on an open side.
        sidewalk: its coat.
    """
    wanted, place = rng.random() < share, str(rng.choice(list(PLACES), p=list(PLACES.values())))
    part, same, paved_drive = rng.uniform(0.3, 0.65), rng.random() < 0.6, rng.random() < 0.6
    green, court, drive = (
        sample_coat(rng, rows, tone=tone)
        for rows, tone in ((VERGES, 1.0), (FORECOURTS, SIDEWALK_TONE), (DRIVES, SIDEWALK_TONE))
    )
    near = front is not None and front - outer < DEEPEST
    side = Side(
        drive=drive if paved_drive else None,
        drive_end=front - 0.3 if near and front is not None else outer,
    )
    if not wanted:
        if not near or front is None:
            return side
        return side._replace(rear=front + UNDER, court=sidewalk if same else court)
    wide = min(part * (outer - inner), outer - inner - LEAST_FOOTWAY)
    if place == "whole" or wide < LEAST:
        return side._replace(verge=(inner, outer), green=green)
    ends = (inner, inner + wide) if place == "kerb" else (outer - wide, outer)
    return side._replace(verge=ends, green=green)
