"""The camera of a street: a pinhole, and the path it drives."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from scene.ground.ground import Ground, ground_height
from scene.ground.path import Path, heading_at, place_at, slope_at, to_world
from scene.street.clearance import Rectangle, Rectangles

DRIVE = 60.0
"""Metres of road over which the camera takes its shots."""
SEARCH = 24.0
"""Metres along the road within which a shot may be retaken."""
AGAIN = 4
"""Largest number of times that a shot is retaken."""
VIEW = 4.0
"""Metres ahead of the camera that also stay clear by ``SPARE``: the length of a bonnet and a gap."""
SPARE = 1.0
"""Least distance in metres of the camera from all objects."""
ASIDE = 8.0
"""Largest distance of the camera from the centre line, metres."""
LEAST = 1e-9
"""Smallest divisor for the slope of a rectangle's side; metres by which rounding may move an end."""


class Camera(NamedTuple):
    """A pinhole camera; ``yaw`` right positive, ``pitch`` down positive, ``roll`` clockwise, radians."""

    position: tuple[float, float, float]
    yaw: float
    pitch: float
    roll: float = 0.0
    field_of_view: float | None = None  # horizontal, radians; None: that of the settings
    exposure: float = 1.0  # factor on the light
    warmth: float = 0.0  # red against blue, stops
    further: tuple[Camera, ...] = ()  # replacements for a shot that shows no street
    retaken: int = 0  # number of times that the shot was retaken
    refused: bool = False  # whether it still shows no street
    offset: tuple[float, float] = (0.0, 0.0)
    """The principal point, right of and below the image's centre, as shares of the image's width."""


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


def places_along(shots: int, rng: np.random.Generator) -> np.ndarray:
    """Metres along the road f64[shots, 1 + AGAIN] of the places of each shot and of its replacements.

    The shots are spread over ``DRIVE`` metres; consumes ``rng``.
    """
    along = np.linspace(0.0, SEARCH, 1 + AGAIN)
    return np.array([(shot + rng.random()) * DRIVE / shots + along for shot in range(shots)])


def camera_path(
    first: Camera, x: np.ndarray, obstacles: np.ndarray, ground: Ground, fixed: bool
) -> tuple[Camera, ...]:
    """Poses along the road, each with replacements ``further`` along it.

    All are as far from the centre line as ``first``. Where an object is within ``SPARE`` metres, a fixed
    camera has no replacement, and a movable one goes to the nearest free place across the road. Places
    without free ground within ``ASIDE`` metres are left out, unless a shot has no other.

    Args:
        first: camera at the start of the road, with its height above the ground.
        x: f64[shots, 1 + AGAIN] metres along the road, see ``places_along``.
        obstacles: f64[n, 6] the objects of the street, with rows as ``clearance.Rectangle``.
        ground: the ground, whose road the camera follows as if mounted on a car.
        fixed: whether the camera keeps its distance; objects must then be clear of its first places.
    """
    lane = first.position[1]
    if fixed:
        solid = Rectangles()
        solid.extend(obstacles)
        room = camera_room(ground.path, x[:, 1:].ravel(), lane)
        free = [not solid.meet(Rectangle(*row), 0.0) for row in room]
        y = np.full(x.shape, lane)
        y[:, 1:] = np.where(free, lane, np.nan).reshape(len(x), -1)
    else:
        y = nearest_free(ground.path, x.ravel(), lane, obstacles).reshape(x.shape)
        y[np.isnan(y).all(axis=1)] = lane
    cameras = []
    for places in np.stack([x, y], axis=-1):
        free = places[~np.isnan(places[:, 1])].tolist()
        camera, *further = [_driven(first, along, across, ground) for along, across in free]
        cameras.append(camera._replace(further=tuple(further)))
    return tuple(cameras)


def camera_room(path: Path, x: np.ndarray, y: float) -> np.ndarray:
    """The area f64[n, 6] that a camera at ``x`` f64[n], ``y`` metres left of the centre line, keeps free.

    Rows are as ``clearance.Rectangle``: ``SPARE`` metres around the camera and ``VIEW`` metres ahead of it.
    """
    heading = heading_at(path, x)
    cos, sin = np.cos(heading), np.sin(heading)
    middle = to_world(path, x, y) + VIEW / 2 * np.stack([cos, sin], axis=1)
    size = np.broadcast_to([VIEW / 2 + SPARE, SPARE], middle.shape)
    return np.column_stack([middle, cos, sin, size])


def nearest_free(path: Path, x: np.ndarray, y: float, obstacles: np.ndarray) -> np.ndarray:
    """The free place across the road nearest to ``y`` at each of ``x`` f64[n], f64[n]; NaN for none.

    Args:
        path: path of the road.
        x: metres along it.
        y: metres left of its centre line.
        obstacles: f64[m, 6], see ``camera_path``.
    """
    heading = heading_at(path, x)[:, None]
    ahead, left = (np.cos(heading), np.sin(heading)), (-np.sin(heading), np.cos(heading))
    middle = to_world(path, x, 0.0) + VIEW / 2 * np.hstack(ahead)
    away = np.moveaxis(middle[:, None] - obstacles[:, :2], -1, 0)
    cos, sin, long, wide = obstacles[:, 2:].T
    spans = []  # along the line across the road, between a rectangle's sides
    for (east, north), reach in (((cos, sin), long), ((-sin, cos), wide)):
        begin, turn, view = (line[0] * east + line[1] * north for line in (away, left, ahead))
        turn = np.where(np.abs(turn) < LEAST, LEAST, turn)
        far = SPARE + reach + VIEW / 2 * np.abs(view)
        sides = np.stack([-far, far])
        spans.append(np.sort((sides - begin) / turn, axis=0))
    (low, high), other = spans
    low, high = np.maximum(low, other[0]), np.minimum(high, other[1])
    result = np.full(len(x), np.nan)
    for k in range(len(x)):
        nearby = (low[k] < high[k]) & (high[k] > -ASIDE) & (low[k] < ASIDE)
        first, last = low[k, nearby], high[k, nearby]
        places = np.concatenate([[y], first, last])
        inside = (places[:, None] > first + LEAST) & (places[:, None] < last - LEAST)
        places = places[~inside.any(axis=1) & (np.abs(places) <= ASIDE)]
        if len(places):
            result[k] = places[np.abs(places - y).argmin()]
    return result


def _driven(first: Camera, x: float, y: float, ground: Ground) -> Camera:
    """The camera ``x`` metres along the road and ``y`` metres left of its centre line."""
    path, z = ground.path, first.position[2] + ground_height(ground, y, x)
    if path.straight:
        return first._replace(position=(x, y, z))
    east, north, heading, _ = place_at(path, x, y)
    rise = math.atan(float(slope_at(path, x)))
    return first._replace(
        position=(east, north, z),
        yaw=first.yaw - heading,
        pitch=first.pitch - rise * math.cos(first.yaw),
        # For a camera that looks to the right, the slope of the car is a roll.
        roll=first.roll + rise * math.sin(first.yaw),
    )
