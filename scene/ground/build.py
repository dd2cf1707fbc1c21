"""The ground of a street as three meshes: road with its markings, sidewalk with its kerb, terrain."""

from __future__ import annotations

import numpy as np

from scene.classes import TrainId
from scene.ground.ground import Ground
from scene.ground.relief import sidewalk_quads, terrain_quads
from scene.ground.roadway import road_quads
from scene.mesh.asset import Asset
from scene.mesh.quads import to_asset

GROUND_INSTANCES: dict[int, int] = {
    1: int(TrainId.ROAD),
    2: int(TrainId.SIDEWALK),
    3: int(TrainId.TERRAIN),
}
"""Instance id -> train id of the three surfaces."""


def ground_assets(ground: Ground) -> dict[int, Asset]:
    """The three surfaces by instance id."""
    rng = np.random.default_rng(ground.seed)
    surfaces = (road_quads, sidewalk_quads, terrain_quads)
    return {
        instance: to_asset(draw(ground, rng))
        for instance, draw in zip(GROUND_INSTANCES, surfaces, strict=True)
    }
