"""The credit of every street of a pool: how much a linear net gains on real images from more like it.

The functions run in worker processes, on some images at a time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from experiments.evaluation.cache import statistics_of
from experiments.evaluation.cached import Cached
from experiments.evaluation.job import Recipe, Result, scored
from scene.workers import Workers
from seg.linear import Moments, cell_labels, credits, moments, tested
from seg.pyramid import Statistics

CHUNK = 16
"""Images per task of a worker."""


def credited(
    workers: Workers,
    recipe: Recipe,
    streets: Cached,
    real: Cached,
    few: tuple[Cached, int, float] | None = None,
) -> Result:
    """Solve a linear net for the streets of a pool, test it, and find the credit of each street.

    Sums are taken in the order of the streets, so that they do not depend on the number of workers.

    Args:
        workers: the workers.
        recipe: the trunk, with one view of each image, and the classes, in the form for workers.
        streets: one shot of each street, with features.
        real: the images that give the reward, with features, whose mean and deviation normalise all.
        few: labelled images that every training set has, their number, and their share of it.

    Returns:
        The mIoU of the net, with the credits: the gain in mIoU for each unit of a street's share of the set,
        f32[streets]; without labelled images they add up to 0.
    """
    started, spent = time.perf_counter(), 0.0

    def all_of(
        function: Callable[..., Any], images: Cached, number: int, *rest: Any
    ) -> Iterator[Any]:
        nonlocal spent
        tasks = [(images, start, recipe, *rest) for start in range(0, number, CHUNK)]
        found = dict(workers.map(function, tasks, net=True))
        spent += sum(seconds for _, seconds in found.values())
        return (found[index][0] for index in range(len(tasks)))

    def summed(images: Cached, number: int) -> Moments:
        own = list(all_of(_moments, images, number, statistics))
        return Moments(*(np.sum(part, axis=0, dtype=np.float64) for part in zip(*own, strict=True)))

    ((_, statistics),) = workers.map(statistics_of, [(real,)], net=True)
    number = recipe.fidelity.streets
    training = summed(streets, number)
    if few is not None:
        images, count, share = few
        beside = summed(images, count)
        weight = share / (1 - share) * training.counts.sum() / max(beside.counts.sum(), 1)
        training = training + beside.times(weight)
    training = Moments(*(part.astype(np.float32) for part in training))
    ((_, (confusion, slope)),) = workers.map(
        _tested, [(training, real, recipe, statistics)], net=True
    )
    own = np.concatenate(list(all_of(_credits, streets, number, statistics, slope)))
    seconds = max(spent, time.perf_counter() - started)
    found = tuple((own * number).astype(np.float32).tolist())
    return scored(confusion, 0.0, seconds)._replace(credits=found)


def _images(held: Cached, start: int, recipe: Recipe) -> tuple[Any, np.ndarray]:
    """Features and cell labels of some of the images."""
    own = held.load().between(start, start + CHUNK)
    assert own.features is not None
    return own.features, cell_labels(own.labels, recipe.fidelity.train)


def _moments(
    held: Cached, start: int, recipe: Recipe, statistics: Statistics
) -> tuple[Moments, float]:
    began = time.process_time()
    classes = len(recipe.classes.classes)
    own = moments(*_images(held, start, recipe), statistics, recipe.fidelity.train, classes)
    return own, time.process_time() - began


def _tested(
    training: Moments, real: Cached, recipe: Recipe, statistics: Statistics
) -> tuple[np.ndarray, Moments]:
    own = real.load()
    assert own.features is not None
    train = recipe.fidelity.train
    return tested(training, own.features, cell_labels(own.labels, train), statistics, train)


def _credits(
    held: Cached, start: int, recipe: Recipe, statistics: Statistics, slope: Moments
) -> tuple[np.ndarray, float]:
    began = time.process_time()
    own = credits(slope, *_images(held, start, recipe), statistics, recipe.fidelity.train)
    return own, time.process_time() - began
