"""Objects of a junction: houses along its arms, lights, traffic, people, lamps, trees.

They are placed in the frame of an arm (``Arm``): metres from the road's centre line, and across the arm.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from scene.assets import catalogue
from scene.assets.catalogue import draw_in_season, parts_of
from scene.ground.junction import REACH, Junction
from scene.street.background import WOODS
from scene.street.clearing import VEHICLES
from scene.street.instances import EAVES, Stand, footprint, length, spans
from scene.street.lines import STEP
from scene.street.plot import Setting

SET_BACK = 6.0
"""Largest gap between an arm's sidewalk and its houses, metres."""
VEHICLE_SHARES = (0.86, 0.08, 0.06)
"""Probabilities of the vehicles in ``VEHICLES``."""


class Arm(NamedTuple):
    """One arm of a junction, with the data for its objects."""

    street: Setting
    junction: Junction
    side: float  # of the road: 1 left, -1 right
    rng: np.random.Generator

    @property
    def ours(self) -> float:
        """The side of the arm's middle, along the road, on which traffic approaches the junction."""
        return self.street.drive * self.side

    @property
    def inwards(self) -> float:
        """Heading of approaching traffic, radians left of the road's direction."""
        return -self.side * math.pi / 2

    def stand(self, family: str, along: float, across: float, yaw: float) -> list[Stand]:
        """Draw an object of a family with its post or machine; nothing if the pool has none."""
        ref = self.pick(family)
        return [] if ref is None else self.put(family, ref, along, across, yaw)

    def pick(self, family: str) -> int | str | None:
        """Draw an asset of a family, trees in their season."""
        pool, bare = self.street.pool, self.street.params.bare_tree_share
        return draw_in_season(pool, family, bare, self.rng)

    def put(
        self, family: str, ref: int | str, along: float, across: float, yaw: float
    ) -> list[Stand]:
        """An asset with its post or machine."""
        x, y = self.junction.x + across, self.side * along
        parts = parts_of(family, ref, self.rng.random(), self.street.pool)
        return [Stand(*part, x, y, yaw, part=k > 0) for k, part in enumerate(parts)]


def junction_objects(street: Setting, rng: np.random.Generator) -> list[Stand]:
    """All objects of a street's junction, regardless of room; consumes ``rng``."""
    junction = street.ground.junction
    if junction is None:
        return []
    stands: list[Stand] = []
    for side in junction.arms:
        arm = Arm(street, junction, side, rng)
        for fill in (_houses, _end, _control, _traffic, _parked, _people, _along_sidewalks):
            stands += fill(arm)
    return stands + _road_lights(Arm(street, junction, street.drive, rng))


def _front(arm: Arm) -> float:
    """Distance from an arm's middle to its houses."""
    room = arm.street.params.building_position - arm.street.ground.outer
    return arm.junction.outer + float(np.clip(room, 0.4, SET_BACK))


def _facing(across: float) -> float:
    """Yaw of a house or lamp along an arm, towards its middle."""
    return -math.copysign(math.pi / 2, across)


def _houses(arm: Arm) -> list[Stand]:
    """A row of houses on each side, from the corner, whose house faces the road, to the end."""
    params, front = arm.street.params, _front(arm)
    town = params.building_probability
    stands: list[Stand] = []
    for hand in (-1.0, 1.0):
        at = max(params.building_position, arm.junction.mouth + 0.5)
        corner = arm.rng.random() < town
        ref = arm.pick("building") if corner else None
        if ref is not None:
            low, high = catalogue.bounds("building", ref)
            across = hand * (front - (low[0] if hand > 0 else -high[0]))
            yaw = 0.0 if arm.side > 0 else math.pi
            if arm.side < 0:
                across = hand * (front + (high[0] if hand > 0 else -low[0]))
            stands += arm.put("building", ref, at, across, yaw)
            at += float(high[1]) - EAVES
        while at < REACH:
            kind = "building" if arm.rng.random() < town else "tree"
            ref = arm.pick(kind)
            if kind == "tree" or ref is None:
                if arm.rng.random() < WOODS:
                    stands += arm.stand("tree", at + 3, hand * (front + 3), 0.0)
                at += float(arm.rng.uniform(5, 12))
                continue
            width = 2 * footprint(("building", ref))[2]
            away = front + STEP * (len(stands) % 3)
            stands += arm.put("building", ref, at + width / 2, hand * away, _facing(hand))
            at += width + (float(arm.rng.uniform(0, 6)) if arm.rng.random() < 0.2 else 0.0)
    return stands


def _end(arm: Arm) -> list[Stand]:
    """A row across the end, where the arm meets the next street, with trees in front."""
    stands: list[Stand] = []
    yaw = 0.0 if arm.side > 0 else math.pi
    for across in np.arange(-42.0, 43.0, 12.0) + arm.rng.uniform(-2, 2):
        town = 0.1 + 0.85 * arm.street.params.building_probability
        kind = "building" if arm.rng.random() < town else "tree"
        stands += arm.stand(kind, REACH + 4 + float(arm.rng.uniform(0, 2)), float(across), yaw)
        if arm.rng.random() < 0.35:
            stands += arm.stand("tree", REACH + 1.5, float(across) + 5, 0.0)
    return stands


def _control(arm: Arm) -> list[Stand]:
    """Lights on both sides of the arm's stop line, or a sign on the near side."""
    edge = arm.junction.half_width + 0.55
    along = arm.junction.stop - 0.2
    if arm.junction.control != "lights":
        return arm.stand("traffic sign", along, arm.ours * edge, arm.inwards)
    return _approach_lights(
        arm, [(along, side * edge) for side in (arm.ours, -arm.ours)], arm.inwards
    )


def _approach_lights(arm: Arm, places: list[tuple[float, float]], yaw: float) -> list[Stand]:
    """A light at the first place and often another one at the second, so that both show one colour."""
    ref = arm.pick("traffic light")
    if ref is None:
        return []
    if arm.rng.random() >= 0.6:
        places = places[:1]
    return [stand for place in places for stand in arm.put("traffic light", ref, *place, yaw)]


def _road_lights(arm: Arm) -> list[Stand]:
    """Lights on both sides for the traffic of the road; uses only the frame of ``arm``."""
    junction = arm.junction
    stands: list[Stand] = []
    if junction.control != "lights":
        return stands
    edge = junction.road_half_width + 0.55
    for heading, yaw in ((1.0, 0.0), (-1.0, math.pi)):
        across = -heading * (junction.road_stop - 0.2)
        stands += _approach_lights(arm, [(heading * edge, across), (-heading * edge, across)], yaw)
    return stands


def _vehicle(arm: Arm) -> tuple[str, int | str | None, float]:
    """Draw a vehicle: family, asset and half length."""
    family = str(arm.rng.choice(VEHICLES, p=VEHICLE_SHARES))
    ref = arm.pick(family)
    return family, ref, 0.0 if ref is None else length(family, ref) / 2


def _traffic(arm: Arm) -> list[Stand]:
    """A queue at the stop line, vehicles that drive away, and sometimes one that crosses the road."""
    junction, rng = arm.junction, arm.rng
    lane = 0.46 * junction.half_width
    stands: list[Stand] = []
    at = junction.stop + 0.7 + float(rng.uniform(0, 1.5))
    for _ in range(int(rng.choice([0, 1, 2, 3, 5], p=[0.25, 0.3, 0.2, 0.15, 0.1]))):
        family, ref, half = _vehicle(arm)
        if ref is not None:
            across = arm.ours * lane + float(rng.normal(0, 0.1))
            stands += arm.put(
                family, ref, at + half, across, arm.inwards + float(rng.normal(0, 0.02))
            )
        at += 2 * half + float(rng.uniform(1.0, 3.0))
    at = junction.stop + float(rng.uniform(2, 30))
    for _ in range(int(rng.integers(0, 3))):
        family, ref, half = _vehicle(arm)
        if ref is not None and at + 2 * half < REACH:
            stands += arm.put(family, ref, at + half, -arm.ours * lane, arm.inwards + math.pi)
        at += 2 * half + float(rng.uniform(8, 30))
    if rng.random() < 0.3 and arm.side == junction.arms[0]:
        family, ref, _ = _vehicle(arm)
        turn = 0.0
        along = float(rng.uniform(-0.3, 0.7)) * junction.road_half_width
        if len(junction.arms) == 1:  # it turns towards its own side of the road
            turn = float(rng.uniform(0.3, 0.8)) * arm.ours * arm.side
            along = float(rng.uniform(0.6, 1.0)) * junction.road_half_width
        if ref is not None:
            stands += arm.put(family, ref, along, arm.ours * lane, arm.inwards + turn)
    return _on_the_road(arm, stands)


def _on_the_road(arm: Arm, vehicles: list[Stand]) -> list[Stand]:
    """Keep the vehicles without a corner over a kerb."""
    junction, on_road = arm.junction, []
    low_high = spans(arm.street.ground.path, vehicles, junction.x)
    for vehicle, low, high in zip(vehicles, *low_high, strict=True):
        corners = [(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])]
        if all(
            abs(y) < junction.road_half_width or junction.paved(junction.x + x, y)
            for x, y in corners
        ):
            on_road.append(vehicle)
    return on_road


def _parked(arm: Arm) -> list[Stand]:
    """Cars along one kerb or both, if the arm is wide enough."""
    junction, rng = arm.junction, arm.rng
    stands: list[Stand] = []
    for hand in (-1.0, 1.0):
        # Only a wide arm has room for parked cars next to waiting traffic.
        wide = junction.half_width > (4.6 if hand == arm.ours else 3.6)
        share = float(rng.uniform(0.3, 0.95))
        if rng.random() > 0.55 or not wide:
            continue
        yaw = arm.inwards if hand == arm.ours else arm.inwards + math.pi
        for at in np.arange(junction.stop + 14, REACH - 4, 6.2):
            if rng.random() < share:
                across = hand * (junction.half_width - 1.15)
                stands += arm.stand("car", float(at), across, yaw + float(rng.normal(0, 0.01)))
    return _on_the_road(arm, stands)


def _people(arm: Arm) -> list[Stand]:
    """People at the corners, on the crossing, along the sidewalks, and a rider in the lane."""
    junction, rng = arm.junction, arm.rng
    stands: list[Stand] = []
    for hand in (-1.0, 1.0):
        for _ in range(int(rng.choice([0, 1, 2, 4], p=[0.3, 0.3, 0.25, 0.15]))):
            across = float(rng.uniform(junction.half_width + 0.6, junction.corner - 0.2))
            along = float(rng.uniform(junction.road_half_width + 0.6, junction.mouth + 2))
            if not junction.paved(junction.x + across, arm.side * along, 0.3):
                stands += arm.stand("person", along, hand * across, _anyhow(rng))
        for at in np.arange(junction.stop + 3, REACH - 5, 14.0) + rng.uniform(0, 8):
            if rng.random() < 0.5:
                across = junction.half_width + float(rng.uniform(0.7, junction.footway - 0.3))
                yaw = arm.inwards + (math.pi if rng.random() < 0.5 else 0.0)
                stands += arm.stand(
                    "person", float(at), hand * across, yaw + float(rng.normal(0, 0.1))
                )
    if junction.crossings[0] != "none":
        for _ in range(int(rng.choice([0, 1, 2, 4], p=[0.45, 0.25, 0.2, 0.1]))):
            along = junction.arm_crossing + float(rng.uniform(-1.1, 1.1))
            across = junction.half_width * float(rng.uniform(-0.95, 0.95))
            stands += arm.stand("person", along, across, 0.0 if rng.random() < 0.5 else math.pi)
    if rng.random() < 0.25:
        at, across = junction.mouth + float(rng.uniform(-3, 0.3)), junction.half_width - 0.9
        stands += arm.stand("rider", at, arm.ours * across, arm.inwards)
    return stands


def _anyhow(rng: np.random.Generator) -> float:
    return float(rng.uniform(-math.pi, math.pi))


def _along_sidewalks(arm: Arm) -> list[Stand]:
    """Lamps on alternate sides, a row of trees, and signs along the sidewalks."""
    junction, rng = arm.junction, arm.rng
    edge = junction.half_width + 0.5
    stands: list[Stand] = []
    hand = 1.0 if rng.random() < 0.5 else -1.0
    for at in np.arange(junction.stop + float(rng.uniform(3, 10)), REACH, 18.0):
        stands += arm.stand("lamp", float(at), hand * edge, _facing(hand))
        hand = -hand
    trees = arm.street.params.tree_interval
    for hand in (-1.0, 1.0):
        if rng.random() < 0.55:
            for at in np.arange(junction.stop + 6, REACH, max(trees, 7.0)) + rng.uniform(0, 4):
                across = junction.half_width + max(0.7, 0.4 * junction.footway)
                stands += arm.stand("tree", float(at), hand * across, _anyhow(rng))
        if rng.random() < 0.5:
            at = float(rng.uniform(junction.stop + 4, 40))
            yaw = arm.inwards + (0.0 if hand == arm.ours else math.pi)
            stands += arm.stand("traffic sign", at, hand * edge, yaw)
    return stands
