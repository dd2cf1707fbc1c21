"""Trace rays with Embree, for the nearest hit or for occlusion, in packets of eight from a compiled loop."""

from __future__ import annotations

import numpy as np

from scene.compiled import njit
from scene.render.embree.api import LANES, SceneBVH, intersect8, occluded8, query_arguments

EVERYTHING = 0xFFFFFFFF
"""Mask of a ray that hits everything."""
NOTHING = 0xFFFFFFFF
"""Hit id of a ray without a hit."""
FIELDS = 21
"""Words per ray of Embree's packets of rays and hits: origin, near, direction, time, far, mask, id, flags;
normal, u, v, and the numbers of triangle, mesh, instance and place in an array of instances, the last of
which is INSTANCE. Rays alone end with the flags."""
DIRECTION, FAR, MASK, GEOMETRY, INSTANCE = 4, 8, 9, 18, 20


def free(
    bvh: SceneBVH,
    starts: np.ndarray,
    directions: np.ndarray,
    order: np.ndarray,
    reach: float = np.inf,
) -> np.ndarray:
    """Find unblocked rays: f32[n], 1 for rays of ``order`` without a hit, else 0.

    Args:
        bvh: objects that may block rays.
        starts: f32[n, 3].
        directions: f32[n, 3], or f32[1, 3] if all are equal.
        order: i64[m] indices of the needed rays; each eight in turn should be neighbours.
        reach: largest distance of a hit in metres.
    """
    hit_ids = np.zeros(len(starts), np.uint32)
    far = np.full(1, reach, np.float32)
    _cast(bvh.scene, query_arguments(), starts, directions, order, far, False, hit_ids)
    return (hit_ids == NOTHING).astype(np.float32)


def first_met(
    bvh: SceneBVH,
    starts: np.ndarray,
    directions: np.ndarray,
    order: np.ndarray,
    reach: np.ndarray,
) -> np.ndarray:
    """The index u32[n] of the first instance along each ray of ``order``; `NOTHING` for none in reach.

    Args:
        bvh: objects that rays may hit.
        starts: f32[n, 3], or f32[1, 3] if all are equal.
        directions: f32[n, 3].
        order: i64[m] indices of the needed rays; each eight in turn should be neighbours.
        reach: f32[n] largest distance of a hit in metres.
    """
    hit_ids = np.full(len(directions), NOTHING, np.uint32)
    _cast(bvh.scene, query_arguments(), starts, directions, order, reach, True, hit_ids)
    return hit_ids


@njit(cache=True)
def by_tiles(needed: np.ndarray, columns: int, rows: int, wide: int, high: int) -> np.ndarray:
    """Indices i64[m] of the needed rays, tile after tile, so that a packet has neighbours."""
    order = np.empty(columns * rows, np.int64)
    count = 0
    for top in range(0, rows, high):
        for left in range(0, columns, wide):
            for row in range(top, min(top + high, rows)):
                for column in range(left, min(left + wide, columns)):
                    order[count] = row * columns + column
                    count += needed[order[count]] != 0
    return order[:count]


@njit(cache=True)
def aligned(words: int) -> np.ndarray:
    """An array f32[words] aligned to 32 bytes, as packets must be."""
    room = np.zeros(words + 8, np.float32)
    skip = (32 - room.ctypes.data % 32) % 32 // 4
    return room[skip : skip + words]


@njit(cache=True)
def _cast(
    scene: int,
    arguments: int,
    starts: np.ndarray,
    directions: np.ndarray,
    order: np.ndarray,
    reach: np.ndarray,
    closest: bool,
    hit_ids: np.ndarray,
) -> None:
    """Set ``hit_ids`` for the rays of ``order``, in packets of eight: see `first_met`.

    With ``closest`` false it is any other number where something is in the way, which is found sooner.
    """
    packet = aligned(FIELDS * LANES)
    ray = packet.reshape(FIELDS, LANES)
    words = packet.view(np.uint32).reshape(FIELDS, LANES)
    valid = aligned(LANES).view(np.int32)
    words[MASK] = EVERYTHING
    start_step = 1 if len(starts) > 1 else 0
    direction_step = 1 if len(directions) > 1 else 0
    reach_step = 1 if len(reach) > 1 else 0
    for begin in range(0, len(order), LANES):
        lanes = order[begin : begin + LANES]
        for k in range(LANES):
            valid[k] = -1 if k < len(lanes) else 0
        for k in range(len(lanes)):
            for a in range(3):
                ray[a, k] = starts[lanes[k] * start_step, a]
                ray[DIRECTION + a, k] = directions[lanes[k] * direction_step, a]
            ray[FAR, k] = reach[lanes[k] * reach_step]
            words[GEOMETRY, k] = words[INSTANCE, k] = NOTHING
        if closest:
            intersect8(valid.ctypes.data, scene, packet.ctypes.data, arguments)
            for k in range(len(lanes)):
                hit_ids[lanes[k]] = words[INSTANCE, k] if words[GEOMETRY, k] != NOTHING else NOTHING
        else:
            occluded8(valid.ctypes.data, scene, packet.ctypes.data, arguments)
            for k in range(len(lanes)):
                hit_ids[lanes[k]] = 0 if ray[FAR, k] < 0 else NOTHING
