"""The camera of a street: a pinhole, and the path it drives."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from scene.ground.path import STRAIGHT, Path, place_at, slope_at

DRIVE = 60.0
"""Metres of road over which the camera takes its shots."""
SEARCH = 15.0
"""Metres by which a shot may be moved on to a place where nothing blocks the lens."""
VIEW = 4.0
"""Metres of view that should be free."""
SPARE = 0.3
"""Metres that things should be away from it."""


class Camera(NamedTuple):
    """A pinhole camera; ``yaw`` right positive, ``pitch`` down positive, ``roll`` clockwise, radians."""

    position: tuple[float, float, float]
    yaw: float
    pitch: float
    roll: float = 0.0
    field_of_view: float | None = None  # horizontal, radians; None: as the dataset's settings say
    exposure: float = 1.0  # factor on the light
    warmth: float = 0.0  # red against blue, stops


def camera_axes(camera: Camera) -> np.ndarray:
    """Rows: the camera's right, up and forward axes in the world, f64[3, 3]."""
    forward = np.array(_forward(camera))
    level = np.array([-math.sin(camera.yaw), -math.cos(camera.yaw), 0.0])
    upright = np.cross(level, forward)
    cr, sr = math.cos(camera.roll), math.sin(camera.roll)
    return np.stack([cr * level - sr * upright, sr * level + cr * upright, forward])


def _forward(camera: Camera) -> tuple[float, float, float]:
    along = math.cos(camera.pitch)
    return along * math.cos(camera.yaw), -along * math.sin(camera.yaw), -math.sin(camera.pitch)


def camera_path(
    first: Camera,
    shots: int,
    boxes: np.ndarray,
    rng: np.random.Generator,
    path: Path = STRAIGHT,
) -> tuple[Camera, ...]:
    """Poses spread over ``DRIVE`` metres, each moved on until nothing blocks the lens.

    Args:
        first: the camera at the start of the road.
        shots: how many.
        boxes: f64[n, 2, 3] low and high corners of what is in the way.
        rng: consumed.
        path: of the road, which the camera follows as if it were fixed to a car.
    """
    cameras = []
    for shot in range(shots):
        steps = (shot + rng.random()) * DRIVE / shots + np.arange(0.0, SEARCH, 1.5)
        candidates = [_driven(first, float(x), path) for x in steps]
        cameras.append(candidates[int(np.argmin(_blocked(candidates, boxes)))])
    return tuple(cameras)


def _driven(first: Camera, x: float, path: Path) -> Camera:
    """The camera ``x`` metres along the road."""
    _, y, z = first.position
    if path.straight:
        return first._replace(position=(x, y, z))
    east, north, heading, height = place_at(path, x, y)
    rise = math.atan(float(slope_at(path, x)))
    return first._replace(
        position=(east, north, z + height),
        yaw=first.yaw - heading,
        pitch=first.pitch - rise * math.cos(first.yaw),
        # Who looks to the right has the car's nose at the left.
        roll=first.roll + rise * math.sin(first.yaw),
    )


def _blocked(cameras: list[Camera], boxes: np.ndarray) -> np.ndarray:
    """How much i64[cameras] of the first metres of each view lies inside boxes, with some to spare.

    Standing inside one counts more than any view into one.
    """
    places = np.array([camera.position for camera in cameras])
    forward = np.array([_forward(camera) for camera in cameras])
    ahead = np.linspace(0, VIEW, 9)[:, None] * forward[:, None]
    points = places[:, None] + ahead
    low, high = boxes[:, 0] - SPARE, boxes[:, 1] + SPARE
    near = (high >= points.min(axis=(0, 1))) & (low <= points.max(axis=(0, 1)))
    low, high = low[near.all(axis=1)], high[near.all(axis=1)]
    inside = (points[:, :, None] > low) & (points[:, :, None] < high)
    hidden = inside.all(axis=3).any(axis=2)
    return hidden.sum(axis=1) + points.shape[1] * hidden[:, 0]
