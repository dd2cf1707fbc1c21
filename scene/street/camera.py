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
"""The most times that a shot is retaken."""
VIEW = 4.0
"""Metres before the camera along which it keeps ``SPARE``, too: the length of a bonnet and a gap."""
SPARE = 1.0
"""Least distance in metres of the camera from all objects of the street."""
ASIDE = 8.0
"""Metres from the centre line within which the camera's place must lie."""
LEAST = 1e-9
"""Least slope to a rectangle's side for a division; metres by which rounding may move an end."""


class Camera(NamedTuple):
    """A pinhole camera; ``yaw`` right positive, ``pitch`` down positive, ``roll`` clockwise, radians."""

    position: tuple[float, float, float]
    yaw: float
    pitch: float
    roll: float = 0.0
    field_of_view: float | None = None  # horizontal, radians; None: that of the dataset's settings
    exposure: float = 1.0  # factor of the light
    warmth: float = 0.0  # red against blue, stops
    further: tuple[Camera, ...] = ()  # replacements if its shot shows no street
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
    """Metres along the road f64[shots, 1 + AGAIN] of each shot's place and its replacements.

    The shots are spread over ``DRIVE`` metres; consumes ``rng``.
    """
    along = np.linspace(0.0, SEARCH, 1 + AGAIN)
    return np.array([(shot + rng.random()) * DRIVE / shots + along for shot in range(shots)])


def camera_path(
    first: Camera, x: np.ndarray, taken: np.ndarray, ground: Ground, fixed: bool
) -> tuple[Camera, ...]:
    """Poses along the road, each with replacements ``further`` along it.

    All are as far from the centre line as ``first``. Where that is less than ``SPARE`` metres from an object,
    a fixed camera has no replacement, and another one moves to the nearest free place across the road; a
    place without free ground within ``ASIDE`` metres is left out, unless a shot has no other.

    Args:
        first: the camera at the start of the road, with its height above the ground.
        x: f64[shots, 1 + AGAIN] metres along the road, see ``places_along``.
        taken: f64[n, 6] the objects of the street, with rows as ``clearance.Rectangle``.
        ground: the ground, whose road the camera follows as if it were fixed to a car.
        fixed: whether the camera keeps its distance; objects must be clear of its first places.
    """
    lane = first.position[1]
    if fixed:
        solid = Rectangles()
        solid.extend(taken)
        room = camera_room(ground.path, x[:, 1:].ravel(), lane)
        free = [not solid.meet(Rectangle(*row), 0.0) for row in room]
        y = np.full(x.shape, lane)
        y[:, 1:] = np.where(free, lane, np.nan).reshape(len(x), -1)
    else:
        y = nearest_free(ground.path, x.ravel(), lane, taken).reshape(x.shape)
        y[np.isnan(y).all(axis=1)] = lane
    cameras = []
    for places in np.stack([x, y], axis=-1):
        free = places[~np.isnan(places[:, 1])].tolist()
        here, *further = [_driven(first, along, beside, ground) for along, beside in free]
        cameras.append(here._replace(further=tuple(further)))
    return tuple(cameras)


def camera_room(path: Path, x: np.ndarray, y: float) -> np.ndarray:
    """What a camera ``y`` metres left of the centre line at ``x`` f64[n] keeps free: f64[n, 6].

    Rows are as ``clearance.Rectangle``: ``SPARE`` metres around the camera and ``VIEW`` metres before it.
    """
    heading = heading_at(path, x)
    cos, sin = np.cos(heading), np.sin(heading)
    middle = to_world(path, x, y) + VIEW / 2 * np.stack([cos, sin], axis=1)
    size = np.broadcast_to([VIEW / 2 + SPARE, SPARE], middle.shape)
    return np.column_stack([middle, cos, sin, size])


def nearest_free(path: Path, x: np.ndarray, y: float, taken: np.ndarray) -> np.ndarray:
    """The free place across the road nearest to ``y`` at each of ``x`` f64[n], f64[n]; NaN for none.

    Args:
        path: path of the road.
        x: metres along it.
        y: metres left of its centre line.
        taken: f64[m, 6], see ``camera_path``.
    """
    heading = heading_at(path, x)[:, None]
    ahead, left = (np.cos(heading), np.sin(heading)), (-np.sin(heading), np.cos(heading))
    middle = to_world(path, x, 0.0) + VIEW / 2 * np.hstack(ahead)
    away = np.moveaxis(middle[:, None] - taken[:, :2], -1, 0)
    cos, sin, long, wide = taken[:, 2:].T
    spans = []  # along the line across the road, between a rectangle's sides
    for (east, north), reach in (((cos, sin), long), ((-sin, cos), wide)):
        begin, turn, view = (line[0] * east + line[1] * north for line in (away, left, ahead))
        turn = np.where(np.abs(turn) < LEAST, LEAST, turn)
        far = SPARE + reach + VIEW / 2 * np.abs(view)
        sides = np.stack([-far, far])
        spans.append(np.sort((sides - begin) / turn, axis=0))
    (low, high), other = spans
    low, high = np.maximum(low, other[0]), np.minimum(high, other[1])
    found = np.full(len(x), np.nan)
    for k in range(len(x)):
        some = (low[k] < high[k]) & (high[k] > -ASIDE) & (low[k] < ASIDE)
        first, last = low[k, some], high[k, some]
        places = np.concatenate([[y], first, last])
        inside = (places[:, None] > first + LEAST) & (places[:, None] < last - LEAST)
        places = places[~inside.any(axis=1) & (np.abs(places) <= ASIDE)]
        if len(places):
            found[k] = places[np.abs(places - y).argmin()]
    return found


def _driven(first: Camera, x: float, y: float, ground: Ground) -> Camera:
    """The camera ``x`` metres along the road and ``y`` beside its middle."""
    path, z = ground.path, first.position[2] + ground_height(ground, y, x)
    if path.straight:
        return first._replace(position=(x, y, z))
    east, north, heading, _ = place_at(path, x, y)
    rise = math.atan(float(slope_at(path, x)))
    return first._replace(
        position=(east, north, z),
        yaw=first.yaw - heading,
        pitch=first.pitch - rise * math.cos(first.yaw),
        # A camera that looks to the right has the car's front at the left.
        roll=first.roll + rise * math.sin(first.yaw),
    )
