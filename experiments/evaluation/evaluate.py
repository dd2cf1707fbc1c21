"""One evaluation: render a dataset or take a real one, train a fresh net on it, test it on real images.

The functions here run in worker processes; they are pure in their arguments, so work lost with a worker
can be done again.
"""

from __future__ import annotations

import math
import os
import pickle
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np

from experiments.evaluation.cache import Cached, loaded
from experiments.evaluation.job import Keeps, Parts, Recipe, Result, Source, rendered_of
from experiments.evaluation.made_with import refuse_other
from experiments.evaluation.predictions import Predictions, compared, picked
from scene.dataset.render import Dataset, render_dataset
from scene.proposal import Streets, draw
from scene.workers import Workers
from seg.beside import Beside, TrainingSet
from seg.data import LabelledImages
from seg.metrics import iou, mean_iou
from seg.pyramid import features
from seg.train import Params, TrainingError, predict, score, train
from seg.views import view_images

_KEPT: dict[Any, LabelledImages] = {}
"""At most one rendered dataset of this process, by all that decides it."""

Rendered = tuple[LabelledImages, float]
"""A training set, and the seconds that rendering it took."""


def prepared(
    evaluate: Callable[..., Any], recipe: Recipe, source: Any, seed: int, *_: Any
) -> Rendered | None:
    """What of an evaluation needs no GPU: the rendered set, if it is of the kind that trains on one."""
    named = evaluate.func if isinstance(evaluate, partial) else evaluate
    if named is not evaluate_miou or isinstance(source, LabelledImages | Cached):
        return None
    started = time.perf_counter()
    own = training_set(recipe, loaded(source), seed)
    return own, time.perf_counter() - started


def attempt(evaluate: Callable[..., Any], *arguments: Any, ready: Rendered | None = None) -> Any:
    """Evaluate, with cached images as arrays; training that diverges is a result, too.

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
        return Result(math.nan, [], 0.0, time.perf_counter() - started, str(error))


def render(recipe: Recipe, streets: Streets, seed: int, workers: int | Workers = 0) -> Dataset:
    """The dataset of streets and a seed; by default in this process.

    ``sdr-jax render --attributes FILE --seed SEED`` with the same sizes renders the same.
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
    """The images of a source, but for those beside it, with labels in the classes of the recipe.

    What was rendered last beside labelled images is kept, with its features: the next net may have others
    beside it.
    """
    rendered = rendered_of(source)
    if isinstance(rendered, LabelledImages):
        return rendered
    name = (recipe._replace(statistics=None), pickle.dumps(rendered), seed)
    if name in _KEPT:
        return _KEPT[name]
    _KEPT.clear()
    found = rendered_set(recipe, rendered, seed)
    if isinstance(source, TrainingSet):
        settings = recipe.fidelity.train
        if settings.frozen:
            maps = features(view_images(found.images, settings), settings)
            found = found._replace(features=maps)
        _KEPT[name] = found
    return found


def evaluate_miou(
    recipe: Recipe,
    source: Source,
    seed: int,
    real: LabelledImages,
    parts: Parts = (),
    ready: Rendered | None = None,
    *,
    keeps: Keeps | None = None,
) -> Result:
    """Render, train, test.

    Args:
        recipe: sizes, net, training, assets.
        source: what to train on.
        seed: of the streets and of the net.
        real: images to test on.
        parts: of them that it is tested on separately, too.
        ready: the set, if it was rendered elsewhere.
        keeps: what the result tells of the net's predictions, if anything.

    Raises:
        TrainingError: training diverged.
    """
    started = time.perf_counter()
    own, rendered = ready or (training_set(recipe, source, seed), 0.0)
    if ready is None and not isinstance(source, LabelledImages):
        rendered = time.perf_counter() - started
    began = time.perf_counter()
    params = trained(recipe, own, seed, beside=_beside(source))
    return tested(recipe, params, real, rendered, time.perf_counter() - began, parts, keeps)


def _beside(source: Source) -> Beside | None:
    if not isinstance(source, TrainingSet):
        return None
    few: LabelledImages = source.parts[1]
    return Beside(few.images, few.labels, source.shares[1], few.features)


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
    return train(
        seed,
        own.images,
        own.labels,
        recipe.fidelity.train,
        len(recipe.classes.classes),
        params=params,
        features=own.features,
        statistics=recipe.statistics,
        beside=beside,
    )


def trained_net(recipe: Recipe, source: Any, seed: int, params: Params | None) -> Params | str:
    """The variables of a net trained on a source, in NumPy; or why there are none. Runs in a worker."""
    source = loaded(source)
    try:
        own = training_set(recipe, source, seed)
        found = trained(recipe, own, seed, params, _beside(source))
    except TrainingError as error:
        return str(error)
    return jax.tree.map(np.asarray, found)


def tested(
    recipe: Recipe,
    params: Params,
    real: LabelledImages,
    render_seconds: float,
    train_seconds: float,
    parts: Parts = (),
    keeps: Keeps | None = None,
) -> Result:
    """What a trained net is worth; the time of testing counts as training."""
    started = time.perf_counter()
    settings, classes = recipe.fidelity.train, len(recipe.classes.classes)
    confusions = []
    for first, end in parts or ((0, len(real.images)),):
        own = real.between(first, end)
        confusion = score(params, own.images, own.labels, settings, classes, features=own.features)
        confusions.append(confusion)
    confusion = np.sum(confusions, axis=0)
    present = confusion.sum(axis=1) > 0
    class_iou = [float(v) if p else None for v, p in zip(iou(confusion), present, strict=True)]
    seconds = train_seconds + time.perf_counter() - started
    found = None if keeps is None else _predictions(recipe, params, real, confusion, keeps)
    each = tuple(mean_iou(own) for own in confusions) if parts else ()
    return Result(
        mean_iou(confusion), class_iou, render_seconds, seconds, parts=each, predictions=found
    )


def _predictions(
    recipe: Recipe, params: Params, real: LabelledImages, confusion: np.ndarray, keeps: Keeps
) -> Predictions:
    """What is kept of a net: its confusion matrix, and predictions if they are asked for."""
    if keeps == "confusion":
        return Predictions(confusion)
    settings, chosen = recipe.fidelity.train, picked(len(real.images))
    maps = real.features and tuple(own[chosen] for own in real.features)
    found = predict(params, real.images[chosen], settings, len(confusion), features=maps)
    return compared(confusion, chosen, real.labels[chosen], found)


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
