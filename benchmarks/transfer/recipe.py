"""One net of the transfer benchmark: what it is trained on and what it is tested on.

The functions here run in worker processes and are pure in their arguments.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.transfer.ingredients import INGREDIENTS, World, render_world
from common.labels.target_file import find_target
from experiments.targets.folder import parts_of
from scene.attributes import SpaceName
from scene.proposal import draw, streets_named
from scene.render import RenderSettings
from seg.classes import ClassTable, table_of
from seg.data import LabelledImages, load
from seg.inference import score
from seg.pyramid import features
from seg.recipes import RECIPES, with_steps
from seg.settings import TrainSettings
from seg.train import train
from seg.views import view_images

BLOCKS = 5
"""Each group of images is cut into so many stretches; a net trained on real images is tested on one."""


class Recipe(NamedTuple):
    """The same for every net of a table."""

    data: str  # folder of the real images
    target: str | None = None  # as `find_target` takes it
    holdout: str | None = None  # the group of images that is left out
    space: SpaceName = "extended"
    width: int = 240
    height: int = 176
    samples: int = 1  # rays per pixel along each axis
    streets: int = 400
    shots: int = 1  # images per street
    training: str = "lite0-frozen"  # of `seg.recipes`
    steps: int | None = None  # by default the recipe's

    @property
    def train(self) -> TrainSettings:
        """How a net is trained."""
        own = RECIPES[self.training]
        return own if self.steps is None else with_steps(own, self.steps)

    @property
    def classes(self) -> ClassTable:
        """The target's classes."""
        return table_of(find_target(self.target, Path(self.data)))


Result = dict[str, Any]
"""Confusion matrices i64[classes, classes] as lists."""


def call(function: Callable[..., Result], *arguments: Any) -> Result:
    """Calls a function, so that one queue of tasks can hold calls of several functions."""
    return function(*arguments)


@lru_cache(maxsize=1)
def real_images(recipe: Recipe) -> LabelledImages:
    """The labelled images that figures come from: all but those of the split that is reported on or held out.

    Raises:
        UserError: there are none, or the folder is not as its target says.
        DataError: an image or a label cannot be read.
    """
    data = Path(recipe.data)
    target = find_target(recipe.target, data)
    entries = parts_of(target, data, recipe.holdout).entries
    return load(entries, target, (recipe.height, recipe.width))


@lru_cache(maxsize=2)
def _seen(recipe: Recipe, views: bool) -> tuple[np.ndarray, ...] | None:
    """What a frozen trunk sees in the real images, or in all their views."""
    images, settings = real_images(recipe).images, recipe.train
    if not settings.frozen:
        return None
    return features(view_images(images, settings) if views else images, settings)


def sides(recipe: Recipe, block: int) -> tuple[LabelledImages, LabelledImages]:
    """The real images but for a block, with features of all views; and the block, with its own."""
    real = real_images(recipe)
    held = held_out(real.sequences, block)
    return (
        real._replace(features=_seen(recipe, True)).take(np.flatnonzero(~held)),
        real._replace(features=_seen(recipe, False)).take(np.flatnonzero(held)),
    )


def held_out(sequences: tuple[str, ...], block: int) -> np.ndarray:
    """bool[n]: the images of the ``block``-th stretch of every group; small groups are cut as one."""
    names = np.asarray(sequences)
    groups, which, counts = np.unique(names, return_inverse=True, return_counts=True)
    which = np.where(counts[which] < BLOCKS, len(groups), which)
    chosen = np.zeros(len(names), bool)
    for group in np.unique(which):
        chosen[np.array_split(np.flatnonzero(which == group), BLOCKS)[block % BLOCKS]] = True
    return chosen


def world(recipe: Recipe, without: str | None = None) -> World:
    """The engine as it renders by default, or without one ingredient."""
    whole = World(RenderSettings(recipe.width, recipe.height, recipe.samples))
    return whole if without is None else INGREDIENTS[without](whole)


def rendered(
    recipe: Recipe, attributes: str, seed: int, without: str | None = None
) -> LabelledImages:
    """Renders of ``random`` or ``default`` attributes, whole or without one ingredient."""
    units = draw(streets_named(attributes, recipe.space), seed, recipe.streets)
    whole = world(recipe, without)
    return LabelledImages(*render_world(whole, units, seed, recipe.shots, recipe.classes))


def rendered_net(recipe: Recipe, attributes: str, without: str | None, seed: int) -> Result:
    """Trains a net on renders and tests it on real images."""
    own, real, settings = (
        rendered(recipe, attributes, seed, without),
        real_images(recipe),
        recipe.train,
    )
    count, seen = len(recipe.classes.classes), _seen(recipe, False)
    params = train(seed, own.images, own.labels, settings, count)
    found = score(params, real.images, real.labels, settings, count, features=seen)
    return {"real": found.tolist()}


def real_net(recipe: Recipe, seed: int) -> Result:
    """Trains a net on real images and tests it on unseen ones and on hand-set streets."""
    settings, count = recipe.train, len(recipe.classes.classes)
    seen, unseen = sides(recipe, seed)
    params = train(seed, seen.images, seen.labels, settings, count, features=seen.features)
    scores = {}
    for name, own in (("real", unseen), ("renders", rendered(recipe, "default", seed))):
        found = score(params, own.images, own.labels, settings, count, features=own.features)
        scores[name] = found.tolist()
    return scores
