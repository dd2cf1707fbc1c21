"""A street: assets on lines along a road, a ground, a sky, and the camera's path.

Pure in (params, seed). World frame: x along the road where it begins (the driving direction), y left, z up,
metres; the centre line of a straight, level road is the x axis at z = 0. Everything is placed in road
coordinates (``ground/path.py``).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.catalogue import AssetPool, in_season, pick
from scene.assets.library import snapshot
from scene.attributes import StreetParams
from scene.ground.arms import with_junction
from scene.ground.ground import Ground, sample_ground
from scene.ground.junction import sample_junction
from scene.ground.path import folded, sample_path
from scene.sky.sky import Sky, sample_sky
from scene.streams import child, stream
from scene.street.background import background, belt
from scene.street.camera import Camera, camera_path
from scene.street.clearing import cleared
from scene.street.extras import Mix, extras, open_sides
from scene.street.junction import junction_objects, with_room
from scene.street.lines import LINES, Setting, line_objects
from scene.street.placing import (
    FIRST_INSTANCE,
    Placement,
    Standing,
    doors_at_the_kerb,
    placed,
    pose_at,
    settled,
    taken,
)


class Street(NamedTuple):
    """Everything a renderer needs, and nothing about how it renders."""

    placements: tuple[Placement, ...]
    cameras: tuple[Camera, ...]  # one a shot, see ``Camera.further``
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
    pool = pool._replace(own=snapshot(pool.own))  # here, for all objects of the street
    rng = stream(seed, "street")
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
    ground = _shaped(ground, params, seed)
    setting = Setting(params, ground, pool, drive)
    objects: list[Standing] = []
    is_open = open_sides(setting, seed)
    for line in LINES:
        # A line draws from a generator of its own, so moving one line leaves the others as they are.
        line_rng = child(rng)
        for side in (1.0, -1.0):
            row = line_objects(line, side, setting, line_rng)
            objects += [o for o in row if line != "building" or side not in is_open]
    corners = junction_objects(setting, stream(seed, "corners"))
    objects = cleared(ground, objects, corners)
    corners = with_room(setting, objects, corners)
    objects = [*objects, *corners]
    objects += cleared(ground, extras(setting, seed, objects, mix), corners)
    objects = settled(ground, objects, params.building_position)
    near = placed(doors_at_the_kerb(objects, drive), path=ground.path)
    place = (0.0, drive * params.camera_position_x, params.camera_position_y)
    first = Camera(
        place, params.camera_rotation_y, params.camera_rotation_x, params.camera_roll,
        params.field_of_view, params.exposure, params.white_balance,
    )  # fmt: skip
    # The background is too far away to be in the way.
    cameras = camera_path(first, shots, taken(near), rng, ground)
    far_rng, season_rng = stream(seed, "background"), stream(seed, "season")
    objects = []
    stands = background(params, far_rng)
    if not ground.path.straight:
        places = np.array([(stand.x, stand.y) for stand in stands])
        lost = folded(ground.path, *places.T)
        stands = [stand for stand, away in zip(stands, lost, strict=True) if not away]
        stands += belt(ground.path, params, far_rng)
    for stand in stands:
        ref = pick(pool, stand.family, far_rng)
        if ref is not None:
            ref = in_season(stand.family, ref, params.bare_tree_share, pool, season_rng)
            objects.append((stand.family, ref, pose_at(ground, stand.x, stand.y, stand.yaw)))
    objects = cleared(ground, objects, corners)
    objects = settled(ground, objects, params.building_position)
    far = placed(objects, FIRST_INSTANCE + len(near), ground.path)
    return Street((*near, *far), cameras, sky, ground, seed)


def _shaped(ground: Ground, params: StreetParams, seed: int) -> Ground:
    """The ground with its course, and by chance a junction."""
    rng = stream(seed, "junction")
    junction = sample_junction(rng, params.junction_share, ground.half_width, ground.footway)
    rng = stream(seed, "course")
    calm = junction.x if junction else None
    path = sample_path(rng, params.bend / 1000, params.gradient / 100, calm)
    ground = ground._replace(path=path)
    return with_junction(ground, junction) if junction else ground


def _closed(params: StreetParams, seed: int) -> bool | None:
    """Whether cloud covers the whole sky of a street; None leaves it to the table of skies."""
    if params.overcast_share is None:
        return None
    return bool(stream(seed, "cloud").random() < params.overcast_share)
