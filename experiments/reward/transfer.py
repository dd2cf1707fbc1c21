"""One net's way: pre-trained once, then fine-tuned on several subsets of the real images.

The functions here run in worker processes; they are pure in their arguments.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from experiments.reward.miou import Outcome, Recipe, attempt, scored, trained, training_set
from experiments.reward.truth import Shared, loaded, part_of
from scene.proposal import Streets
from seg.data import LabelledImages
from seg.train import Params, TrainingError

SUBSET_STREAM = 3
"""Second word of the seed that chooses images, apart from the streams of the nets."""


class Start(NamedTuple):
    """What a net does before it is fine-tuned."""

    recipe: Recipe  # sizes, net and training, as on a rendered dataset
    proposal: Streets | None  # of that dataset; None begins at the fine-tuning
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
    fine: Recipe,
    seed: int,
    real: LabelledImages | Shared,
    chosen: Sequence[np.ndarray],
    truth: LabelledImages | Shared,
) -> list[Outcome]:
    """Pre-train a net once, fine-tune it on each subset, score every result.

    Args:
        start: what comes before the fine-tuning.
        fine: how the net is fine-tuned.
        seed: of the streets and of all training.
        real: images to fine-tune on; their subsets are given by index.
        chosen: i64[images of the subset] each.
        truth: what to score on.

    Returns:
        One outcome a subset. The time of pre-training is in the first one.
    """
    began = time.perf_counter()
    images: LabelledImages = loaded(real)
    scoring: LabelledImages = loaded(truth)
    rendered, params = 0.0, None
    if start.proposal is not None:
        try:
            own = training_set(start.recipe, start.proposal, seed)
            rendered = time.perf_counter() - began
            params = trained(start.recipe, own, seed)
        except TrainingError as error:
            spent = time.perf_counter() - began
            return [Outcome(math.nan, [], 0.0, spent, str(error)) for _ in chosen]
    spent = time.perf_counter() - began - rendered
    outcomes = []
    for indices in chosen:
        found = attempt(_tune, start, fine, params, seed, part_of(images, indices), scoring)
        outcomes.append(
            found._replace(render_seconds=rendered, train_seconds=found.train_seconds + spent)
        )
        rendered = spent = 0.0
    return outcomes


def _tune(
    start: Start,
    fine: Recipe,
    params: Params | None,
    seed: int,
    own: LabelledImages,
    truth: LabelledImages,
) -> Outcome:
    began = time.perf_counter()
    if start.on_subset:
        params = trained(start.recipe, own, seed)
    tuned = trained(fine, own, seed, params)
    return scored(fine, tuned, truth, 0.0, time.perf_counter() - began)
