"""Trains a network once, then fine-tunes it on several subsets of the real images.

The functions here run in worker processes; they are pure in their arguments.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from experiments.evaluation.in_worker import attempt, core_seconds, tested, timed_set, trained
from experiments.evaluation.job import Recipe, Result, Start
from experiments.evaluation.renders import Rendered
from seg.data import LabelledImages
from seg.step import Params
from seg.train import TrainingError


def transfer(
    start: Start,
    fine: Recipe,
    seed: int,
    images: LabelledImages,
    chosen: Sequence[np.ndarray],
    real: LabelledImages,
    ready: Rendered | None = None,
) -> list[Result]:
    """Train a network once, fine-tune it on each subset, and test each result.

    Args:
        start: the training before the fine-tuning.
        fine: how the network is fine-tuned.
        seed: seed of the streets and of all training.
        images: the images for fine-tuning.
        chosen: indices of each subset, i64[images of the subset].
        real: images to test on.
        ready: the rendered set of the first training, if renderers made it.

    Returns:
        One result per subset. The first one includes the time before the fine-tuning.
    """
    began = core_seconds()
    render_seconds, params = 0.0, None
    if start.streets is not None:
        try:
            rendered_images, render_seconds = timed_set(start.recipe, start.streets, seed, ready)
            began = core_seconds()
            params = trained(start.recipe, rendered_images, seed)
        except TrainingError as error:
            spent = core_seconds() - began
            return [Result(math.nan, [], render_seconds, spent, str(error)) for _ in chosen]
    spent = core_seconds() - began
    results = []
    for indices in chosen:
        result = attempt(_tune, start, fine, params, seed, images.take(indices), real)
        results.append(
            result._replace(
                render_seconds=render_seconds, train_seconds=result.train_seconds + spent
            )
        )
        render_seconds = spent = 0.0
    return results


def _tune(
    start: Start,
    fine: Recipe,
    params: Params | None,
    seed: int,
    images: LabelledImages,
    real: LabelledImages,
) -> Result:
    began = core_seconds()
    if start.on_subset:
        params = trained(start.recipe, images, seed)
    tuned = trained(fine, images, seed, params)
    return tested(fine, tuned, real, 0.0, core_seconds() - began)
