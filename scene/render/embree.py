"""Ray casting with Intel Embree: the default renderer, and the fast one on a CPU.

One bounding volume hierarchy per street serves all its shots: primary rays, one shadow ray and one
ambient-occlusion ray per sample.
"""

from __future__ import annotations

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from scene.geometry import Geometry, build
from scene.render import shade
from scene.render.protocol import Frame, RenderSettings, check_settings
from scene.render.shot import expose, sample_rays, sunward, visible
from scene.street import Camera, Street

OFFSET = 1e-2
"""Metres along the normal from a hit to the start of its next ray."""
OCCLUSION_REACH = 5.0
"""Metres within which a surface takes sky light away."""


class EmbreeRenderer:
    """Renders streets by ray casting; holds no state between calls."""

    name = "embree"

    def render(self, street: Street, settings: RenderSettings) -> list[Frame]:
        """One frame per camera of the street; see ``protocol.Renderer``."""
        check_settings(settings)
        geometry = build(street)
        caster = _Caster(geometry)
        return [
            _shoot(caster, geometry, street, camera, shot, settings)
            for shot, camera in enumerate(street.cameras)
        ]


class _Caster:
    """Embree's scene of one street."""

    def __init__(self, geometry: Geometry) -> None:
        self._scene = rtcore_scene.EmbreeScene()
        self._mesh = TriangleMesh(self._scene, geometry.vertices, geometry.faces)

    def nearest(self, origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Face i32[n] (MISS where none) and distance f32[n] of the first hit."""
        origins = np.broadcast_to(origin, directions.shape).astype(np.float32)
        hit = self._scene.run(origins, directions, query="INTERSECT", output=True)
        return hit["primID"], hit["tfar"]

    def blocked(
        self, origins: np.ndarray, directions: np.ndarray, reach: float = 1e6
    ) -> np.ndarray:
        """bool[n]: something lies within ``reach`` metres along the ray."""
        if len(origins) == 0:
            return np.zeros(0, bool)
        distances = np.full(len(origins), reach, np.float32)
        return self._scene.run(origins, directions, distances, query="OCCLUDED") == 0


def _shoot(
    caster: _Caster,
    geometry: Geometry,
    street: Street,
    camera: Camera,
    shot: int,
    settings: RenderSettings,
) -> Frame:
    rays = sample_rays(camera, settings)
    seen = visible(rays, geometry, *caster.nearest(rays.origin, rays.directions))
    hit = np.flatnonzero(seen.faces != shade.MISS)
    lit = np.ones(len(seen.faces), np.float32)
    if settings.shadows:
        sun = street.sky.sun_direction
        starts = (seen.points + OFFSET * sunward(seen, geometry, sun))[hit]
        lit[hit] = ~caster.blocked(starts, np.tile(sun, (len(hit), 1)))
    opened = np.ones(len(seen.faces), np.float32)
    if settings.occlusion:
        outwards = np.empty_like(rays.directions)
        shade.occlusion_directions(seen.normals, rays.columns, outwards)
        raw = np.ones(len(seen.faces), np.float32)
        starts = (seen.points + OFFSET * seen.normals)[hit]
        raw[hit] = ~caster.blocked(starts, outwards[hit], OCCLUSION_REACH)
        shade.smooth_open(
            raw, seen.faces, seen.normals, seen.distance, rays.rows, rays.columns, opened
        )
        opened = 0.15 + 0.85 * opened
    return expose(street, shot, geometry, rays, seen, lit, opened, settings)
