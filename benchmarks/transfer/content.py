"""Hand-set streets with more content, to measure the effect of ingredients of ``scene.street`` on nets."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from benchmarks.transfer.nets import steering_set
from benchmarks.transfer.recipe import CLASSES, TABLE, Recipe, Result, units
from scene.assets.catalogue import AssetPool
from scene.attributes import street_params
from scene.dataset.render import street_seed
from scene.render import RenderSettings, renderer
from scene.street.extras import Mix
from scene.street.street import sample_street
from seg.classes import class_table
from seg.data import LabelledImages
from seg.pyramid import features
from seg.recipes import RECIPES
from seg.train import score, train


class Content(NamedTuple):
    """The differences from the hand-set street."""

    params: MappingProxyType[str, float] = MappingProxyType({})  # fields of ``StreetParams``
    mix: Mix = Mix()


BEFORE = dict.fromkeys(
    ("bend", "gradient", "junction_share", "parked_share", "queue_share", "open_share"), 0.0
)
"""The mix of streets with lines alone."""


def _content(mix: Mix = Mix(), **params: float) -> Content:  # noqa: B008
    return Content(MappingProxyType({**BEFORE, **params}), mix)


PEOPLE = {"groups": 0.35, "benches": 0.2, "crossing": 0.35}
CYCLES = {"riders": 0.4, "cycle_stands": 0.3}
BESIDE = {
    "gardens": 0.4, "shelters": 0.3, "railings": 0.35, "bollards": 0.25, "islands": 0.25,
    "scaffolds": 0.1, "stalls": 0.15,
}  # fmt: skip
LITTLE = {name: share / 2 for name, share in {**PEOPLE, **CYCLES, **BESIDE, "turning": 0.5}.items()}
CONTENTS: dict[str, Content] = {
    "as it was": _content(),
    "view of 80 degrees": _content(field_of_view=math.radians(80)),
    "bends, slopes, junctions": _content(bend=10, gradient=4, junction_share=0.4),
    "parked rows, traffic": _content(Mix(turning=0.5), parked_share=0.4, queue_share=0.4),
    "open roadsides": _content(open_share=0.3),
    "people": _content(Mix(**PEOPLE)),
    "cyclists": _content(Mix(**CYCLES)),
    "what stands beside": _content(Mix(**BESIDE)),
    "a little of all": _content(
        Mix(**LITTLE), bend=5, gradient=2, junction_share=0.2, parked_share=0.25, queue_share=0.2,
        open_share=0.15,
    ),
}  # fmt: skip
"""Row -> content of its streets."""


def content_net(data: Path, recipe: Recipe, name: str, seed: int) -> Result:
    """Train lite0's head on such streets and test it on the real images that may steer the engine."""
    images, labels = rendered(recipe, CONTENTS[name], seed)
    training = RECIPES["lite0-frozen"]
    params = train(seed, images, labels, training, CLASSES)
    real = _real(data, recipe)
    found = score(params, real.images, real.labels, training, CLASSES, features=real.features)
    return {"real": found.tolist()}, None


def rendered(recipe: Recipe, content: Content, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Images u8[n, h, w, 3] and labels u8[n, h, w]; all contents have the same streets for a seed."""
    engine, settings = (
        renderer("embree"),
        RenderSettings(recipe.width, recipe.height, recipe.samples),
    )
    frames = []
    for index, unit in enumerate(units(recipe, "default", seed)):
        params = street_params(unit)._replace(**content.params)
        own = street_seed(seed, index)
        street = sample_street(params, own, recipe.shots, AssetPool(), content.mix)
        frames += engine.render(street, settings)
    labels = np.stack([frame.label for frame in frames])
    return np.stack([frame.image for frame in frames]), class_table(TABLE).from_train_id[labels]


@lru_cache(maxsize=1)
def _real(data: Path, recipe: Recipe) -> LabelledImages:
    real = steering_set(data, recipe)
    return real._replace(features=features(real.images))
