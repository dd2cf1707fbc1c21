"""Asking Embree whether anything is in the way of rays, in packets of eight from compiled loops."""

from __future__ import annotations

import numpy as np

from scene.compiled import njit
from scene.render.embree.api import LANES, SceneBVH, occluded8, query_arguments

EVERYTHING = 0xFFFFFFFF
"""Mask of a ray that nothing is hidden from."""
RAY_FIELDS = 12
"""Words per ray of Embree's packets: origin, near, direction, time, far, mask, id, flags."""


def free(
    bvh: SceneBVH,
    starts: np.ndarray,
    directions: np.ndarray,
    order: np.ndarray,
    reach: float = np.inf,
) -> np.ndarray:
    """Which rays get away: f32[n], 1 where nothing lies along one of ``order``, else 0.

    Args:
        bvh: what may be in the way.
        starts: f32[n, 3].
        directions: f32[n, 3] or, where all run alike, f32[1, 3].
        order: i64[m] indices of the rays that are wanted; eight in turn should be neighbours.
        reach: metres within which it would be in the way.
    """
    found = np.zeros(len(starts), np.float32)
    _probe(
        bvh.scene, query_arguments(), starts, directions, order, np.float32(reach), found,
    )  # fmt: skip
    return found


@njit(cache=True)
def by_tiles(wanted: np.ndarray, columns: int, rows: int, wide: int, high: int) -> np.ndarray:
    """Indices i64[m] of the wanted ones, tile after tile, so that a packet holds neighbours."""
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
def aligned(words: int) -> np.ndarray:
    """f32[words] that begins at a multiple of 32 bytes, as packets must."""
    room = np.zeros(words + 8, np.float32)
    skip = (32 - room.ctypes.data % 32) % 32 // 4
    return room[skip : skip + words]


@njit(cache=True)
def _probe(
    scene: int,
    arguments: int,
    starts: np.ndarray,
    directions: np.ndarray,
    order: np.ndarray,
    reach: np.float32,
    found: np.ndarray,
) -> None:
    """Set ``found`` to 1 where nothing is in the way of a ray of ``order``, in packets of eight."""
    packet = aligned(RAY_FIELDS * LANES)
    ray = packet.reshape(RAY_FIELDS, LANES)
    valid = aligned(LANES).view(np.int32)
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
            found[lanes[k]] = 0.0 if ray[8, k] < 0 else 1.0
