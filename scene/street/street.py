"""A street: assets on lines along a straight road, a ground, a sky, and the camera's path.

Pure in (params, seed). World frame: x along the road (the driving direction), y left, z up, metres; the
road's centre line is the x axis at z = 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.catalogue import AssetPool, in_season, pick
from scene.attributes import StreetParams
from scene.ground.ground import Ground, ground_height, sample_ground
from scene.sky.sky import Sky, sample_sky
from scene.street.background import background
from scene.street.camera import Camera, camera_path
from scene.street.extras import Mix, extras, open_sides
from scene.street.lines import LINES, Setting, line_objects
from scene.street.placing import FIRST_INSTANCE, Placement, Standing, obstacles, placed, pose_at

BACKGROUND, SEASON, CLOUD = 7, 8, 9
"""Streams of random numbers for the background, its leaves, and whether clouds close."""


class Street(NamedTuple):
    """Everything a renderer needs, and nothing about how it renders."""

    placements: tuple[Placement, ...]
    cameras: tuple[Camera, ...]
    sky: Sky
    ground: Ground
    seed: int


def sample_street(
    params: StreetParams,
    seed: int,
    shots: int,
    pool: AssetPool | None = None,
    mix: Mix | None = None,
) -> Street:
    """One street with ``shots`` camera poses along it; the same arguments give the same street.

    Args:
        params: its attributes.
        seed: of all that is left to chance.
        shots: how many.
        pool: assets that it may draw from; None: the whole catalogue.
        mix: shares of what has no attribute; None: ``extras.MIX``.
    """
    pool = pool or AssetPool()
    rng = np.random.default_rng(seed)
    sky = sample_sky(
        rng,
        intensity=params.illumination_intensity,
        elevation=params.illumination_angle_x,
        azimuth=params.illumination_angle_y,
        share=pool.fraction,
        closed=_closed(params, seed),
    )
    drive = -1.0 if rng.random() < params.camera_position_probability else 1.0
    widths = params.road_width, params.sidewalk_width
    ground = sample_ground(rng, pool.fraction, drive, widths)
    setting = Setting(params, ground, pool, drive)
    objects: list[Standing] = []
    is_open = open_sides(setting, seed)
    for line in LINES:
        # A line draws from a generator of its own, so moving one line leaves the others as they are.
        line_rng = np.random.default_rng(rng.integers(2**32))
        for side in (1.0, -1.0):
            row = line_objects(line, side, setting, line_rng)
            objects += [o for o in row if line != "building" or side not in is_open]
    objects += extras(setting, seed, objects, mix)
    near = placed(objects)
    y = drive * params.camera_position_x
    place = (0.0, y, ground_height(ground, y) + params.camera_position_y)
    first = Camera(
        place, params.camera_rotation_y, params.camera_rotation_x, params.camera_roll,
        params.field_of_view, params.exposure, params.white_balance,
    )  # fmt: skip
    # The background is too far away to be in the way.
    cameras = camera_path(first, shots, obstacles(near), rng)
    far_rng, season_rng = (np.random.default_rng([seed, s]) for s in (BACKGROUND, SEASON))
    objects = []
    for stand in background(params, far_rng):
        ref = pick(pool, stand.family, far_rng)
        ref = in_season(stand.family, ref, params.bare_tree_share, pool, season_rng)
        if ref is not None:
            objects.append((stand.family, ref, pose_at(ground, stand.x, stand.y, stand.yaw)))
    far = placed(objects, FIRST_INSTANCE + len(near))
    return Street((*near, *far), cameras, sky, ground, seed)


def _closed(params: StreetParams, seed: int) -> bool | None:
    """Whether cloud covers the whole sky of a street; None leaves it to the table of skies."""
    if params.overcast_share is None:
        return None
    return bool(np.random.default_rng([seed, CLOUD]).random() < params.overcast_share)
