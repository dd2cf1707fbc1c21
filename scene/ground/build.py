"""The ground of a street as three meshes: road with its markings, sidewalk with its kerb, terrain."""

from __future__ import annotations

from scene.classes import TrainId
from scene.ground.arms import arm_land, arm_road, corners, kept
from scene.ground.ground import Ground
from scene.ground.land import bent
from scene.ground.relief import arm_sides, open_land, sidewalk_quads, terrain_quads
from scene.ground.roadway import road_quads
from scene.mesh.asset import Asset
from scene.mesh.quads import to_asset
from scene.streams import seeded

GROUND_INSTANCES: dict[int, int] = {
    1: int(TrainId.ROAD),
    2: int(TrainId.SIDEWALK),
    3: int(TrainId.TERRAIN),
}
"""Instance id -> train id of the three surfaces."""


def ground_assets(ground: Ground) -> dict[int, Asset]:
    """The three surfaces by instance id."""
    rng = seeded(ground.seed)
    drawn = [draw(ground, rng) for draw in (road_quads, sidewalk_quads, terrain_quads)]
    if ground.junction:
        junction = ground.junction
        drawn[1:] = [[kept(part, junction) for part in parts] for parts in drawn[1:]]
        drawn[0] += arm_road(ground, junction, rng)
        drawn[1] += [*corners(ground, junction), *arm_sides(ground, junction, rng)]
        drawn[2] += arm_land(ground, junction, rng)
    if ground.shaped:
        drawn = [bent(parts, ground.path) for parts in drawn]
        drawn[2] += open_land(ground, rng)
    return {
        instance: to_asset(parts) for instance, parts in zip(GROUND_INSTANCES, drawn, strict=True)
    }
