"""One net of the transfer benchmark: its training and its tests.

The functions here run in worker processes and are pure in their arguments.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np

from benchmarks.transfer.closeups import DISTANCE, close_ups
from benchmarks.transfer.ingredients import INGREDIENTS, World, render_world
from scene.proposal import default_proposal, draw, random_proposal
from scene.render import RenderSettings
from seg.classes import class_table
from seg.data import LabelledImages
from seg.train import TrainSettings, predict, score, train

TABLE = "camvid"
CLASSES = len(class_table(TABLE).classes)


class Recipe(NamedTuple):
    """Settings of all nets of a table."""

    width: int = 128
    height: int = 96
    samples: int = 2  # rays per pixel along each axis
    streets: int = 30
    shots: int = 6  # images per street
    steps: int = 600  # of a net trained on renders
    real_steps: int = 1000  # of a net trained on real images
    relaxed: float = 0.15  # width of the intervals around the hand-set street
    close_ups: int = 8  # of each family, for each net
    batch: int = 8


Result = tuple[dict[str, Any], np.ndarray | None]
"""Confusion matrices i64[classes, classes] as lists, and a picture u8[h, w, 3] if there is one."""


def call(function: Callable[..., Result], *arguments: Any) -> Result:
    """Call a function, so that one queue of tasks can hold calls of several functions."""
    return function(*arguments)


def settings(recipe: Recipe, steps: int) -> TrainSettings:
    """The settings of a net's training."""
    return TrainSettings(steps=steps, batch=recipe.batch)


def world(recipe: Recipe, without: str | None = None) -> World:
    """The default world, or the world without one ingredient."""
    whole = World(RenderSettings(recipe.width, recipe.height, recipe.samples))
    return whole if without is None else INGREDIENTS[without](whole)


def units(recipe: Recipe, attributes: str, seed: int) -> np.ndarray:
    """Attributes f32[streets, 23]: ``random``, or relaxed ``default``."""
    proposal = random_proposal() if attributes == "random" else default_proposal(recipe.relaxed)
    return draw(proposal, seed, recipe.streets)


def rendered_net(
    recipe: Recipe, without: str | None, units: np.ndarray, seed: int, real: LabelledImages
) -> Result:
    """Train a net on renders and test it on real images."""
    images, labels = render_world(world(recipe, without), units, seed, recipe.shots, TABLE)
    training = settings(recipe, recipe.steps)
    params = train(seed, images, labels, training, CLASSES)
    return {"real": score(params, real.images, real.labels, training, CLASSES).tolist()}, None


def real_net(
    recipe: Recipe, seen: LabelledImages, unseen: LabelledImages, units: np.ndarray, seed: int
) -> Result:
    """Train a net on real images and test it on unseen ones, on default streets and on close-ups.

    In a close-up only the asset's own pixels count: i64[classes], by predicted class. The picture shows all
    close-ups with the net's predictions.
    """
    training = settings(recipe, recipe.real_steps)
    params = train(seed, seen.images, seen.labels, training, CLASSES)
    whole = world(recipe)
    families, strips = {}, []
    for family in DISTANCE:
        views = close_ups(family, seed, recipe.close_ups, whole.settings)
        images, masks = np.stack([v.image for v in views]), np.stack([v.mask for v in views])
        predicted = predict(params, images, training, CLASSES)
        families[family] = np.bincount(predicted[masks], minlength=CLASSES).tolist()
        strips.append(_strip(family, images, masks, predicted))
    streets = render_world(whole, units, seed, recipe.shots, TABLE)
    scores = {
        "real": score(params, unseen.images, unseen.labels, training, CLASSES).tolist(),
        "renders": score(params, *streets, training, CLASSES).tolist(),
        "close-ups": families,
    }
    return scores, np.concatenate(strips)


def _strip(family: str, images: np.ndarray, masks: np.ndarray, predicted: np.ndarray) -> np.ndarray:
    """Close-ups side by side with the predicted classes below, dimmed outside the asset."""
    colors = class_table(TABLE).colors[predicted]
    colors[~masks] //= 3
    strip = np.concatenate([np.concatenate(list(row), axis=1) for row in (images, colors)])
    white = (255, 255, 255)
    cv2.putText(strip, family, (3, 11), cv2.FONT_HERSHEY_SIMPLEX, 0.4, white, 1, cv2.LINE_AA)
    return strip
