"""Choose the place of a shot along the road, so that it shows a street.

The choice uses a small label image, so that it does not depend on renderer and image size. Rays of Embree
find the objects of the street, the depth buffer the ground below them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from scene.classes import OWN, TrainId
from scene.ground.build import GROUND_INSTANCES
from scene.render.embree.api import SceneBVH
from scene.render.embree.depth_buffer import nearest
from scene.render.embree.rays import NOTHING, by_tiles, first_met
from scene.render.geometry import Geometry
from scene.render.protocol import RenderSettings, seen_through
from scene.render.shot import sample_rays
from scene.street.camera import Camera
from scene.street.instances import FIRST_INSTANCE
from scene.street.street import Street

WIDTH, HEIGHT = 64, 48
"""Size of the label image in pixels."""
LEAST_GROUND = 0.08
"""Least share of the image for road, sidewalk and terrain together."""
MOST_OF_ONE = 0.85
"""Largest share of the image for one class."""
MAY_FILL = [TrainId.SKY, TrainId.BUILDING, TrainId.ROAD]
"""Classes that may have a larger share."""
GROUND = list(GROUND_INSTANCES.values())


def framed(
    street: Street, geometry: Geometry, bvh: SceneBVH, settings: RenderSettings,
    shots: Sequence[int] | None = None,
) -> Street:  # fmt: skip
    """The street with one camera per shot, at the first place that shows a street.

    A shot with too little ground, or too much of one class, is retaken ``further`` along the road; if no
    place qualifies, the one with the most ground is used. A camera without such places does not change.

    Args:
        street: the street with all places.
        geometry: geometry of the street.
        bvh: hierarchy of its objects.
        settings: settings of the images, which give the field of view of cameras without one.
        shots: indices of the cameras to place; the others stay as they are. By default all.
    """
    cameras = list(street.cameras)
    for shot in range(len(cameras)) if shots is None else shots:
        cameras[shot] = _framed(cameras[shot], geometry, bvh, settings)
    return street._replace(cameras=tuple(cameras))


def _framed(first: Camera, geometry: Geometry, bvh: SceneBVH, settings: RenderSettings) -> Camera:
    if not first.further:
        return first
    best, most = first, -1.0
    for retaken, place in enumerate((first, *first.further)):
        camera = place._replace(further=(), retaken=retaken)
        ground, passes = judged(class_shares(camera, geometry, bvh, settings))
        if passes:
            return camera
        if ground > most:
            best, most = camera, ground
    return best._replace(retaken=retaken, refused=True)


def judged(shares: np.ndarray) -> tuple[float, bool]:
    """The ground's share of an image and whether it shows a street, from shares f64[classes]."""
    ground = float(shares[GROUND].sum())
    return ground, bool(ground >= LEAST_GROUND and shares[~_may_fill()].max() <= MOST_OF_ONE)


def class_shares(
    camera: Camera, geometry: Geometry, bvh: SceneBVH, settings: RenderSettings
) -> np.ndarray:
    """Share f64[classes] of each class in the small label image of a camera."""
    small = seen_through(camera, settings)._replace(width=WIDTH, height=HEIGHT, samples=1)
    rays = sample_rays(camera, small)
    ground = {
        name: getattr(geometry, name)[: 1 + len(GROUND)]
        for name in ("tables", "balls", "pose", "boxes")
    }
    hits = nearest(geometry._replace(**ground), camera, small, rays)
    reach = np.where(hits.instance > 0, hits.distance, np.float32(np.inf))
    hit_ids = first_met(bvh, rays.origin[None], rays.directions, _order(), reach)
    instance = np.where(hit_ids == NOTHING, hits.instance, FIRST_INSTANCE + hit_ids)
    label = geometry.train_id[instance]
    return np.bincount(label, minlength=OWN + 1) / label.size


@cache
def _may_fill() -> np.ndarray:
    return np.isin(np.arange(OWN + 1), MAY_FILL)


@cache
def _order() -> np.ndarray:
    return by_tiles(np.ones(WIDTH * HEIGHT, np.uint8), WIDTH, HEIGHT, 4, 2)
