"""The default renderer, and the fast one on a CPU: a depth buffer to see, rays of Intel Embree for light.

Where the sun may shine rays are cast to it, as few as will do (``sunlight``), and of every fourth pixel one
into the open for ambient occlusion. Every asset has a bounding volume hierarchy of its own, kept for all
streets in which it stands; a street only says where.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from scene.render.buffers import Light, Visible
from scene.render.embree.api import MeshBVH, SceneBVH, device
from scene.render.embree.depth_buffer import nearest
from scene.render.embree.rays import by_tiles, free
from scene.render.embree.sunlight import sunlight
from scene.render.framing import framed
from scene.render.geometry import Geometry, asset_shape, build
from scene.render.protocol import (
    Frame,
    Lap,
    RenderSettings,
    check_settings,
    no_lap,
    seen_through,
    through_middles,
)
from scene.render.shot import (
    Surroundings,
    expose,
    sample_rays,
    sky_grid,
    sky_segments,
    spread,
    surroundings,
    visible,
)
from scene.render.visibility import REACH
from scene.street.camera import Camera
from scene.street.street import Street


class EmbreeRenderer:
    """Renders streets by ray casting; holds no state between calls but the assets' hierarchies."""

    name = "embree"

    def __init__(self) -> None:
        """Load Embree.

        Raises:
            RendererError: it is not there, or does not run on this processor.
        """
        device()

    def render(
        self,
        street: Street,
        settings: RenderSettings,
        lap: Lap = no_lap,
        shots: Sequence[int] | None = None,
    ) -> list[Frame]:
        """Render one frame per camera of the street; see ``protocol.Renderer``."""
        settings = check_settings(seen_through(street.cameras[0], settings))
        geometry = build(street)
        around = surroundings(street, geometry, settings)
        lap("build")
        bvh = scene_bvh(geometry)
        around = around._replace(street=framed(street, geometry, bvh, settings, shots))
        lap("bvh")
        frames, middle = [], through_middles(settings)
        for shot in range(len(street.cameras)) if shots is None else shots:
            camera = around.street.cameras[shot]
            seen = _look(around, camera, settings)
            middles = seen if middle == settings else _look(around, camera, middle)
            lit, opened = (np.ones(len(seen.points), np.float32) for _ in range(2))
            if settings.shadows:
                lit = sunlight(bvh, seen, street.sky.sun_direction, settings)
            if settings.occlusion:
                away = sky_segments(seen, around, settings)
                order = by_tiles(away.wanted, *sky_grid(settings), 4, 2)
                found = free(bvh, away.starts, away.directions, order, REACH)
                opened = spread(found, seen, settings)
            lap("rays")
            frames.append(expose(around, shot, seen, Light(lit, opened), middles, settings))
            lap("shade")
        return frames


def _look(around: Surroundings, camera: Camera, settings: RenderSettings) -> Visible:
    rays = sample_rays(camera, settings)
    return visible(around, rays, nearest(around.geometry, camera, settings, rays), settings)


@lru_cache(maxsize=2048)
def _asset_bvh(family: str, asset: int | str, seen: str) -> MeshBVH:
    shape = asset_shape(family, asset, seen)
    return MeshBVH(shape.vertices, shape.faces)


def scene_bvh(geometry: Geometry) -> SceneBVH:
    """What can be in the way of light: all but the ground, of which ``sky_segments`` knows."""
    meshes = [_asset_bvh(*key) for key in geometry.assets]
    ground = len(geometry.shapes) - len(meshes)
    return SceneBVH(meshes, geometry.shape[1 + ground :] - ground, geometry.pose[1 + ground :])
