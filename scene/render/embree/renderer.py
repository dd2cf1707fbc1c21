"""The default renderer, fast on a CPU: a depth buffer for visibility, rays of Intel Embree for light.

Rays are cast to the sun where it may shine, as few as possible (``sunlight``), and to the sky from every
fourth pixel for ambient occlusion. Every asset has its own bounding volume hierarchy, which all streets
share.
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
    """Renders streets by a depth buffer, with rays for light; between calls it keeps assets' hierarchies."""

    name = "embree"

    def __init__(self) -> None:
        """Load Embree.

        Raises:
            RendererError: it is missing, or does not run on this processor.
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
        settings, *_ = [seen_through(camera, settings) for camera in street.cameras]
        geometry = build(street)
        around = surroundings(street, geometry, settings)
        lap("build")
        bvh = scene_bvh(geometry)
        around = around._replace(street=framed(street, geometry, bvh, settings, shots))
        lap("bvh")
        frames = []
        for shot in range(len(street.cameras)) if shots is None else shots:
            camera = around.street.cameras[shot]
            through = seen_through(camera, settings)
            pixels = through_middles(through)
            view = _look(around, camera, through)
            pixel_view = view if pixels == through else _look(around, camera, pixels)
            lit, opened = (np.ones(len(view.points), np.float32) for _ in range(2))
            if settings.shadows:
                lit = sunlight(bvh, view, street.sky.sun_direction, through)
            if settings.occlusion:
                segments = sky_segments(view, around, through)
                order = by_tiles(segments.needed, *sky_grid(through), 4, 2)
                unblocked = free(bvh, segments.starts, segments.directions, order, REACH)
                opened = spread(unblocked, view, through)
            lap("rays")
            frames.append(expose(around, shot, view, Light(lit, opened), pixel_view, through))
            lap("shade")
        return frames


def _look(around: Surroundings, camera: Camera, settings: RenderSettings) -> Visible:
    rays = sample_rays(camera, settings)
    return visible(around, rays, nearest(around.geometry, camera, settings, rays), settings)


@lru_cache(maxsize=2048)
def _asset_bvh(family: str, asset: int | str, seen_from: str) -> MeshBVH:
    shape = asset_shape(family, asset, seen_from)
    return MeshBVH(shape.vertices, shape.faces)


def scene_bvh(geometry: Geometry) -> SceneBVH:
    """All objects that block light: all but the ground, which ``sky_segments`` handles."""
    meshes = [_asset_bvh(*key) for key in geometry.assets]
    ground = len(geometry.shapes) - len(meshes)
    return SceneBVH(meshes, geometry.shape[1 + ground :] - ground, geometry.pose[1 + ground :])
