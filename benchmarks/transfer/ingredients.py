"""The ingredients of a rendered world, and the same world with one ingredient left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from scene.assets.catalogue import AssetPool
from scene.attributes import StreetParams, street_params
from scene.dataset.render import street_of
from scene.ground.ground import plain, sample_ground
from scene.ground.path import nearest
from scene.outline import outlined
from scene.render import RenderSettings, renderer
from scene.sky.sky import sample_sky
from scene.street.background import BEHIND, LINES_END
from scene.street.instances import FIRST_INSTANCE
from scene.street.street import Street
from seg.classes import ClassTable

CLEAR = 1e9
"""Metres of haze at which nothing fades."""

Alteration = Callable[[Street, StreetParams], Street]


class World(NamedTuple):
    """Everything about a rendered dataset but its attributes and its seed."""

    settings: RenderSettings
    pool: AssetPool = AssetPool()
    alterations: tuple[Alteration, ...] = ()  # done to every street before it is rendered


Change = Callable[[World], World]


def _settings(**changes: Any) -> Change:
    return lambda world: world._replace(settings=world.settings._replace(**changes))


def _camera(**changes: Any) -> Change:
    def change(world: World) -> World:
        response = world.settings.response._replace(**changes)
        return world._replace(settings=world.settings._replace(response=response))

    return change


def _share(fraction: float) -> Change:
    return lambda world: world._replace(pool=world.pool._replace(fraction=fraction))


def _street(alteration: Alteration) -> Change:
    return lambda world: world._replace(alterations=(*world.alterations, alteration))


def clear_air(street: Street, params: StreetParams) -> Street:
    """The street with nothing fading in the distance."""
    return street._replace(sky=street.sky._replace(haze=CLEAR))


def dry_road(street: Street, params: StreetParams) -> Street:
    """The street after the rain has dried."""
    return street._replace(sky=street.sky._replace(wetness=0.0))


def first_weather(street: Street, params: StreetParams) -> Street:
    """The street in the first of all weathers, whatever it had."""
    sky = sample_sky(
        np.random.default_rng(street.seed),
        intensity=params.illumination_intensity,
        elevation=params.illumination_angle_x,
        azimuth=params.illumination_angle_y,
        share=0.0,
    )
    return street._replace(sky=sky)


def first_surfaces(street: Street, params: StreetParams) -> Street:
    """The street with the first of all roads, sidewalks and terrains."""
    first = sample_ground(np.random.default_rng(street.seed), share=0.0)
    ground = street.ground._replace(road=first.road, sidewalk=first.sidewalk, terrain=first.terrain)
    return street._replace(ground=ground)


def bare_ground(street: Street, params: StreetParams) -> Street:
    """The street without markings, repairs, driveways, side streets and hills."""
    return street._replace(ground=plain(street.ground))


def lines_only(street: Street, params: StreetParams) -> Street:
    """The street without what closes its horizon, which stands behind the lines."""
    places = np.array([p.pose[:2, 3] for p in street.placements])
    along, away = nearest(street.ground.path, places)
    stay = np.flatnonzero((along < LINES_END) & (away < BEHIND))
    near = (street.placements[k]._replace(instance=i) for i, k in enumerate(stay, FIRST_INSTANCE))
    return street._replace(placements=tuple(near))


INGREDIENTS: dict[str, Change] = {
    "texture": _settings(textures=False),
    "shadow": _settings(shadows=False),
    "ambient occlusion": _settings(occlusion=False),
    "shadow and occlusion": _settings(shadows=False, occlusion=False),
    "oversampling": _settings(samples=1),
    "lens and sensor defects": _camera(
        blur=0.0, noise=0.0, vignette=0.0, fringe=0.0, halo=0.0, jpeg=0
    ),
    "metering and contrast": _camera(meter=0.0, contrast=1.0),
    "variety of cameras": _camera(variation=0.0),
    "haze": _street(clear_air),
    "wet roads": _street(dry_road),
    "variety of weather": _street(first_weather),
    "variety of surfaces": _street(first_surfaces),
    "markings and repairs": _street(bare_ground),
    "background": _street(lines_only),
    "half of the assets": _share(0.5),
    "3/4 of the assets": _share(0.25),
    "9/10 of the assets": _share(0.1),
}
"""Ingredient -> the world without it."""


def render_world(
    world: World, units: np.ndarray, seed: int, shots: int, table: ClassTable
) -> tuple[np.ndarray, np.ndarray]:
    """Images u8[n, h, w, 3] and labels u8[n, h, w] in the ids of a class table.

    Args:
        world: what to render.
        units: f32[streets, attributes].
        seed: of the streets; worlds rendered with the same seed show the same streets.
        shots: images per street.
        table: the classes.
    """
    engine = renderer("embree")
    images, labels = [], []
    for index, unit in enumerate(units):
        street = street_of(unit, seed, index, shots, world.pool)
        for alter in world.alterations:
            street = alter(street, street_params(unit))
        for frame in engine.render(street, world.settings):
            images.append(frame.image)
            labels.append(outlined(frame, table.outlines).label)
    return np.stack(images), table.from_train_id[np.stack(labels)]
