"""Ray casting with Intel Embree: the default renderer, and the fast one on a CPU.

One bounding volume hierarchy per street serves all its shots: primary rays, one shadow ray and one
ambient-occlusion ray per sample.
"""

from __future__ import annotations

import cv2
import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from scene.geometry import SKY_INSTANCE, Geometry, build
from scene.render import shade
from scene.render.protocol import (
    Frame,
    RenderSettings,
    camera_axes,
    check_settings,
    label_sample,
    pixel_rays,
)
from scene.sensor import develop
from scene.sky import sky_arrays
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
    s = settings.samples
    height, width = settings.height * s, settings.width * s
    x, y = pixel_rays(settings, s)
    axes = camera_axes(camera)
    plane = np.empty((height, width, 3))
    plane[..., 0], plane[..., 1], plane[..., 2] = x, y[:, None], 1.0
    along = 1 / np.linalg.norm(plane, axis=2).ravel()  # distance -> depth along the optical axis
    directions = np.ascontiguousarray(
        (plane.reshape(-1, 3) @ axes) * along[:, None], dtype=np.float32
    )
    origin = np.asarray(camera.position, np.float32)
    faces, distance = caster.nearest(origin, directions)
    hit = faces != shade.MISS

    sky = street.sky
    normals = np.zeros_like(directions)
    normals[:, 2] = 1.0
    shade.facing_normals(faces, directions, geometry.normal, normals)
    points = origin + np.where(hit, distance, 0)[:, None] * directions + OFFSET * normals
    lit = np.ones(len(faces), np.float32)
    if settings.shadows:
        seen = np.flatnonzero(hit)
        towards_sun = np.tile(sky.sun_direction, (len(seen), 1))
        lit[seen] = ~caster.blocked(np.ascontiguousarray(points[seen]), towards_sun)
    opened = np.ones(len(faces), np.float32)
    if settings.occlusion:
        outwards = np.empty_like(directions)
        shade.occlusion_directions(normals, width, outwards)
        seen = np.flatnonzero(hit)
        raw = np.ones(len(faces), np.float32)
        raw[seen] = ~caster.blocked(
            np.ascontiguousarray(points[seen]),
            np.ascontiguousarray(outwards[seen]),
            OCCLUSION_REACH,
        )
        shade.smooth_open(raw, faces, normals, distance, height, width, opened)
        opened = 0.15 + 0.85 * opened

    radiance = shade.shade(
        faces, distance, directions, origin, normals, lit, opened,
        np.float32(x[1] - x[0]), settings.textures,
        geometry.color, geometry.material, geometry.instance,
        shade.material_rows(), shade.texture_levels(),
        sky.ambient, np.float32(sky.haze), *sky_arrays(sky),
    )  # fmt: skip
    image = radiance.reshape(height, width, 3)
    if s > 1:
        # Tones are compressed before averaging, so that bright sky does not eat thin poles.
        image = cv2.resize(
            np.minimum(image, 2.0), (settings.width, settings.height), interpolation=cv2.INTER_AREA
        )
    rng = np.random.default_rng([street.seed, shot])

    k = label_sample(s)
    pick = np.s_[k::s, k::s]
    found = faces.reshape(height, width)[pick]
    instance = np.where(found < 0, SKY_INSTANCE, geometry.instance[found]).astype(np.uint16)
    depth = np.where(hit, distance * along, 0).reshape(height, width)[pick]
    return Frame(
        develop(image, settings.response, rng),
        geometry.train_id[instance],
        instance,
        depth.astype(np.float32),
    )
