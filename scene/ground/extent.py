"""How far the ground reaches and how it is divided: metres, shared by all that lies on it."""

from __future__ import annotations

import numpy as np

HALF_WIDTHS, FOOTWAYS = (3.7, 5.4), (1.8, 4.8)
"""Between which lie half the width of a carriageway, and the width of the sidewalks beside it."""
KERB_HEIGHT = 0.12
"""The usual one."""
KERB_HEIGHTS = (0.03, 0.16)
KERB_WIDTH = 0.18
GROUND_START, GROUND_END, GROUND_SIDE = -40.0, 600.0, 400.0
"""Extent of the ground: along the road from, to, and to each side."""
NEAR_START, NEAR_END = -6.0, 150.0
"""Between these places along the road the ground is divided finely."""
STRIP, STRIP_END = 30.0, 350.0
"""Where a road bends, slopes or has a junction, ground follows it this far to each side and along it."""
TUCK = 0.06
"""Metres that a bent surface reaches below the next one: their corners do not all lie beside each other."""
PATCH_LIFT, COVER_LIFT, PAINT_LIFT = 0.002, 0.004, 0.008
"""Patches, iron covers and markings lie this far above the asphalt."""


def stations(step: float, end: float = GROUND_END) -> np.ndarray:
    """Places along the road where cells of about ``step`` metres meet; far ones are longer."""
    near = np.arange(NEAR_START, NEAR_END + step / 2, step)
    return np.concatenate([[GROUND_START], near, [190.0, 250.0, 330.0, end]])


def wavy(rng: np.random.Generator, at: np.ndarray, length: float) -> np.ndarray:
    """Smooth noise of mean 0 within -1 .. 1 at places ``at``, of waves ``length`` metres long."""
    knots = np.arange(at.min() - length, at.max() + 2 * length, length)
    return np.interp(at, knots, rng.uniform(-1, 1, len(knots)))
