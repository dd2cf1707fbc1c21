"""The camera of a street: a pinhole, and the path it drives."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from scene.ground.ground import Ground, ground_height
from scene.ground.path import Path, heading_at, place_at, slope_at, to_world

DRIVE = 60.0
"""Metres of road over which the camera takes its shots."""
SEARCH = 24.0
"""Metres further along the road within which a shot may be taken again."""
AGAIN = 4
"""Times that it may be."""
VIEW = 4.0
"""Metres of view that what fills a street leaves free."""
SPARE = 1.0
"""Metres that the camera stands away from all that stands in the street."""
ASIDE = 8.0
"""Metres from the centre line within which it looks for such a place."""
LEAST = 1e-9
"""Slope to a rectangle's side that is not divided by; metres that rounding may move an end."""


class Camera(NamedTuple):
    """A pinhole camera; ``yaw`` right positive, ``pitch`` down positive, ``roll`` clockwise, radians."""

    position: tuple[float, float, float]
    yaw: float
    pitch: float
    roll: float = 0.0
    field_of_view: float | None = None  # horizontal, radians; None: as the dataset's settings say
    exposure: float = 1.0  # factor on the light
    warmth: float = 0.0  # red against blue, stops
    further: tuple[Camera, ...] = ()  # instead of this one, where its shot shows no street
    retaken: int = 0  # times that the shot was taken again
    refused: bool = False  # whether it shows no street all the same


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
    taken: np.ndarray,
    rng: np.random.Generator,
    ground: Ground,
) -> tuple[Camera, ...]:
    """Poses spread over ``DRIVE`` metres, each with those ``further`` along the road that may replace it.

    All stand as far from the centre line as ``first``, or as near to that as ``SPARE`` metres beside all that
    stands there allow. A place with nothing free within ``ASIDE`` metres is left out, unless a shot has no
    other.

    Args:
        first: the camera at the start of the road, its height above the ground.
        shots: how many.
        taken: f64[n, 6] what stands in the street, rows as ``clearance.Rectangle``.
        rng: consumed.
        ground: of the street, whose road the camera follows as if it were fixed to a car.
    """
    along = np.linspace(0.0, SEARCH, 1 + AGAIN)
    x = np.array([(shot + rng.random()) * DRIVE / shots + along for shot in range(shots)])
    y = nearest_free(ground.path, x.ravel(), first.position[1], taken).reshape(x.shape)
    y[np.isnan(y).all(axis=1)] = first.position[1]
    cameras = []
    for places in np.stack([x, y], axis=-1):
        free = places[~np.isnan(places[:, 1])].tolist()
        here, *further = [_driven(first, along, beside, ground) for along, beside in free]
        cameras.append(here._replace(further=tuple(further)))
    return tuple(cameras)


def nearest_free(path: Path, x: np.ndarray, y: float, taken: np.ndarray) -> np.ndarray:
    """Across the road at each of ``x`` f64[n] the place nearest to ``y`` that is free, f64[n]; NaN: none is.

    Args:
        path: of the road.
        x: metres along it.
        y: metres left of its centre line.
        taken: f64[m, 6], see ``camera_path``.
    """
    heading = heading_at(path, x)[:, None]
    left = -np.sin(heading), np.cos(heading)
    away = np.moveaxis(to_world(path, x, 0.0)[:, None] - taken[:, :2], -1, 0)
    cos, sin, long, wide = taken[:, 2:].T
    spans = []  # along the line across the road, between a rectangle's sides
    for (east, north), reach in (((cos, sin), long), ((-sin, cos), wide)):
        begin, turn = (line[0] * east + line[1] * north for line in (away, left))
        turn = np.where(np.abs(turn) < LEAST, LEAST, turn)
        sides = np.stack([-SPARE - reach, SPARE + reach])[:, None]
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
        # Who looks to the right has the car's nose at the left.
        roll=first.roll + rise * math.sin(first.yaw),
    )
