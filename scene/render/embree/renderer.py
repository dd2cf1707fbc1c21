"""The default renderer, and the fast one on a CPU: a depth buffer to see, rays of Intel Embree for light.

A sample casts one ray to the sun where it may shine, and every fourth one ray into the open for ambient
occlusion. Every asset has a bounding volume hierarchy of its own, kept for all streets in which it stands;
a street only says where.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit

from scene.render.embree.api import LANES, MeshBVH, SceneBVH, device, occluded8, query_arguments
from scene.render.embree.depth_buffer import nearest
from scene.render.geometry import Geometry, asset_shape, build
from scene.render.protocol import (
    Frame,
    Lap,
    RenderSettings,
    check_settings,
    no_lap,
    seen_through,
)
from scene.render.shot import (
    Light,
    Segments,
    expose,
    sample_rays,
    sky_segments,
    spread,
    sun_segments,
    surroundings,
    visible,
)
from scene.render.visibility import REACH
from scene.street.street import Street

EVERYTHING = 0xFFFFFFFF
"""Mask of a ray that nothing is hidden from."""
RAY_FIELDS = 12
"""Words per ray of Embree's packets: origin, near, direction, time, far, mask, id, flags."""


class EmbreeRenderer:
    """Renders streets by ray casting; holds no state between calls but the assets' hierarchies."""

    name = "embree"

    def __init__(self) -> None:
        """Load Embree.

        Raises:
            RendererError: it is not there, or does not run on this processor.
        """
        device()

    def render(self, street: Street, settings: RenderSettings, lap: Lap = no_lap) -> list[Frame]:
        """One frame per camera of the street; see ``protocol.Renderer``."""
        settings = check_settings(seen_through(street.cameras[0], settings))
        geometry = build(street)
        around = surroundings(street, geometry, settings)
        lap("build")
        bvh = _scene_bvh(street, geometry)
        lap("bvh")
        frames = []
        for shot, camera in enumerate(street.cameras):
            rays = sample_rays(camera, settings)
            seen = visible(rays, geometry, nearest(geometry, camera, settings, rays))
            lit = np.ones(len(seen.points), np.float32)
            if settings.shadows:
                sun = sun_segments(seen, around)
                lit = _free(bvh, sun, rays.columns, rays.rows, np.inf, coherent=True)
            opened = np.ones(len(seen.points), np.float32)
            if settings.occlusion:
                half = (rays.columns + 1) // 2, (rays.rows + 1) // 2
                into_the_open = sky_segments(seen, rays, around)
                free = _free(bvh, into_the_open, *half, REACH, coherent=False)
                opened = spread(free, seen, rays)
            lap("rays")
            frames.append(expose(around, shot, rays, seen, Light(lit, opened), settings))
            lap("shade")
        return frames


@lru_cache(maxsize=2048)
def _asset_bvh(family: str, asset: int | str, far: bool) -> MeshBVH:
    shape = asset_shape(family, asset, far)
    return MeshBVH(shape.vertices, shape.faces)


def _scene_bvh(street: Street, geometry: Geometry) -> SceneBVH:
    """What can be in the way of light: all but the ground, of which ``sky_segments`` knows."""
    meshes = [_asset_bvh(p.family, p.asset, p.far) for p in street.placements]
    ids = [p.instance for p in street.placements]
    return SceneBVH(meshes, ids, geometry.pose[ids])


def _free(
    bvh: SceneBVH, segments: Segments, columns: int, rows: int, reach: float, *, coherent: bool
) -> np.ndarray:
    """f32[n]: 1 where nothing lies within ``reach`` metres along a wanted ray, else 0."""
    free = np.zeros(columns * rows, np.float32)
    order = _by_tiles(segments.wanted, columns, rows, 4, 2)
    _probe(
        bvh.scene, query_arguments(coherent=coherent), segments.starts, segments.directions,
        order, np.float32(reach), free,
    )  # fmt: skip
    return free


@njit(cache=True)
def _aligned(words: int) -> np.ndarray:
    """f32[words] that begins at a multiple of 32 bytes, as packets must."""
    room = np.zeros(words + 8, np.float32)
    skip = (32 - room.ctypes.data % 32) % 32 // 4
    return room[skip : skip + words]


@njit(cache=True)
def _by_tiles(wanted: np.ndarray, columns: int, rows: int, wide: int, high: int) -> np.ndarray:
    """Indices i64[m] of the wanted samples, tile after tile, so that a packet holds neighbours."""
    order = np.empty(columns * rows, np.int64)
    count = 0
    for top in range(0, rows, high):
        for left in range(0, columns, wide):
            for row in range(top, min(top + high, rows)):
                for column in range(left, min(left + wide, columns)):
                    order[count] = row * columns + column
                    count += wanted[order[count]] != 0
    return order[:count]


@njit(cache=True)
def _probe(
    scene: int,
    arguments: int,
    starts: np.ndarray,
    directions: np.ndarray,
    order: np.ndarray,
    reach: np.float32,
    free: np.ndarray,
) -> None:
    """Set ``free`` to 1 where nothing is in the way of a ray of ``order``, in packets of eight."""
    packet = _aligned(RAY_FIELDS * LANES)
    ray = packet.reshape(RAY_FIELDS, LANES)
    valid = _aligned(LANES).view(np.int32)
    alike = directions.shape[0] == 1
    packet.view(np.uint32).reshape(RAY_FIELDS, LANES)[9] = EVERYTHING
    for k in range(LANES):  # the rest of a ray is 0
        for a in range(3):
            ray[4 + a, k] = directions[0, a]
    for begin in range(0, len(order), LANES):
        lanes = order[begin : begin + LANES]
        for k in range(LANES):
            valid[k] = -1 if k < len(lanes) else 0
            ray[8, k] = reach
        for k in range(len(lanes)):
            for a in range(3):
                ray[a, k] = starts[lanes[k], a]
                if not alike:
                    ray[4 + a, k] = directions[lanes[k], a]
        occluded8(valid.ctypes.data, scene, packet.ctypes.data, arguments)
        for k in range(len(lanes)):
            free[lanes[k]] = 0.0 if ray[8, k] < 0 else 1.0
