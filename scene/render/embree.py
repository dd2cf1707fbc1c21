"""Ray casting with Intel Embree: the default renderer, and the fast one on a CPU.

Every asset has a bounding volume hierarchy of its own, kept for all streets in which it stands; a street
only says where. A sample casts a ray to see, one to the sun where it may shine, and every fourth one ray
into the open for ambient occlusion.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit

from scene.geometry import Geometry, asset_shape, build
from scene.render import shade
from scene.render.embree_api import (
    LANES,
    Forest,
    Tree,
    device,
    intersect8,
    occluded8,
    query_arguments,
)
from scene.render.protocol import Frame, Lap, RenderSettings, check_settings, no_lap
from scene.render.shot import (
    Hits,
    Light,
    Rays,
    Segments,
    expose,
    sample_rays,
    sky_segments,
    spread,
    sun_segments,
    surroundings,
    visible,
)
from scene.street import FIRST_INSTANCE, Street

OCCLUSION_REACH = 5.0
"""Metres within which a surface takes sky light away."""
NOWHERE = 0xFFFFFFFF
"""``RTC_INVALID_GEOMETRY_ID``."""
RAY_FIELDS, HIT_FIELDS = 12, 9
"""Words per ray of Embree's packets: origin, near, direction, time, far, mask, id, flags; then the hit's
normal, u, v, primitive, geometry, instance, instance primitive."""


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
        check_settings(settings)
        geometry = build(street)
        around = surroundings(street, geometry, settings)
        lap("build")
        forest = _plant(street, geometry)
        lap("bvh")
        frames = []
        for shot, camera in enumerate(street.cameras):
            rays = sample_rays(camera, settings)
            seen = visible(rays, geometry, _nearest(forest, rays))
            lit = np.ones(len(seen.points), np.float32)
            if settings.shadows:
                sun = sun_segments(seen, around)
                lit = _free(forest, sun, rays.columns, rays.rows, np.inf, coherent=True)
            opened = np.ones(len(seen.points), np.float32)
            if settings.occlusion:
                half = (rays.columns + 1) // 2, (rays.rows + 1) // 2
                into_the_open = sky_segments(seen, rays)
                free = _free(forest, into_the_open, *half, OCCLUSION_REACH, coherent=False)
                opened = spread(free, seen, rays)
            lap("rays")
            frames.append(expose(around, shot, rays, seen, Light(lit, opened), settings))
            lap("shade")
        return frames


@lru_cache(maxsize=2048)
def _asset_tree(family: str, asset: int | str, far: bool) -> Tree:
    shape = asset_shape(family, asset, far)
    return Tree(shape.vertices, shape.faces, lasting=True)


def _plant(street: Street, geometry: Geometry) -> Forest:
    """Embree's scene of a street. The ground is this street's own, all else is kept."""
    trees, ids = [], []
    for instance, shape in enumerate(geometry.shapes[: FIRST_INSTANCE - 1], start=1):
        trees.append(Tree(shape.vertices, shape.faces))
        ids.append(instance)
    for placement in street.placements:
        trees.append(_asset_tree(placement.family, placement.asset, placement.far))
        ids.append(placement.instance)
    return Forest(trees, ids, geometry.pose[ids])


def _nearest(forest: Forest, rays: Rays) -> Hits:
    n = len(rays.directions)
    hits = Hits(
        np.empty(n, np.int32), np.empty(n, np.int32), *(np.empty(n, np.float32) for _ in range(3))
    )
    _cast(
        forest.scene, query_arguments(coherent=True), rays.origin, rays.directions, rays.columns,
        rays.rows, *hits,
    )  # fmt: skip
    return hits


def _free(
    forest: Forest, segments: Segments, columns: int, rows: int, reach: float, *, coherent: bool
) -> np.ndarray:
    """f32[n]: 1 where nothing lies within ``reach`` metres along a wanted ray, else 0."""
    free = np.empty(columns * rows, np.float32)
    _probe(
        forest.scene, query_arguments(coherent=coherent), *segments, columns, rows,
        np.float32(reach), free,
    )  # fmt: skip
    return free


@njit(cache=True)
def _aligned(words: int) -> np.ndarray:
    """f32[words] that begins at a multiple of 32 bytes, as packets must."""
    room = np.zeros(words + 8, np.float32)
    skip = (32 - room.ctypes.data % 32) % 32 // 4
    return room[skip : skip + words]


@njit(cache=True)
def _cast(
    scene: int,
    arguments: int,
    origin: np.ndarray,
    directions: np.ndarray,
    columns: int,
    rows: int,
    face: np.ndarray,
    instance: np.ndarray,
    distance: np.ndarray,
    u: np.ndarray,
    v: np.ndarray,
) -> None:
    """Find the nearest hit of every ray, in packets of 4 x 2 neighbours."""
    packet = _aligned((RAY_FIELDS + HIT_FIELDS) * LANES)
    ray = packet.reshape(RAY_FIELDS + HIT_FIELDS, LANES)
    bits = packet.view(np.uint32).reshape(RAY_FIELDS + HIT_FIELDS, LANES)
    hit, hit_bits = ray[RAY_FIELDS:], bits[RAY_FIELDS:]
    valid = _aligned(LANES).view(np.int32)
    lane_of = np.empty(LANES, np.int64)
    for k in range(LANES):  # what Embree leaves as it is; the rest of a ray is 0
        for a in range(3):
            ray[a, k] = origin[a]
        bits[9, k] = NOWHERE
    for top in range(0, rows, 2):
        for left in range(0, columns, 4):
            for k in range(LANES):
                row, column = top + (k >> 2), left + (k & 3)
                inside = row < rows and column < columns
                i = row * columns + column if inside else 0
                lane_of[k] = i if inside else -1
                valid[k] = -1 if inside else 0
                for a in range(3):
                    ray[4 + a, k] = directions[i, a]
                ray[8, k] = np.inf
                hit_bits[6, k] = hit_bits[7, k] = NOWHERE
            intersect8(valid.ctypes.data, scene, packet.ctypes.data, arguments)
            for k in range(LANES):
                i = lane_of[k]
                if i < 0:
                    continue
                if hit_bits[6, k] == NOWHERE:
                    face[i], instance[i] = shade.MISS, 0
                    distance[i] = u[i] = v[i] = 0
                    continue
                instance[i] = np.int32(hit_bits[7, k])
                face[i] = np.int32(hit_bits[5, k])
                distance[i] = ray[8, k]
                u[i], v[i] = hit[3, k], hit[4, k]


@njit(cache=True)
def _probe(
    scene: int,
    arguments: int,
    starts: np.ndarray,
    directions: np.ndarray,
    wanted: np.ndarray,
    columns: int,
    rows: int,
    reach: np.float32,
    free: np.ndarray,
) -> None:
    """Whether anything is in the way of each wanted ray, in packets of 4 x 2 neighbours."""
    packet = _aligned(RAY_FIELDS * LANES)
    ray = packet.reshape(RAY_FIELDS, LANES)
    bits = packet.view(np.uint32).reshape(RAY_FIELDS, LANES)
    valid = _aligned(LANES).view(np.int32)
    lane_of = np.empty(LANES, np.int64)
    alike = directions.shape[0] == 1
    for k in range(LANES):  # what Embree leaves as it is; the rest of a ray is 0
        for a in range(3):
            ray[4 + a, k] = directions[0, a]
        bits[9, k] = NOWHERE
    for top in range(0, rows, 2):
        for left in range(0, columns, 4):
            any_wanted = False
            for k in range(LANES):
                row, column = top + (k >> 2), left + (k & 3)
                inside = row < rows and column < columns
                i = row * columns + column if inside else 0
                lane_of[k] = i if inside else -1
                ask = inside and wanted[i] != 0
                valid[k] = -1 if ask else 0
                any_wanted |= ask
                for a in range(3):
                    ray[a, k] = starts[i, a]
                if not alike:
                    for a in range(3):
                        ray[4 + a, k] = directions[i, a]
                ray[8, k] = reach
            if any_wanted:
                occluded8(valid.ctypes.data, scene, packet.ctypes.data, arguments)
            for k in range(LANES):
                if lane_of[k] >= 0:
                    blocked = valid[k] == 0 or ray[8, k] < 0
                    free[lane_of[k]] = 0.0 if blocked else 1.0
