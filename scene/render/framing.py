"""Where a shot is taken: of the places along the road that a street offers, one that shows a street.

Decided on a small label image, whatever renderer and size the picture has, so that all show the same
place. Objects are found by rays of Embree, the ground by the depth buffer, which is as exact.
"""

from __future__ import annotations

import numpy as np
from numba import types

from scene.classes import CLASS_NAMES, TrainId
from scene.compiled import njit
from scene.ground.build import GROUND_INSTANCES
from scene.render.embree.api import LANES, SceneBVH, query_arguments
from scene.render.embree.depth_buffer import nearest
from scene.render.embree.rays import EVERYTHING, RAY_FIELDS, by_tiles, aligned
from scene.render.geometry import Geometry
from scene.render.protocol import RenderSettings, seen_through
from scene.render.shot import sample_rays
from scene.street.camera import Camera
from scene.street.street import Street

WIDTH, HEIGHT = 64, 48
"""Of the label image, pixels."""
LEAST_GROUND = 0.08
"""Share of the image that road, sidewalk and terrain should fill."""
MOST_OF_ONE = 0.85
"""Share that no other class but sky, building and road should fill."""
GROUND = np.array([int(label) for label in GROUND_INSTANCES.values()])
MAY_FILL = np.array([TrainId.SKY, TrainId.BUILDING, TrainId.ROAD])

HIT_ROWS = 10
"""Words per ray of what Embree tells of a hit: normal, u, v, primitive, geometry, instance, its part; one spare."""
INSTANCE_ROW = RAY_FIELDS + 7

intersect8 = types.ExternalFunction(
    "rtcIntersect8", types.void(types.uintp, types.uintp, types.uintp, types.uintp)
)


def framed(street: Street, geometry: Geometry, bvh: SceneBVH, settings: RenderSettings) -> Street:
    """The street with the one camera of each shot through which it is seen.

    A shot with too little ground, or too much of one class, is taken again further along the road, as often
    as its camera says where; if none will do, the one with the most ground is kept.

    Args:
        street: with the cameras that ``sample_street`` offers.
        geometry: of the street.
        bvh: of what stands in it.
        settings: of the pictures; only the field of view counts.
    """
    return street._replace(
        cameras=tuple(_framed(camera, geometry, bvh, settings) for camera in street.cameras)
    )


def _framed(
    first: Camera, geometry: Geometry, bvh: SceneBVH, settings: RenderSettings
) -> Camera:
    if not first.further:
        return first
    best, most = first, -1.0
    for retaken, camera in enumerate((first, *first.further)):
        chosen = camera._replace(further=(), retaken=retaken)
        ground, passed = verdict(label_shares(chosen, geometry, bvh, settings))
        if passed:
            return chosen
        if ground > most:
            best, most = chosen, ground
    return best._replace(refused=True)


def verdict(shares: np.ndarray) -> tuple[float, bool]:
    """Share of ground in an image, and whether it shows a street; from shares f64[classes]."""
    ground = float(shares[GROUND].sum())
    others = np.delete(shares, MAY_FILL)
    return ground, bool(ground >= LEAST_GROUND and others.max() <= MOST_OF_ONE)


def label_shares(
    camera: Camera, geometry: Geometry, bvh: SceneBVH, settings: RenderSettings
) -> np.ndarray:
    """Share f64[classes] of each class in the small label image of a shot."""
    small = seen_through(camera, settings)._replace(width=WIDTH, height=HEIGHT, samples=1)
    rays = sample_rays(camera, small)
    n = 1 + len(GROUND_INSTANCES)
    bare = geometry._replace(tables=geometry.tables[:n], balls=geometry.balls[:n], pose=geometry.pose[:n], boxes=geometry.boxes[:n])
    hits = nearest(bare, camera, small, rays)
    distance = np.where(hits.instance > 0, hits.distance, np.float32(np.inf))
    order = by_tiles(np.ones(WIDTH * HEIGHT, np.uint8), WIDTH, HEIGHT, 4, 2)
    _cast(bvh.scene, query_arguments(), rays.origin, rays.directions, order, distance, hits.instance)
    label = geometry.train_id[hits.instance]
    return np.bincount(label, minlength=len(CLASS_NAMES))[: len(CLASS_NAMES)] / label.size


@njit(cache=True)
def _cast(
    scene: int,
    arguments: int,
    origin: np.ndarray,
    directions: np.ndarray,
    order: np.ndarray,
    reach: np.ndarray,
    instance: np.ndarray,
) -> None:
    """Set ``instance`` to what is met along each ray within its ``reach``, in packets of eight."""
    packet = aligned((RAY_FIELDS + HIT_ROWS) * LANES)
    ray = packet.reshape(RAY_FIELDS + HIT_ROWS, LANES)
    words = packet.view(np.uint32).reshape(RAY_FIELDS + HIT_ROWS, LANES)
    valid = aligned(LANES).view(np.int32)
    valid[:] = -1
    words[9] = EVERYTHING
    for begin in range(0, len(order), LANES):
        lanes = order[begin : begin + LANES]
        for k in range(LANES):
            i = lanes[k]
            for a in range(3):
                ray[a, k] = origin[a]
                ray[4 + a, k] = directions[i, a]
            ray[3, k] = 0
            ray[8, k] = reach[i]
            words[RAY_FIELDS + 6, k] = EVERYTHING
            words[RAY_FIELDS + 7, k] = EVERYTHING
        intersect8(valid.ctypes.data, scene, packet.ctypes.data, arguments)
        for k in range(LANES):
            if words[RAY_FIELDS + 6, k] != EVERYTHING:
                instance[lanes[k]] = words[INSTANCE_ROW, k]
