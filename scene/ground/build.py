"""The ground of a street as three meshes: road with markings, sidewalk with kerb, terrain."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.classes import TrainId
from scene.ground.arms import arm_land, arm_road, corners, outside_junction
from scene.ground.ground import Ground
from scene.ground.land import above_road, bent, pieces
from scene.ground.relief import arm_sides, open_land, sidewalk_quads, terrain_quads
from scene.ground.roadway import road_quads
from scene.mesh.asset import Asset
from scene.mesh.quads import joined, to_asset
from scene.streams import seeded

GROUND_INSTANCES: dict[int, int] = {
    1: int(TrainId.ROAD),
    2: int(TrainId.SIDEWALK),
    3: int(TrainId.TERRAIN),
}
"""Instance id -> train id of the three surfaces."""


class Surface(NamedTuple):
    """One surface; ``road`` has its vertices in road coordinates, with heights above the road.

    Vertices of the open land have world coordinates, except for the height.
    """

    asset: Asset  # in world coordinates
    road: np.ndarray  # f64[v, 3]


def ground_surfaces(ground: Ground) -> dict[int, Surface]:
    """The three surfaces by instance id."""
    rng = seeded(ground.seed)
    road_parts = [draw(ground, rng) for draw in (road_quads, sidewalk_quads, terrain_quads)]
    if ground.junction:
        junction = ground.junction
        road_parts[1:] = [[outside_junction(joined(parts), junction)] for parts in road_parts[1:]]
        road_parts[0] += arm_road(ground, junction, rng)
        road_parts[1] += [*corners(ground, junction), *arm_sides(ground, junction, rng)]
        road_parts[2] += arm_land(ground, junction, rng)
    path = ground.path
    if not path.straight:
        road_parts = [[pieces(parts)] for parts in road_parts]
    world_parts = [[bent(part, path) for part in parts] for parts in road_parts]
    if ground.shaped:
        land = open_land(ground, rng)
        world_parts[2] += land
        road_parts[2] += [above_road(part, path) for part in land]
    return {
        instance: Surface(
            to_asset(in_world), np.concatenate([p.corners for p in on_road]).reshape(-1, 3)
        )
        for instance, in_world, on_road in zip(
            GROUND_INSTANCES, world_parts, road_parts, strict=True
        )
    }
