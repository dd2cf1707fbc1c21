"""A junction: where streets at right angles meet the road, and what is drawn of it by chance.

An arm is a street of its own on one side of the road. Its carriageway joins the road's with rounded corners;
around each corner sidewalk reaches from one street's to the other's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

REACH = 90.0
"""Metres from the centre line of the road to where arms end."""
ARM_STRIP, ARM_END = 30.0, 104.0
"""Land goes with an arm this far to each side of its middle, and along it."""
PLACES = (22.0, 90.0)
"""Metres along the road between which its middle lies."""
ARM_HALF_WIDTHS, ARM_FOOTWAYS = (0.68, 1.0), (0.75, 1.1)
"""Of arms, as factors on the road's own."""
RADII = (4.0, 8.0)
"""Of the corners of the kerb, metres."""
CROSSING_DEPTH = 3.0
"""Of a crossing over an arm or beside the junction, metres."""


class Junction(NamedTuple):
    """Where arms join the road; metres."""

    x: float  # of their middle, along the road
    arms: tuple[float, ...]  # sides that have one, 1 left and -1 right
    half_width: float  # of their carriageways
    footway: float  # width of their sidewalks
    radius: float  # of the kerb around the corners
    road_half_width: float  # of the road they join
    road_footway: float
    control: str  # "lights", "stop" or "give way"
    crossings: tuple[str, str]  # over arms, and over the road: "zebra", "studs" or "none"
    box: bool  # painted to be kept free
    lane_line: bool  # the arms' directions are divided by a line

    @property
    def outer(self) -> float:
        """Where the arms' sidewalks end, from their middle."""
        return self.half_width + self.footway

    @property
    def corner(self) -> float:
        """Where the road's own sidewalk begins again, from the arms' middle."""
        return self.half_width + max(self.radius, self.footway)

    @property
    def mouth(self) -> float:
        """Where the arms' own sidewalks begin, from the road's centre line."""
        return self.road_half_width + max(self.radius, self.road_footway)

    @property
    def arm_crossing(self) -> float:
        """The middle of crossings over arms, from the road's centre line."""
        return self.mouth + 0.4 + CROSSING_DEPTH / 2

    @property
    def stop(self) -> float:
        """Where traffic of an arm waits, from the road's centre line."""
        return self.mouth + (0.8 if self.crossings[0] == "none" else CROSSING_DEPTH + 1.6)

    @property
    def road_crossing(self) -> float:
        """The middle of crossings over the road, from the arms' middle."""
        return self.corner + 0.4 + CROSSING_DEPTH / 2

    @property
    def road_stop(self) -> float:
        """Where traffic of the road waits for a light, from the arms' middle."""
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

    def beside(self, x: float | np.ndarray, y: float | np.ndarray) -> np.ndarray:
        """Whether the land at places (x, y) goes with an arm."""
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
    """Draw a junction, or with the rest of ``share`` none.

    Args:
        rng: consumed.
        share: probability that there is one.
        half_width: of the road's carriageway, metres.
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
