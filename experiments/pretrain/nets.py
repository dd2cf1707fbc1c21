"""One net's way: pre-trained once, then fine-tuned on several subsets of the real images.

The functions here run in worker processes; they are pure in their arguments.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from experiments.config import Stage
from experiments.outcome import Outcome, attempt
from experiments.reward import Evaluation, Truth, render
from scene.assets.catalogue import AssetPool
from seg.classes import class_table
from seg.train import Params, TrainingError, TrainSettings, score, train

SUBSET_STREAM = 3
"""Second word of the seed that chooses images, apart from the streams of the nets."""


class Start(NamedTuple):
    """What a net does before it is fine-tuned."""

    stage: Stage  # sizes, net and training, as on a rendered dataset
    units: np.ndarray | None  # f32[streets, 23] of that dataset; None begins at the fine-tuning
    on_subset: bool = False  # instead train as many steps on the real images it is to be tuned on


def subsets(images: int, fractions: Sequence[float], seed: int) -> list[np.ndarray]:
    """Indices of the images of each fraction, ascending; smaller subsets lie within larger ones.

    Args:
        images: how many there are.
        fractions: shares of them in (0, 1].
        seed: of the choice.
    """
    order = np.random.default_rng([seed, SUBSET_STREAM]).permutation(images)
    return [np.sort(order[: chosen_images(images, fraction)]) for fraction in fractions]


def chosen_images(images: int, fraction: float) -> int:
    """How many images a fraction stands for, rounded."""
    return math.floor(images * fraction + 0.5)


def transfer(
    start: Start,
    fine: TrainSettings,
    renderer: str,
    pool: AssetPool,
    seed: int,
    real: Truth,
    chosen: Sequence[np.ndarray],
    truth: Truth,
) -> list[Outcome]:
    """Pre-train a net once, fine-tune it on each subset, score every result.

    Args:
        start: what comes before the fine-tuning.
        fine: how the net is fine-tuned.
        renderer: name of the renderer.
        pool: the assets that may appear.
        seed: of the streets and of all training.
        real: images to fine-tune on; their subsets are given by index.
        chosen: i64[images of the subset] each.
        truth: what to score on.

    Returns:
        One outcome a subset. The time of pre-training is in the first one.
    """
    began = time.perf_counter()
    rendered, params = 0.0, None
    if start.units is not None:
        try:
            dataset = render(start.stage, renderer, pool, start.units, seed)
            labels = class_table(fine.table).from_train_id[dataset.labels]
            rendered = time.perf_counter() - began
            params = train(seed, dataset.images, labels, _settings(start, fine))
        except TrainingError as error:
            spent = time.perf_counter() - began
            return [Outcome(math.nan, [], 0.0, spent, str(error)) for _ in chosen]
    spent = time.perf_counter() - began - rendered
    outcomes = []
    for indices in chosen:
        images = Truth(real.images[indices], real.labels[indices])
        found = attempt(_tune, start, fine, params, seed, images, truth)
        outcomes.append(
            found._replace(render_seconds=rendered, train_seconds=found.train_seconds + spent)
        )
        rendered = spent = 0.0
    return outcomes


def _settings(start: Start, fine: TrainSettings) -> TrainSettings:
    """Of the training before, in the classes of the target."""
    return replace(start.stage.train, table=fine.table)


def _tune(
    start: Start, fine: TrainSettings, params: Params | None, seed: int, real: Truth, truth: Truth
) -> Evaluation:
    began = time.perf_counter()
    if start.on_subset:
        params = train(seed, *real, _settings(start, fine))
    tuned = train(seed, *real, fine, params=params)
    return Evaluation(score(tuned, *truth, fine), 0.0, time.perf_counter() - began)
