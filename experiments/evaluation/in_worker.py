"""Makes one evaluation: it renders a dataset or takes a real one, trains a fresh network and tests it.

The functions here run in worker processes; they are pure in their arguments, so that work lost with a worker
can be repeated.
"""

from __future__ import annotations

import math
import os
import pickle
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import jax
import numpy as np

from common.memory import memory
from common.workers.pool import Workers
from common.workers.under_way import ending_report, report
from experiments.config.limits import training_bytes
from experiments.evaluation.cached import loaded
from experiments.evaluation.compiling import compiled_once
from experiments.evaluation.cost import head_cost
from experiments.evaluation.devices import device, out_of_memory
from experiments.evaluation.job import Keeps, Recipe, Result, Source, rendered_of
from experiments.evaluation.made_with import refuse_other
from experiments.evaluation.predictions import predictions_of
from experiments.evaluation.renders import Part, Rendered, Written, joined
from scene.dataset.render import Dataset, render_dataset
from scene.proposal import Streets, draw
from seg.data import LabelledImages
from seg.inference import predict_heads
from seg.many import train_many
from seg.metrics import confusion_matrix, iou, mean_iou
from seg.mixing import TrainingSet
from seg.pyramid import training_features
from seg.settings import TrainSettings
from seg.step import Params
from seg.train import TrainingError, train

_LAST_SET: dict[Any, LabelledImages] = {}
"""The last rendered dataset of this process, by everything that decides it."""
AT_ONCE = (16, 4, 1)
"""Numbers of networks that are trained at once; each is compiled once."""


def core_seconds() -> float:
    """A clock of this worker's work: CPU seconds, so that other programs do not count; seconds on a GPU."""
    return time.process_time() if jax.default_backend() == "cpu" else time.perf_counter()


def parts_of(
    recipe: Recipe, units: np.ndarray, seed: int, most: int, folder: str | None, first: int = 0
) -> list[tuple[Part]]:
    """Divide streets into at most so many parts for renderers.

    Args:
        recipe: sizes, assets, and the classes of the labels.
        units: f32[streets, attributes] of every street, in [0, 1].
        seed: decides, with the street's index, all random choices.
        most: number of parts.
        folder: where renderers write images; None returns them.
        first: index of the first street.
    """
    fidelity, classes = recipe.fidelity, recipe.classes
    bounds = np.linspace(0, len(units), min(most, len(units)) + 1).astype(int)
    return [
        (
            Part(
                units[start:stop],
                seed,
                first + int(start),
                fidelity.shots,
                fidelity.render_settings(),
                recipe.renderer,
                recipe.pool,
                classes.outlines,
                classes.from_train_id,
                folder,
            ),
        )
        for start, stop in pairwise(bounds)
    ]


def attempt(
    evaluate: Callable[..., Any],
    *arguments: Any,
    ready: Sequence[Rendered | Written] | None = None,
) -> Any:
    """Evaluate with cached images loaded as arrays; diverged training is a result, too.

    Args:
        evaluate: `evaluate_miou`, or another evaluation.
        arguments: its arguments.
        ready: the parts of its rendered set, if renderers made them.
    """
    started = core_seconds()
    rendered = {"ready": joined(ready)} if ready else {}
    try:
        return evaluate(*map(loaded, arguments), **rendered)
    except TrainingError as error:
        return Result(math.nan, [], 0.0, core_seconds() - started, str(error))


def attempt_all(
    tasks: Sequence[tuple],
    ready: Sequence[Sequence[Rendered | Written]],
    at_once: bool | None = None,
) -> list[Any]:
    """Make evaluations that are alike but for their training sets, seeds and rendered parts.

    Args:
        tasks: arguments of `attempt`.
        ready: the parts of their rendered sets.
        at_once: whether to train several networks at once, which a GPU needs; by default on a GPU.
    """
    recipe = next(argument for argument in tasks[0] if isinstance(argument, Recipe))
    if at_once is None:
        at_once = jax.default_backend() != "cpu"
    results: list[Any] = []
    with compiled_once(recipe):
        if not (at_once and _may_be_at_once(tasks[0])):
            return [attempt(*task, ready=parts) for task, parts in zip(tasks, ready, strict=True)]
        most = _most_at_once(recipe)
        while len(results) < len(tasks):
            done = len(results)
            count = next(count for count in AT_ONCE if count <= min(len(tasks) - done, most))
            results += _evaluated_at_once(tasks[done : done + count], ready[done : done + count])
    return results


def _may_be_at_once(task: tuple) -> bool:
    """Whether `train_many` can make evaluations of this kind; large networks keep a GPU busy alone."""
    evaluate, recipe, *_ = task
    keeps = evaluate.keywords.get("keeps") if isinstance(evaluate, partial) else None
    named = evaluate.func if isinstance(evaluate, partial) else evaluate
    if named is not evaluate_miou or keeps == "predictions" or recipe.checkpoints > 1:
        return False
    settings: TrainSettings = recipe.fidelity.train
    return settings.frozen or settings.net == "compact"


def _most_at_once(recipe: Recipe) -> int:
    """The number of networks whose training sets take a third of the device's memory, but at least one."""
    room = device().memory or memory()
    return max(1, room // (3 * training_bytes(recipe.fidelity)))


def _evaluated_at_once(
    tasks: Sequence[tuple], ready: Sequence[Sequence[Rendered | Written]]
) -> list[Result]:
    """Make evaluations by `evaluate_miou` with one call of `train_many`; they share its time equally."""
    evaluate, recipe, _, _, real = tasks[0]
    refuse_other(recipe.made_with)
    sets, render_seconds = [], []
    for (_, _, source, seed, _), parts in zip(tasks, ready, strict=True):
        source = loaded(source)
        rendered = joined(parts) if parts else None
        images, seconds = timed_set(recipe, source, seed, rendered)
        mixed = isinstance(source, TrainingSet)
        sets.append(source._replace(parts=(images, *source.parts[1:])) if mixed else images)
        render_seconds.append(seconds)
    started, real = core_seconds(), loaded(real)
    settings = recipe.fidelity.train
    per_step = len(tasks) * head_cost(recipe.fidelity) / settings.steps
    with _memory_named(recipe), ending_report():
        networks = train_many(
            [seed for _, _, _, seed, _ in tasks],
            sets,
            settings,
            len(recipe.classes.classes),
            statistics=recipe.statistics,
            test=real,
            progress=lambda steps, loss: report(steps * per_step),
        )
    seconds = (core_seconds() - started) / len(tasks)
    assert networks.by_image is not None
    by_head = [()] * len(tasks) if networks.by_head is None else networks.by_head
    kept = isinstance(evaluate, partial)  # the confusion matrix alone
    return [
        Result(math.nan, [], 0.0, seconds, error)
        if error is not None
        else _scored(by_image, heads, rendering, seconds)._replace(
            predictions=predictions_of(by_image, None) if kept else None
        )
        for error, by_image, heads, rendering in zip(
            networks.errors, networks.by_image, by_head, render_seconds, strict=True
        )
    ]


@contextmanager
def _memory_named(recipe: Recipe) -> Iterator[None]:
    """Report the memory of a GPU that runs out as a user's error."""
    try:
        yield
    except jax.errors.JaxRuntimeError as error:
        if "RESOURCE_EXHAUSTED" not in str(error):
            raise
        raise out_of_memory(device(), recipe.fidelity) from None


def render(recipe: Recipe, streets: Streets, seed: int, workers: int | Workers = 0) -> Dataset:
    """Render the dataset of streets and a seed; by default in this process.

    ``sdr-jax render --attributes FILE --seed SEED`` with the same sizes renders the same, but for outlines,
    which need ``--target``.
    """
    fidelity = recipe.fidelity
    return render_dataset(
        draw(streets, seed, fidelity.streets),
        seed,
        shots=fidelity.shots,
        settings=fidelity.render_settings(),
        renderer_name=recipe.renderer,
        pool=recipe.pool,
        outlines=recipe.classes.outlines,
        workers=workers,
    )


def rendered_set(
    recipe: Recipe, streets: Streets, seed: int, workers: int | Workers = 0
) -> LabelledImages:
    """Render the images of streets and a seed, with labels in the classes of the recipe."""
    dataset = render(recipe, streets, seed, workers)
    return LabelledImages(dataset.images, recipe.classes.from_train_id[dataset.labels])


def training_set(recipe: Recipe, source: Source, seed: int) -> LabelledImages:
    """The images of a source without the labelled ones mixed in, with labels in the classes of the recipe.

    The last set rendered for a mixture is kept with its features: the next network may use it, too, with
    other labelled images.
    """
    streets = rendered_of(source)
    if isinstance(streets, LabelledImages):
        return streets
    name = (recipe._replace(statistics=None), pickle.dumps(streets), seed)
    if name in _LAST_SET:
        return _LAST_SET[name]
    _LAST_SET.clear()
    images = rendered_set(recipe, streets, seed)
    if isinstance(source, TrainingSet):
        settings = recipe.fidelity.train
        if settings.frozen:
            maps = training_features(images.images, settings)
            images = images._replace(features=maps)
        _LAST_SET[name] = images
    return images


def timed_set(
    recipe: Recipe, source: Source, seed: int, ready: Rendered | None
) -> tuple[LabelledImages, float]:
    """The result of `training_set`, or the set that renderers made; and the core seconds of rendering it."""
    if ready is not None:
        return LabelledImages(ready.images, ready.labels), ready.seconds
    started = core_seconds()
    images = training_set(recipe, source, seed)
    is_labelled = isinstance(source, LabelledImages)
    return images, 0.0 if is_labelled else core_seconds() - started


def evaluate_miou(
    recipe: Recipe,
    source: Source,
    seed: int,
    real: LabelledImages,
    ready: Rendered | None = None,
    *,
    keeps: Keeps | None = None,
) -> Result:
    """Render, train, test.

    Args:
        recipe: sizes, network, training, assets.
        source: the training set.
        seed: seed of the streets and of the network.
        real: images to test on.
        ready: the rendered set, if renderers made it.
        keeps: what to keep of the network's predictions.

    Raises:
        TrainingError: training diverged.
    """
    images, rendered = timed_set(recipe, source, seed, ready)
    began = core_seconds()
    if recipe.checkpoints == 1:
        params = trained(recipe, images, seed, source=source)
        return tested(recipe, params, real, rendered, core_seconds() - began, keeps)
    results: list[Result] = []

    def test(params: Params) -> None:
        results.append(tested(recipe, params, real, rendered, 0.0, keeps))

    trained(recipe, images, seed, source=source, test=test)
    best = max(results, key=lambda result: result.reward)
    return best._replace(train_seconds=core_seconds() - began)


def trained(
    recipe: Recipe,
    images: LabelledImages,
    seed: int,
    params: Params | None = None,
    source: Source | None = None,
    test: Callable[[Params], None] | None = None,
) -> Params:
    """Train a network on a set, mixed with the second part of its source if there is one.

    It starts from the given parameters, or from scratch. Each of the recipe's checkpoints goes to `test`.

    Raises:
        TrainingError: training diverged.
        UserError: this process has another backend than the run.
    """
    refuse_other(recipe.made_with)
    mixed_in: dict[str, Any] = {}
    if isinstance(source, TrainingSet):
        mixed_in = {"extra": source.parts[1], "share": source.shares[1]}
    fidelity = recipe.fidelity
    per_step = head_cost(fidelity) / (fidelity.train.steps * fidelity.train.heads)
    with _memory_named(recipe), ending_report():
        return train(
            seed,
            images.images,
            images.labels,
            recipe.fidelity.train,
            len(recipe.classes.classes),
            progress=lambda steps, loss: report(steps * per_step),
            params=params,
            features=images.features,
            statistics=recipe.statistics,
            checkpoints=recipe.checkpoints,
            at_checkpoint=test,
            **mixed_in,
        )


def trained_net(recipe: Recipe, source: Any, seed: int, params: Params | None) -> Params | str:
    """Train a network on a source; its variables in NumPy, or why there are none. Runs in a worker."""
    source = loaded(source)
    try:
        images = training_set(recipe, source, seed)
        variables = trained(recipe, images, seed, params, source)
    except TrainingError as error:
        return str(error)
    return jax.tree.map(np.asarray, variables)


def tested(
    recipe: Recipe,
    params: Params,
    real: LabelledImages,
    render_seconds: float,
    train_seconds: float,
    keeps: Keeps | None = None,
) -> Result:
    """Test a trained network; the time of testing counts as training."""
    started = core_seconds()
    settings, classes = recipe.fidelity.train, len(recipe.classes.classes)
    predicted = predict_heads(params, real.images, settings, classes, features=real.features)
    pairs = zip(real.labels, predicted[:, 0], strict=True)
    by_image = np.stack([confusion_matrix(*pair, classes) for pair in pairs])
    by_head = [
        confusion_matrix(real.labels, labels, classes) for labels in predicted.swapaxes(0, 1)[1:]
    ]
    seconds = train_seconds + core_seconds() - started
    result = _scored(by_image, by_head, render_seconds, seconds)
    if keeps is None:
        return result
    whole = predicted[:, 0] if keeps == "predictions" else None
    return result._replace(predictions=predictions_of(by_image, whole))


def _scored(
    by_image: np.ndarray,
    by_head: Iterable[np.ndarray],
    render_seconds: float,
    train_seconds: float,
) -> Result:
    """The result of the confusion matrices of each image, and of each of several heads alone."""
    confusion = by_image.sum(axis=0)
    heads = tuple(map(_class_iou, by_head))
    class_iou = _class_iou(confusion)
    return Result(mean_iou(confusion), class_iou, render_seconds, train_seconds, heads=heads)


def _class_iou(confusion: np.ndarray) -> list[float | None]:
    return [None if np.isnan(value) else float(value) for value in iou(confusion)]


def worker_environment() -> dict[str, str]:
    """Environment variables of workers: one thread each, and compiled functions kept between runs.

    Two workers with the same new shape both compile it. For a head on lite0 at 240x176 that takes 6.2 s of a
    core, and loading a compiled function 1.2 s: waiting for the other worker would take longer.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "sdr-jax" / "xla"
    return {
        "NPROC": "1",  # XLA's threads; sums in convolutions depend on their number
        "JAX_COMPILATION_CACHE_DIR": os.environ.get("JAX_COMPILATION_CACHE_DIR", str(cache)),
        # With the default of 1 s every worker would compile parts of the head: 2.6 s, not 1.2.
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "XLA_PYTHON_CLIENT_PREALLOCATE": "false",
        "TF_CPP_MIN_LOG_LEVEL": "3",
    }
