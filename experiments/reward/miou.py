"""One evaluation: render a dataset or take a real one, train a fresh net on it, score it on real images.

The functions here run in worker processes; they are pure in their arguments, so work lost with a worker
can be done again.
"""

from __future__ import annotations

import math
import os
import pickle
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.config import Fidelity
from experiments.reward.made_with import MadeWith, refuse_other
from experiments.reward.seen import Sight, picked, sight
from experiments.reward.truth import Shared, Subset, WithFew, loaded, rendered_of
from scene.assets.catalogue import AssetPool
from scene.dataset.render import Dataset, render_dataset
from scene.proposal import Streets, draw
from scene.workers import Workers
from seg.beside import Beside
from seg.classes import ClassTable, class_table
from seg.data import LabelledImages
from seg.metrics import iou, mean_iou
from seg.nets.lite0 import Pyramid
from seg.pyramid import Statistics, features
from seg.train import Params, TrainingError, predict, score, train
from seg.views import view_images


class Recipe(NamedTuple):
    """All that decides a net, but for its training set and its seed."""

    fidelity: Fidelity
    table: str  # name of the class table
    renderer: str
    pool: AssetPool  # the assets that may appear
    statistics: Statistics | None = None  # that lite0's head normalises by; or its training set's
    made_with: MadeWith = ()  # backend and versions of all workers of the run

    @property
    def classes(self) -> ClassTable:
        """What its nets tell apart."""
        return class_table(self.table)


Source = Streets | Subset | LabelledImages | WithFew
"""What a net is trained on: a dataset rendered from streets, given images, or both."""

Parts = tuple[tuple[int, int], ...]
"""First image of each part of the images that score, and the first after it."""

_KEPT: dict[Any, LabelledImages] = {}
"""At most one rendered dataset of this process, by all that decides it."""


class Outcome(NamedTuple):
    """What one training set was worth, or why that is not known."""

    reward: float  # mIoU in [0, 1], or -MMD^2; NaN if it failed
    class_iou: list[float | None]  # in [0, 1]; None for classes that do not occur in the truth
    render_seconds: float
    train_seconds: float  # training and scoring
    failed: str | None = None
    stored: bool = False  # it was known, and took no time now
    parts: tuple[float, ...] = ()  # reward on each part of the images, where it was asked for
    sight: Sight | None = None  # what the net saw, where it was asked for and was not known before

    @property
    def seconds(self) -> float:
        """What the evaluation took, when it was made, on a worker's one core."""
        return self.render_seconds + self.train_seconds


Rendered = tuple[LabelledImages, float]
"""A training set, and the seconds that rendering it took."""


def prepared(
    evaluate: Callable[..., Outcome], recipe: Recipe, source: Any, seed: int, *_: Any
) -> Any:
    """What of an evaluation needs no GPU: the rendered set, if it is of the kind that trains on one."""
    named = getattr(evaluate, "func", evaluate)  # below what says where the net leaves what it saw
    if named is not evaluate_miou or isinstance(source, LabelledImages | Shared):
        return None
    started = time.perf_counter()
    own = training_set(recipe, loaded(source), seed)
    return own, time.perf_counter() - started


def attempt(
    evaluate: Callable[..., Outcome], *arguments: Any, ready: Rendered | None = None
) -> Outcome:
    """Evaluate, with shared images as arrays; training that diverges is an outcome, too.

    Args:
        evaluate: `evaluate_miou`, or another one.
        arguments: of it.
        ready: what `prepared` has made of them.
    """
    started = time.perf_counter()
    known = {} if ready is None else {"ready": ready}
    try:
        return evaluate(*map(loaded, arguments), **known)
    except TrainingError as error:
        return Outcome(math.nan, [], 0.0, time.perf_counter() - started, str(error))


def render(recipe: Recipe, streets: Streets, seed: int, workers: int | Workers = 0) -> Dataset:
    """The dataset of streets and a seed; by default in this process.

    ``python -m scene.render --attributes FILE --seed SEED`` with the same sizes renders the same.
    """
    fidelity = recipe.fidelity
    return render_dataset(
        draw(streets, seed, fidelity.streets),
        seed,
        shots=fidelity.shots,
        settings=fidelity.render_settings(),
        renderer_name=recipe.renderer,
        pool=recipe.pool,
        workers=workers,
    )


def rendered_set(
    recipe: Recipe, streets: Streets, seed: int, workers: int | Workers = 0
) -> LabelledImages:
    """The images of streets and a seed, with labels in the classes of the recipe."""
    dataset = render(recipe, streets, seed, workers)
    return LabelledImages(dataset.images, recipe.classes.from_train_id[dataset.labels])


def training_set(recipe: Recipe, source: Source, seed: int) -> LabelledImages:
    """The images of a source, but for a few beside it, with labels in the classes of the recipe.

    What was rendered last beside a few images is kept, with its features: the next net may have others
    beside it.
    """
    proposal = rendered_of(source)
    if isinstance(proposal, LabelledImages):
        return proposal
    name = (recipe._replace(statistics=None), pickle.dumps(proposal), seed)
    if name in _KEPT:
        return _KEPT[name]
    _KEPT.clear()
    found = rendered_set(recipe, proposal, seed)
    if isinstance(source, WithFew):
        train = recipe.fidelity.train
        if train.frozen:
            maps = features(view_images(found.images, train), train.dtype)
            found = found._replace(features=maps)
        _KEPT[name] = found
    return found


def evaluate_miou(
    recipe: Recipe,
    source: Source,
    seed: int,
    truth: LabelledImages,
    parts: Parts = (),
    ready: Rendered | None = None,
    *,
    sees: bool | None = None,
) -> Outcome:
    """Render, train, score.

    Args:
        recipe: sizes, net, training, assets.
        source: what to train on.
        seed: of the streets and of the net.
        truth: what to score on.
        parts: of it that are scored each for itself, too.
        ready: the set, if it was rendered elsewhere.
        sees: whether the outcome tells what the net saw: True with predictions, False the counts alone.

    Raises:
        TrainingError: training diverged.
    """
    started = time.perf_counter()
    own, rendered = ready or (training_set(recipe, source, seed), 0.0)
    if ready is None and not isinstance(source, LabelledImages):
        rendered = time.perf_counter() - started
    began = time.perf_counter()
    params = trained(recipe, own, seed, beside=_beside(source))
    spent = time.perf_counter() - began
    return scored(recipe, params, truth, rendered, spent, parts, sees)


def _beside(source: Source) -> Beside | None:
    if not isinstance(source, WithFew):
        return None
    few = source.arrays
    return Beside(few.images, few.labels, source.share, few.features)


def trained(
    recipe: Recipe,
    own: LabelledImages,
    seed: int,
    params: Params | None = None,
    beside: Beside | None = None,
) -> Params:
    """A net trained on a set and what is beside it, from the start or from other parameters.

    Raises:
        TrainingError: training diverged.
        UserError: this process makes nets with another backend than the run.
    """
    refuse_other(recipe.made_with)
    settings, classes = recipe.fidelity.train, len(recipe.classes.classes)
    return train(
        seed,
        own.images,
        own.labels,
        settings,
        classes,
        params=params,
        features=own.features,
        statistics=recipe.statistics,
        beside=beside,
    )


def scored(
    recipe: Recipe,
    params: Params,
    truth: LabelledImages,
    render_seconds: float,
    train_seconds: float,
    parts: Parts = (),
    sees: bool | None = None,
) -> Outcome:
    """What a trained net is worth; the time of scoring counts as training."""
    started = time.perf_counter()
    settings, classes = recipe.fidelity.train, len(recipe.classes.classes)
    confusions = []
    for first, end in parts or ((0, len(truth.images)),):
        own = truth.between(first, end)
        confusion = score(params, own.images, own.labels, settings, classes, features=own.features)
        confusions.append(confusion)
    confusion = np.sum(confusions, axis=0)
    present = confusion.sum(axis=1) > 0
    class_iou = [float(v) if p else None for v, p in zip(iou(confusion), present, strict=True)]
    seconds = train_seconds + time.perf_counter() - started
    found = None if sees is None else _sight(recipe, params, truth, confusion, sees)
    each = tuple(mean_iou(own) for own in confusions) if parts else ()
    return Outcome(mean_iou(confusion), class_iou, render_seconds, seconds, parts=each, sight=found)


def _sight(
    recipe: Recipe, params: Params, truth: LabelledImages, confusion: np.ndarray, predictions: bool
) -> Sight:
    """What a net saw: its counts, and predictions if they are asked for."""
    if not predictions:
        return Sight(confusion)
    settings, chosen = recipe.fidelity.train, picked(len(truth.images))
    images, labels = truth.images[chosen], truth.labels[chosen]
    maps = truth.features and Pyramid(*(own[chosen] for own in truth.features))
    found = predict(params, images, settings, len(confusion), features=maps)
    return sight(confusion, chosen, labels, found)


def worker_environment() -> dict[str, str]:
    """Variables for workers: one thread each, and compiled functions kept between runs.

    Two workers that meet a shape at once both compile it. For a head on lite0 at 240x176 that takes 6.2 s of
    a core, to load what another has compiled 1.2 s: who waited for the other would be ready later.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "sdr-jax" / "xla"
    return {
        "NPROC": "1",  # of XLA's threads; what convolutions sum up depends on their number
        "JAX_COMPILATION_CACHE_DIR": os.environ.get("JAX_COMPILATION_CACHE_DIR", str(cache)),
        # With 1 s, the default, parts of the head would be compiled by every worker: 2.6 s, not 1.2.
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "XLA_PYTHON_CLIENT_PREALLOCATE": "false",
        "TF_CPP_MIN_LOG_LEVEL": "3",
    }
