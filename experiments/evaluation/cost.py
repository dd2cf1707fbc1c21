"""Estimates the cost of evaluations in CPU seconds of the machine of `docs/benchmarks.md`.

`experiments.evaluation.pace` compares this machine with that one.
"""

from __future__ import annotations

from typing import NamedTuple

from experiments.config import Fidelity
from experiments.evaluation.job import Job, LabelledSource, StreetPool, rendered_of
from seg.recipes import recipe_for
from seg.settings import TrainSettings

STEP_COST = {"compact": 2.5e-7, "paper": 5e-5, "vgg-adam": 5e-5, "scratch": 5e-5}
STEP_COST |= {"lite0-frozen": 4.5e-8, "lite0-heads": 8e-8, "lite0-tuned": 2e-6}
"""Approximate CPU seconds of one update per pixel of its images, by recipe; of one head."""
CACHE, SPILL = 500_000, 1.8
"""Pixels of a batch of `lite0-frozen` that fit a CPU's cache; how much more each costs above."""
STREET_COST = 0.035
"""CPU seconds of sampling a street and its geometry."""
IMAGE_COST = 0.014, 2.5e-7
"""CPU seconds of rendering an image: of each image, and of each ray."""
VIEW_COST = {"lite0": 2.5e-7, "lite1": 3.1e-7, "lite2": 3.3e-7, "dinov2": 3e-6}
"""CPU seconds per pixel of a frozen backbone's features of one view; other backbones count as lite0."""


COMPILE_COST = 45.0
"""CPU seconds of compiling the renderer, once per installation."""
START_COST = 12.0
"""CPU seconds until a worker has its first result: with its assets and compiled networks."""


class Cost(NamedTuple):
    """CPU seconds of the machine of `docs/benchmarks.md`, which others multiply by a pace each."""

    render: float = 0.0
    train: float = 0.0

    def times(self, count: float) -> Cost:
        """The cost of so many."""
        return Cost(count * self.render, count * self.train)


def cost_of(fidelity: Fidelity) -> float:
    """Estimate the CPU seconds of a network on a rendered dataset, without testing."""
    streets = fidelity.streets * STREET_COST
    return streets + fidelity.images * _image_cost(fidelity) + training_cost(fidelity)


def _image_cost(fidelity: Fidelity) -> float:
    image, ray = IMAGE_COST
    return image + ray * fidelity.width * fidelity.height * fidelity.samples**2


def street_cost(fidelity: Fidelity) -> float:
    """Estimate the CPU seconds of one street of one shot with its features."""
    return STREET_COST + _image_cost(fidelity) + _views_cost(fidelity)


def _views_cost(fidelity: Fidelity) -> float:
    """The cost of a frozen backbone's features of all views of an image."""
    train, pixels = fidelity.train, fidelity.width * fidelity.height
    return pixels * train.views * _view_cost(train) if train.frozen else 0.0


def _view_cost(train: TrainSettings) -> float:
    return VIEW_COST.get(train.net, VIEW_COST["lite0"])


def head_cost(fidelity: Fidelity) -> float:
    """The part of `training_cost` without features: the cost of a network on labelled images or a pool."""
    train = fidelity.train
    pixels = fidelity.width * fidelity.height
    recipe = recipe_for(train)
    step = STEP_COST[recipe]
    if recipe == "lite0-frozen" and pixels * train.batch > CACHE:
        step *= SPILL
    if train.has_backbone and not train.frozen:
        step *= _view_cost(train) / VIEW_COST["lite0"]
    return pixels * step * train.steps * train.batch * train.heads


def training_cost(fidelity: Fidelity) -> float:
    """The part of `cost_of` without the images."""
    return fidelity.images * _views_cost(fidelity) + head_cost(fidelity)


def prepare_cost(fidelity: Fidelity, images: int) -> Cost:
    """The cost of a frozen backbone's features of labelled images, to train on and to test on."""
    if not fidelity.train.frozen:
        return Cost()
    tested = fidelity.width * fidelity.height * _view_cost(fidelity.train)
    tested *= 2 if fidelity.train.average_mirror else 1
    return Cost(train=images * (_views_cost(fidelity) + tested))


def job_cost(job: Job) -> float:
    """Estimate the CPU seconds of a job, with its share of the work before the fine-tuning.

    Labelled images and pools have their features already, which networks of all seeds share.
    """
    fidelity, start, before = job.recipe.fidelity, job.start, 0.0
    if start is not None and start.on_subset:
        before = head_cost(start.recipe.fidelity)
    elif start is not None and start.streets is not None:
        before = cost_of(start.recipe.fidelity) / start.nets
    featured = isinstance(rendered_of(job.source), LabelledSource | StreetPool)
    return before + (head_cost if featured else cost_of)(fidelity)
