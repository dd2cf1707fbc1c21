"""Close-ups of a default street from its lane, a few metres from one asset of a chosen family."""

from __future__ import annotations

import math
import zlib
from typing import NamedTuple

import numpy as np

from scene.assets.catalogue import AssetPool
from scene.attributes import default_unit, street_params
from scene.render import RenderSettings, renderer
from scene.street.background import BEHIND
from scene.street.camera import Camera
from scene.street.instances import FIRST_INSTANCE, Placement, bounds
from scene.street.street import Street, sample_street

DISTANCE: dict[str, float] = {
    "building": 16.0,
    "lamp": 9.0,
    "fence": 8.0,
    "wall": 8.0,
    "tree": 16.0,
    "bush": 8.0,
    "traffic sign": 7.0,
    "traffic light": 7.0,
    "person": 7.0,
    "rider": 7.0,
    "bicycle": 6.0,
    "motorcycle": 6.0,
    "car": 9.0,
    "truck": 14.0,
    "bus": 14.0,
}
"""Family -> metres along the road from camera to asset, so that it has about its size in CamVid."""
STRETCH = (25.0, 100.0)
"""Metres of road with assets for close-ups; the street continues on both sides."""
MARGIN = 0.3
"""Metres by which boxes grow when the view is cleared."""
STREETS_TRIED = 400


class CloseUp(NamedTuple):
    """One picture of one asset."""

    image: np.ndarray  # u8[h, w, 3]
    mask: np.ndarray  # bool[h, w], the asset's own pixels


def close_up(family: str, seed: int, number: int) -> tuple[Street, int]:
    """A street with one camera that looks at an asset of ``family``, and the asset's instance.

    Raises:
        ValueError: no street has such an asset.
    """
    for attempt in range(STREETS_TRIED):
        entropy = [seed, zlib.crc32(family.encode()), number, attempt]
        rng = np.random.default_rng(entropy)
        street = sample_street(
            street_params(default_unit()), int(rng.integers(2**32)), 1, AssetPool()
        )
        found = [
            p
            for p in street.placements
            if p.family == family
            and STRETCH[0] < p.pose[0, 3] < STRETCH[1]
            and abs(p.pose[1, 3]) < BEHIND  # not the background
        ]
        if found:
            chosen = found[int(rng.integers(len(found)))]
            return _looking_at(street, chosen, DISTANCE[family])
    raise ValueError(f"none of {STREETS_TRIED} default streets has a {family}")


def _looking_at(street: Street, chosen: Placement, distance: float) -> tuple[Street, int]:
    """The street from ``distance`` metres before ``chosen``, with nothing in between."""
    lane = street.cameras[0]
    _, lateral, height = lane.position
    x, y = (float(v) for v in chosen.pose[:2, 3])
    eye, target = np.array([x - distance, lateral, height]), np.array([x, y, height])
    camera = Camera((x - distance, lateral, height), math.atan2(lateral - y, distance), lane.pitch)
    kept: list[Placement] = []
    instance = -1
    for placement, hides in zip(
        street.placements, _crossed(bounds(list(street.placements)), eye, target), strict=True
    ):
        # Instances with the same pose belong to it: a rider's machine, a sign's post.
        if hides and not np.array_equal(placement.pose, chosen.pose):
            continue
        if placement is chosen:
            instance = FIRST_INSTANCE + len(kept)
        kept.append(placement._replace(instance=FIRST_INSTANCE + len(kept)))
    return street._replace(placements=tuple(kept), cameras=(camera,)), instance


def _crossed(boxes: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Whether the line from ``start`` to ``end`` meets each of the boxes f64[n, 2, 3], with margin."""
    along = np.where(end == start, 1e-9, end - start)
    first = (boxes[:, 0] - MARGIN - start) / along
    second = (boxes[:, 1] + MARGIN - start) / along
    enters = np.minimum(first, second).max(axis=1)
    leaves = np.maximum(first, second).min(axis=1)
    return (enters <= leaves) & (leaves >= 0) & (enters <= 1)


def close_ups(family: str, seed: int, count: int, settings: RenderSettings) -> list[CloseUp]:
    """Render ``count`` pictures of assets of a family; the same arguments give the same pictures.

    Raises:
        ValueError: no street has one.
    """
    engine = renderer("embree")
    pictures = []
    for number in range(count):
        street, instance = close_up(family, seed, number)
        frame = engine.render(street, settings)[0]
        pictures.append(CloseUp(frame.image, frame.instance == instance))
    return pictures
