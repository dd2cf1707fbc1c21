"""The strips along a sidewalk: grass or earth, or paving up to the houses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.look.surfaces import DRIVES, FORECOURTS, SIDEWALK_TONE, VERGES, Coat, sample_coat

LEAST, LEAST_FOOTWAY = 0.55, 1.2
"""Smallest width of a verge, and of the paving next to it, metres."""
DEEPEST = 10.0
"""Houses farther than this behind the sidewalk have land in front of them, metres."""
UNDER = 1.5
"""Metres by which paving reaches below houses, since they are set back a little."""
PLACES = {"kerb": 0.65, "rear": 0.27, "whole": 0.08}
"""Probabilities of a verge between kerb and sidewalk, behind the sidewalk, or instead of it."""


class Side(NamedTuple):
    """One side of the road; metres from the centre line."""

    verge: tuple[float, float] = (0.0, 0.0)  # start and end; no verge if they are equal
    green: Coat | None = None  # of the verge
    rear: float = 0.0  # end of paving behind the sidewalk
    court: Coat | None = None  # of that paving
    drive: Coat | None = None  # of driveways; None: concrete like the sidewalk
    drive_end: float = 0.0  # end of driveways


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
        share: probability of a verge; otherwise, paving extends to nearby houses.
        inner: outer edge of the kerb, metres from the centre line.
        outer: outer edge of the sidewalk.
        front: front of the houses; None on an open side.
        sidewalk: coat of the sidewalk.
    """
    has_verge, place = rng.random() < share, str(rng.choice(list(PLACES), p=list(PLACES.values())))
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
    if not has_verge:
        if not near or front is None:
            return side
        return side._replace(rear=front + UNDER, court=sidewalk if same else court)
    wide = min(part * (outer - inner), outer - inner - LEAST_FOOTWAY)
    if place == "whole" or wide < LEAST:
        return side._replace(verge=(inner, outer), green=green)
    ends = (inner, inner + wide) if place == "kerb" else (outer - wide, outer)
    return side._replace(verge=ends, green=green)
