"""What a rendered world is made of, and the same world with one ingredient left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from scene.catalogue import AssetPool
from scene.dataset import street_of
from scene.render import RenderSettings, renderer
from scene.sensor import CameraResponse
from scene.street import Street
from seg.classes import class_table

CLEAR = 1e9
"""Metres of haze at which nothing fades."""


class World(NamedTuple):
    """Everything about a rendered dataset but its attributes and its seed."""

    settings: RenderSettings
    pool: AssetPool = AssetPool()
    alter: tuple[Callable[[Street], Street], ...] = ()  # done to every street before it is rendered


Change = Callable[[World], World]


def _settings(**changes: Any) -> Change:
    return lambda world: world._replace(settings=world.settings._replace(**changes))


def _share(fraction: float) -> Change:
    return lambda world: world._replace(pool=world.pool._replace(fraction=fraction))


def _street(change: Callable[[Street], Street]) -> Change:
    return lambda world: world._replace(alter=(*world.alter, change))


def without_haze(street: Street) -> Street:
    """The same street in clear air."""
    return street._replace(sky=street.sky._replace(haze=CLEAR))


INGREDIENTS: dict[str, Change] = {
    "texture": _settings(textures=False),
    "shadow": _settings(shadows=False),
    "ambient occlusion": _settings(occlusion=False),
    "shadow and occlusion": _settings(shadows=False, occlusion=False),
    "camera effects": _settings(response=CameraResponse(noise=0.0)),
    "oversampling": _settings(samples=1),
    "haze": _street(without_haze),
    "half of the assets": _share(0.5),
    "three quarters of the assets": _share(0.25),
    "nine tenths of the assets": _share(0.1),
}
"""Ingredient -> the world without it."""


def render_world(
    world: World, units: np.ndarray, seed: int, shots: int, table: str
) -> tuple[np.ndarray, np.ndarray]:
    """Images u8[n, h, w, 3] and labels u8[n, h, w] in the ids of a class table.

    Args:
        world: what to render.
        units: f32[streets, 23] attributes.
        seed: of the streets; worlds rendered with the same seed show the same streets.
        shots: images per street.
        table: name of the class table.
    """
    engine = renderer("embree")
    images, labels = [], []
    for index, unit in enumerate(units):
        street = street_of(unit, seed, index, shots, world.pool)
        for change in world.alter:
            street = change(street)
        for frame in engine.render(street, world.settings):
            images.append(frame.image)
            labels.append(frame.label)
    return np.stack(images), class_table(table).from_train_id[np.stack(labels)]
