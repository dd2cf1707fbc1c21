"""A junction, where streets meet the road at right angles: its random parameters.

An arm is a street on one side of the road. Its carriageway joins the road's with rounded corners; a sidewalk
around each corner connects those of both streets.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

REACH = 90.0
"""Length of arms in metres from the centre line of the road."""
ARM_STRIP, ARM_END = 30.0, 104.0
"""The land follows an arm this far to each side of its middle, and along it."""
PLACES = (22.0, 90.0)
"""Range of the junction's middle in metres along the road."""
ARM_HALF_WIDTHS, ARM_FOOTWAYS = (0.68, 1.0), (0.75, 1.1)
"""Ranges of factors on the road's widths for arms."""
RADII = (4.0, 8.0)
"""Range of the radius of kerb corners, metres."""
CROSSING_DEPTH = 3.0
"""Depth of a crossing over an arm or at the junction, metres."""


class Junction(NamedTuple):
    """A junction; all lengths in metres."""

    x: float  # middle of the arms, along the road
    arms: tuple[float, ...]  # sides with an arm, 1 left and -1 right
    half_width: float  # of the carriageways of arms
    footway: float  # width of the sidewalks of arms
    radius: float  # of the kerb around the corners
    road_half_width: float  # of the road that the arms join
    road_footway: float
    control: str  # "lights", "stop" or "give way"
    crossings: tuple[str, str]  # over arms, and over the road: "zebra", "studs" or "none"
    box: bool  # whether a box junction is painted
    lane_line: bool  # whether a line divides the directions of arms

    @property
    def outer(self) -> float:
        """Outer edge of the arms' sidewalks, from their middle."""
        return self.half_width + self.footway

    @property
    def corner(self) -> float:
        """Where the road's sidewalk continues, from the arms' middle."""
        return self.half_width + max(self.radius, self.footway)

    @property
    def mouth(self) -> float:
        """Where the arms' sidewalks start, from the road's centre line."""
        return self.road_half_width + max(self.radius, self.road_footway)

    @property
    def arm_crossing(self) -> float:
        """The middle of crossings over arms, from the road's centre line."""
        return self.mouth + 0.4 + CROSSING_DEPTH / 2

    @property
    def stop(self) -> float:
        """Stop line of an arm, from the road's centre line."""
        return self.mouth + (0.8 if self.crossings[0] == "none" else CROSSING_DEPTH + 1.6)

    @property
    def road_crossing(self) -> float:
        """The middle of crossings over the road, from the arms' middle."""
        return self.corner + 0.4 + CROSSING_DEPTH / 2

    @property
    def road_stop(self) -> float:
        """Stop line of the road at lights, from the arms' middle."""
        return self.corner + (0.8 if self.crossings[1] == "none" else CROSSING_DEPTH + 1.6)

    def paved(self, x: float | np.ndarray, y: float | np.ndarray, spare: float = 0.0) -> np.ndarray:
        """Whether the carriageway of an arm, or of a corner, is within ``spare`` metres of places (x, y)."""
        u, v = np.abs(x - self.x), np.abs(y)
        arm = np.isin(np.sign(y), self.arms) & (v >= self.road_half_width) & (v <= REACH)
        corner_u, corner_v = (
            u - self.half_width - self.radius,
            v - self.road_half_width - self.radius,
        )
        around = (corner_u < 0) & (corner_v < 0)
        around &= np.hypot(corner_u, corner_v) > self.radius - spare
        return arm & ((u < self.half_width + spare) | around)

    def near_arm(self, x: float | np.ndarray, y: float | np.ndarray) -> np.ndarray:
        """Whether the land at places (x, y) follows an arm."""
        along = (np.abs(y) <= ARM_END) & np.isin(np.sign(y), self.arms)
        return along & (np.abs(x - self.x) <= ARM_STRIP)

    @property
    def line(self) -> np.ndarray:
        """Places f64[n, 2] along the arms' middles, road coordinates."""
        y = np.arange(8.0, ARM_END, 8.0)
        return np.array([(self.x, side * v) for side in self.arms for v in y])


def sample_junction(
    rng: np.random.Generator, share: float, half_width: float, footway: float
) -> Junction | None:
    """Draw a junction with the probability ``share``, else None.

    Args:
        rng: consumed.
        share: probability of a junction.
        half_width: half the width of the road's carriageway, metres.
        footway: width of the road's sidewalks, metres.
    """
    if rng.random() >= share:
        return None
    arms = ((1.0, -1.0), (1.0, -1.0), (1.0,), (-1.0,))[int(rng.integers(4))]
    control = str(rng.choice(["lights", "stop", "give way"], p=[0.5, 0.15, 0.35]))
    over = str(rng.choice(["zebra", "studs", "none"], p=[0.35, 0.3, 0.35]))
    across = over if control == "lights" and rng.random() < 0.7 else "none"
    half = float(np.clip(half_width * rng.uniform(*ARM_HALF_WIDTHS), 2.8, 7.5))
    return Junction(
        x=float(rng.uniform(*PLACES)),
        arms=arms,
        half_width=half,
        footway=float(np.clip(footway * rng.uniform(*ARM_FOOTWAYS), 1.2, 6.0)),
        radius=float(rng.uniform(*RADII)),
        road_half_width=half_width,
        road_footway=footway,
        control=control,
        crossings=(over, across),
        box=bool(control == "lights" and rng.random() < 0.35),
        lane_line=bool(rng.random() < 0.75),
    )
