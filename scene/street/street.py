"""A street: assets on lines along a road, a ground, a sky, and the camera's path.

It is a pure function of (params, seed). World frame in metres: x along the road at its start (the driving
direction), y left, z up; the centre line of a straight, level road is the x axis at z = 0. All objects are
placed in road coordinates (``ground/path.py``).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.catalogue import AssetPool, asset_at, in_season, refuse_unknown
from scene.assets.library import snapshot
from scene.attributes import StreetParams
from scene.ground.arms import with_junction
from scene.ground.ground import Ground, sample_ground, with_sides
from scene.ground.junction import sample_junction
from scene.ground.path import folded, sample_path
from scene.sky.sky import Sky, sample_sky
from scene.streams import stream
from scene.street.background import background, belt
from scene.street.camera import Camera, camera_path, camera_room, places_along
from scene.street.clearing import clear_of_camera, cleared, off_the_road
from scene.street.extras import Mix, extras, open_sides
from scene.street.furniture import own_class
from scene.street.instances import Placement, Stand, placed, standing
from scene.street.junction import junction_objects
from scene.street.lines import lines_of, moves
from scene.street.plot import SPARE, Plot, Setting


class Street(NamedTuple):
    """Everything that a renderer needs, except its settings."""

    placements: tuple[Placement, ...]
    cameras: tuple[Camera, ...]  # one per shot, see ``Camera.further``
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
    """Sample a street with ``shots`` camera poses along it; the same arguments give the same street.

    Args:
        params: its attributes.
        seed: random seed.
        shots: number of shots.
        pool: assets to draw from; None: the whole catalogue.
        mix: probabilities of ingredients without an attribute; None: ``extras.MIX``.

    Raises:
        ValueError: a field of the pool is out of range.
    """
    pool = pool or AssetPool()
    refuse_unknown(pool)
    pool = pool.with_paths(snapshot)  # once for all objects of the street
    rng = stream(seed, "street")
    sky = sample_sky(
        rng,
        intensity=params.illumination_intensity,
        elevation=params.illumination_angle_x,
        azimuth=params.illumination_angle_y,
        share=pool.fraction,
        closed=_closed(params, seed),
        weather_name=pool.weather,
    )
    drive = -1.0 if rng.random() < params.camera_position_probability else 1.0
    widths = params.road_width, params.sidewalk_width
    ground = sample_ground(
        rng, pool.fraction, drive, widths, params.road_wear, params.asphalt_sidewalk_share
    )
    is_open = open_sides(params.open_share, seed)
    fronts = [None if side in is_open else params.building_position for side in (-1.0, 1.0)]
    verges = stream(seed, "verge", 0), stream(seed, "verge", 1)
    ground = with_sides(ground, params.green_verge_share, (fronts[0], fronts[1]), verges)
    ground = _shaped(ground, params, seed)
    lane, x = drive * params.camera_position_x, places_along(shots, rng)
    fixed = params.space == "scenex"
    room = camera_room(ground.path, x[:, 0], lane)[: len(x) * fixed]
    plot = Plot(Setting(params, ground, pool, drive))
    _fill(plot, seed, mix, room, apart=pool.overlap_of(params) == "avoid")
    placements = placed(ground, plot.stands)
    first = Camera(
        (0.0, lane, params.camera_position_y), params.camera_rotation_y, params.camera_rotation_x,
        params.camera_roll, params.field_of_view, params.exposure, params.white_balance,
    )  # fmt: skip
    cameras = camera_path(first, x, standing(placements)[1], ground, fixed)
    return Street(tuple(placements), cameras, sky, ground, seed)


def _fill(plot: Plot, seed: int, mix: Mix | None, room: np.ndarray, apart: bool) -> None:
    """Place all objects of a street.

    Args:
        plot: the street without objects.
        seed: random seed.
        mix: probabilities of ingredients without an attribute.
        room: f64[n, 6] areas that the camera keeps free, see ``camera_room``; empty if it moves aside.
        apart: whether the lines avoid each other.
    """
    setting, ground = plot.street, plot.ground
    front = setting.params.building_position
    is_open = open_sides(setting.params.open_share, seed)
    plot.keep_free(room)

    def placeable(stands: list[Stand]) -> list[Stand]:
        """Move objects out of the camera's way, and leave out houses across a bend."""
        return off_the_road(ground, clear_of_camera(ground.path, stands, room), front)

    corners = placeable(junction_objects(setting, stream(seed, "corners")))
    houses = [stand for stand in corners if stand.family == "building"]
    plot.admit(houses) if apart else plot.add(houses)
    lines = placeable(lines_of(setting, seed, is_open, apart))
    lines = cleared(ground, lines, houses)
    plot.admit(lines, moves(setting, lines)) if apart else plot.add(lines)
    plot.admit([s for s in corners if s.family != "building"], spare=SPARE)
    count = len(plot.stands)
    extras(plot, seed, mix)
    plot.stands[count:] = cleared(ground, plot.stands[count:], houses)
    far = cleared(ground, placeable(_background(setting, seed)), houses)
    plot.admit(far) if apart else plot.add(far)
    if setting.pool.own_class is not None:  # last, so that all other objects stay in place
        count = len(plot.stands)
        own_class(plot, setting.pool.own_class, stream(seed, "own class"))
        plot.stands[count:] = cleared(ground, plot.stands[count:], houses)


def _background(setting: Setting, seed: int) -> list[Stand]:
    """The assets of the background."""
    params, path, pool = setting.params, setting.ground.path, setting.pool
    rng = stream(seed, "background")
    things = background(params, rng)
    if not path.straight:
        places = np.array([(thing.x, thing.y) for thing in things])
        lost = folded(path, *places.T)
        things = [thing for thing, away in zip(things, lost, strict=True) if not away]
        things += belt(path, params, rng)
    shares = rng.random((len(things), 2)).tolist()
    stands: list[Stand] = []
    for thing, (share, season) in zip(things, shares, strict=True):
        ref = asset_at(pool, thing.family, share)
        if ref is not None:
            ref = in_season(thing.family, ref, params.bare_tree_share, pool, season)
            stands.append(Stand(thing.family, ref, thing.x, thing.y, thing.yaw))
    return stands


def _shaped(ground: Ground, params: StreetParams, seed: int) -> Ground:
    """Add the course of the road, and sometimes a junction, to the ground."""
    rng = stream(seed, "junction")
    junction = sample_junction(rng, params.junction_share, ground.half_width, ground.footway)
    rng = stream(seed, "course")
    calm = junction.x if junction else None
    path = sample_path(rng, params.bend / 1000, params.gradient / 100, calm)
    ground = ground._replace(path=path)
    return with_junction(ground, junction) if junction else ground


def _closed(params: StreetParams, seed: int) -> bool | None:
    """Whether cloud covers the whole sky of a street; None: as the table of skies."""
    if params.overcast_share is None:
        return None
    return bool(stream(seed, "cloud").random() < params.overcast_share)
