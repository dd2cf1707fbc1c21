"""One network of the transfer benchmark: what it is trained on and what it is tested on.

The functions here run in worker processes and are pure in their arguments.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from common.labels.target_file import find_target
from experiments.targets.folder import parts_of
from scene.attributes import SpaceName
from scene.dataset.render import render_dataset
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
"""Each group of images is cut into so many stretches; a network trained on real images is tested on one."""


class Recipe(NamedTuple):
    """What all networks of a table share."""

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
        """The training settings of a network."""
        settings = RECIPES[self.training]
        return settings if self.steps is None else with_steps(settings, self.steps)

    @property
    def classes(self) -> ClassTable:
        """The classes of the target."""
        return table_of(find_target(self.target, Path(self.data)))


Result = dict[str, Any]
"""Confusion matrices i64[classes, classes] as lists."""


def call(function: Callable[..., Result], *arguments: Any) -> Result:
    """Call a function, so that one queue of tasks can hold calls of several functions."""
    return function(*arguments)


@lru_cache(maxsize=1)
def real_images(recipe: Recipe) -> LabelledImages:
    """Read the labelled images to evaluate on: all but the reported split or the held-out group.

    Raises:
        UserError: there are none, or the folder does not match its target.
        DataError: an image or a label cannot be read.
    """
    data = Path(recipe.data)
    target = find_target(recipe.target, data)
    entries = parts_of(target, data, recipe.holdout).entries
    return load(entries, target, (recipe.height, recipe.width))


@lru_cache(maxsize=2)
def _features(recipe: Recipe, views: bool) -> tuple[np.ndarray, ...] | None:
    """Compute the features of the real images, or of all their views, if the backbone is frozen."""
    images, settings = real_images(recipe).images, recipe.train
    if not settings.frozen:
        return None
    return features(view_images(images, settings) if views else images, settings)


def sides(recipe: Recipe, block: int) -> tuple[LabelledImages, LabelledImages]:
    """Split the real images into all but a block, with features of all views, and the block."""
    real = real_images(recipe)
    is_held_out = held_out(real.sequences, block)
    return (
        real._replace(features=_features(recipe, True)).take(np.flatnonzero(~is_held_out)),
        real._replace(features=_features(recipe, False)).take(np.flatnonzero(is_held_out)),
    )


def held_out(sequences: tuple[str, ...], block: int) -> np.ndarray:
    """Mark the images of the ``block``-th stretch of every group, bool[n]; small groups count as one."""
    names = np.asarray(sequences)
    groups, which, counts = np.unique(names, return_inverse=True, return_counts=True)
    which = np.where(counts[which] < BLOCKS, len(groups), which)
    chosen = np.zeros(len(names), bool)
    for group in np.unique(which):
        chosen[np.array_split(np.flatnonzero(which == group), BLOCKS)[block % BLOCKS]] = True
    return chosen


def rendered(recipe: Recipe, attributes: str, seed: int) -> LabelledImages:
    """Render ``random`` or ``default`` streets."""
    units = draw(streets_named(attributes, recipe.space), seed, recipe.streets)
    settings, table = RenderSettings(recipe.width, recipe.height, recipe.samples), recipe.classes
    renders = render_dataset(
        units, seed, shots=recipe.shots, settings=settings, outlines=table.outlines
    )
    return LabelledImages(renders.images, table.from_train_id[renders.labels])


def rendered_net(recipe: Recipe, attributes: str, seed: int) -> Result:
    """Train a network on renders and test it on real images."""
    renders, real, settings = rendered(recipe, attributes, seed), real_images(recipe), recipe.train
    count, maps = len(recipe.classes.classes), _features(recipe, False)
    params = train(seed, renders.images, renders.labels, settings, count)
    confusion = score(params, real.images, real.labels, settings, count, features=maps)
    return {"real": confusion.tolist()}


def real_net(recipe: Recipe, seed: int) -> Result:
    """Train a network on real images and test it on held-out ones and on default streets."""
    settings, count = recipe.train, len(recipe.classes.classes)
    training, held_out_images = sides(recipe, seed)
    params = train(
        seed, training.images, training.labels, settings, count, features=training.features
    )
    scores = {}
    for name, images in (("real", held_out_images), ("renders", rendered(recipe, "default", seed))):
        confusion = score(
            params, images.images, images.labels, settings, count, features=images.features
        )
        scores[name] = confusion.tolist()
    return scores
