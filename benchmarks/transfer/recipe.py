"""The networks of the transfer benchmark: what they are trained on and what they are tested on."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import scene
import seg
from benchmarks.networks import Line, store
from common.labels.target_file import find_target
from experiments.targets.folder import parts_of
from scene.attributes import SpaceName
from scene.dataset.render import render_dataset
from scene.proposal import draw, streets_named
from scene.render import RenderSettings
from seg.classes import ClassTable, table_of
from seg.data import LabelledImages, load
from seg.inference import score
from seg.pyramid import prediction_features, training_features
from seg.recipes import RECIPES, with_steps
from seg.settings import TrainSettings
from seg.step import Params
from seg.train import train

Scores = dict[str, list]
"""Confusion matrices i64[classes, classes] as lists, by what the network is tested on."""
ATTRIBUTES = ("random", "default")
REAL = "real"
NETS = "nets.jsonl"
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


def engine() -> str:
    """Hash the sources that results depend on: tables are made while the engine is being changed."""
    folders = (Path(package.__path__[0]) for package in (scene, seg))
    sources = sorted(path for folder in folders for path in folder.rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]


def key(recipe: Recipe, engine: str, name: str, seed: int) -> dict[str, Any]:
    """Everything that a network depends on."""
    return {"engine": engine, "recipe": recipe._asdict(), "net": name, "seed": seed}


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
    return (training_features if views else prediction_features)(images, settings)


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


def networks(
    recipe: Recipe, seed: int, names: Sequence[str], engine: str, folder: Path
) -> list[Line]:
    """Train and test a network on random or default streets, or on real images; runs in a worker."""
    lines = []
    for name in names:
        scores = _of_real(recipe, seed) if name == REAL else _of_renders(recipe, name, seed)
        line = {"key": key(recipe, engine, name, seed), "scores": scores}
        store(folder / NETS, line)
        lines.append(line)
    return lines


def _of_renders(recipe: Recipe, attributes: str, seed: int) -> Scores:
    """Train a network on renders and test it on real images."""
    renders, real = rendered(recipe, attributes, seed), real_images(recipe)
    params = _trained(recipe, renders, seed)
    return {"real": _score(recipe, params, real._replace(features=_features(recipe, False)))}


def _of_real(recipe: Recipe, seed: int) -> Scores:
    """Train a network on real images and test it on held-out ones and on default streets."""
    training, held_out_images = sides(recipe, seed)
    params, renders = _trained(recipe, training, seed), rendered(recipe, "default", seed)
    return {
        "real": _score(recipe, params, held_out_images),
        "renders": _score(recipe, params, renders),
    }


def _trained(recipe: Recipe, images: LabelledImages, seed: int) -> Params:
    count = len(recipe.classes.classes)
    return train(seed, *images[:2], recipe.train, count, features=images.features)


def _score(recipe: Recipe, params: Params, images: LabelledImages) -> list:
    count = len(recipe.classes.classes)
    return score(params, *images[:2], recipe.train, count, features=images.features).tolist()
