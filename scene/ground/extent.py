"""Extent and subdivision of the ground in metres, shared by all its parts."""

from __future__ import annotations

import numpy as np

HALF_WIDTHS, FOOTWAYS = (3.7, 5.4), (1.8, 4.8)
"""Ranges of half the width of a carriageway, and of the width of its sidewalks."""
KERB_HEIGHT = 0.12
"""Usual height."""
KERB_HEIGHTS = (0.03, 0.16)
KERB_WIDTH = 0.18
GROUND_START, GROUND_END, GROUND_SIDE = -40.0, 600.0, 400.0
"""Extent of the ground: start and end along the road, and to each side."""
NEAR_START, NEAR_END = -6.0, 150.0
"""Between these places along the road, the ground is finely divided."""
STRIP, STRIP_END = 30.0, 350.0
"""If a road bends, slopes or has a junction, the ground follows it this far to each side and along it."""
TUCK = 0.06
"""Metres by which a bent surface reaches below the next one, since not all their corners coincide."""
PATCH_LIFT, COVER_LIFT, PAINT_LIFT = 0.002, 0.004, 0.008
"""Height of patches, iron covers and markings above the asphalt."""


def stations(step: float, end: float = GROUND_END) -> np.ndarray:
    """Places along the road where cells of about ``step`` metres meet; distant cells are longer."""
    near = np.arange(NEAR_START, NEAR_END + step / 2, step)
    return np.concatenate([[GROUND_START], near, [190.0, 250.0, 330.0, end]])


def wavy(rng: np.random.Generator, at: np.ndarray, length: float) -> np.ndarray:
    """Smooth noise in -1 .. 1 of mean 0 at places ``at``, with a wavelength of ``length`` metres."""
    knots = np.arange(at.min() - length, at.max() + 2 * length, length)
    return np.interp(at, knots, rng.uniform(-1, 1, len(knots)))
