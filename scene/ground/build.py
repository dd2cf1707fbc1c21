"""The ground of a street as three meshes: road with its markings, sidewalk with its kerb, terrain."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.classes import TrainId
from scene.ground.arms import arm_land, arm_road, corners, kept
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
    """One of them; ``road`` has its vertices in road coordinates, as high as they lie above the road.

    Those of the open land are the world's but for the height.
    """

    asset: Asset  # in the world
    road: np.ndarray  # f64[v, 3]


def ground_surfaces(ground: Ground) -> dict[int, Surface]:
    """The three surfaces by instance id."""
    rng = seeded(ground.seed)
    drawn = [draw(ground, rng) for draw in (road_quads, sidewalk_quads, terrain_quads)]
    if ground.junction:
        junction = ground.junction
        drawn[1:] = [[kept(joined(parts), junction)] for parts in drawn[1:]]
        drawn[0] += arm_road(ground, junction, rng)
        drawn[1] += [*corners(ground, junction), *arm_sides(ground, junction, rng)]
        drawn[2] += arm_land(ground, junction, rng)
    path = ground.path
    if not path.straight:
        drawn = [[pieces(parts)] for parts in drawn]
    standing = [[bent(part, path) for part in parts] for parts in drawn]
    if ground.shaped:
        land = open_land(ground, rng)
        standing[2] += land
        drawn[2] += [above_road(part, path) for part in land]
    return {
        instance: Surface(
            to_asset(stands), np.concatenate([p.corners for p in lies]).reshape(-1, 3)
        )
        for instance, stands, lies in zip(GROUND_INSTANCES, standing, drawn, strict=True)
    }
