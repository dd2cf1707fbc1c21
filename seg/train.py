"""Trains a network on a labelled set, from random or earlier variables.

The step is one jitted function, called in a host loop: on XLA's CPU backend gradient convolutions
run ten times slower inside `lax.scan`. On accelerators the same step is scanned in chunks.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import UInt8

from seg.at_once import train_at_once
from seg.check import check_settings
from seg.data import LabelledImages
from seg.inference import heads_of, stacked
from seg.mixing import joined, training_set
from seg.nets import variables_of
from seg.nets.head import Maps
from seg.prepare import (
    CHUNK,
    Prepared,
    TrainingError,
    check_seed,
    error_of,
    error_of_weights,
    first_variables,
    head_seeds,
    prepare,
)
from seg.pyramid import Statistics
from seg.settings import TrainSettings
from seg.step import Data, Functions, Plan, TrainState, Variables, functions, plan


def train(
    rng_seed: int,
    images: UInt8[np.ndarray, "n h w 3"],
    labels: UInt8[np.ndarray, "n h w"],
    settings: TrainSettings,
    classes: int,
    progress: Callable[[int, float], None] | None = None,
    params: Variables | None = None,
    stepwise: bool | None = None,
    *,
    features: Maps | None = None,
    statistics: Statistics | None = None,
    extra: LabelledImages | None = None,
    share: float = 0.5,
    checkpoints: int = 1,
    at_checkpoint: Callable[[Variables], None] | None = None,
) -> Variables:
    """Train a network; the same arguments give the same variables.

    The first of several heads trains as if it were alone. On a CPU heads train one after the other, otherwise
    at once.

    Args:
        rng_seed: 32 bits for initial parameters, the order of the images and augmentation.
        images: RGB.
        labels: class ids, 255 for ignored pixels.
        settings: everything else.
        classes: the network's number of classes.
        progress: called every 50 steps with the number of steps and the last loss.
        params: start from this trained network (it is not changed); None starts from the settings' `weights`
            and at random elsewhere: `seg.weights.described` says which layers.
        stepwise: call the step from the host (True) or scan it in chunks (False); the default suits the
            backend. The steps are the same.
        features: for a frozen backbone, `seg.pyramid.training_features`; None computes them.
        statistics: for a network with a backbone and `head_statistics` "target": the fixed statistics of its
            head, from `channel_statistics` of real images. Not needed, and not used, with ``params``.
        extra: more images of the same size, such as labelled photographs mixed with renders; for a frozen
            backbone they may have the features of all their views. Class weights and training statistics are
            those of the images in the batches.
        share: share of ``extra`` in the images of all batches, in (0, 1), even if they are few; with the
            settings' `last_share` that of the first batch.
        checkpoints: number of evenly spaced steps after which `at_checkpoint` is called, at most all; the
            last one is the end. More than one are for networks of one head.
        at_checkpoint: called with the network's variables, which are valid until it returns. Until the steps
            begin that the settings average, they are those after the step.

    Returns:
        The network's variables by collection: `params` after the last step, or their mean over the steps that
        the settings average, and a head's `statistics`. With a frozen backbone they are the head's alone,
        since the backbone's do not change and `predict` loads them as training did. Those of several heads
        are stacked along a first axis.

    Raises:
        ValueError: no images, shapes that do not match, labels outside the classes, settings or a seed
            out of range, or images too small for the network.
        TrainingError: the loss is not finite.
        WeightsError: the settings' `weights`, or the backbone's, cannot be used.
    """
    check_settings(settings)
    check_seed(rng_seed)
    if not 1 <= checkpoints <= settings.steps:
        raise ValueError(
            f"checkpoints must lie in 1..{settings.steps}, the steps; got {checkpoints}"
        )
    if settings.heads > 1 and (checkpoints > 1 or at_checkpoint is not None):
        raise ValueError(
            f"checkpoints are for networks of one head; the settings have {settings.heads}"
        )
    whole_set = training_set(LabelledImages(images, labels, features=features), extra, share)
    prepared = prepare(whole_set, settings, classes, statistics, resumes=params is not None)
    starts = (
        [None] * settings.heads
        if params is None
        else heads_of(variables_of(params), settings.heads)
    )
    if stepwise is None:
        stepwise = jax.default_backend() == "cpu"
    if settings.heads > 1 and not stepwise:
        return _heads_at_once(rng_seed, prepared, starts, settings, classes, progress)
    compiled = functions(settings, classes)
    seeds = head_seeds(rng_seed, settings.heads)
    data = jax.device_put(
        Data(
            joined([part.inputs for part in prepared.parts]),
            joined([part.labels for part in prepared.parts]),
            prepared.class_weights,
            np.uint32(rng_seed),
        )
    )
    counts, statistics = prepared.counts, prepared.statistics
    del whole_set, prepared  # features are large, and joined ones are a copy
    checked = {settings.steps, *range(CHUNK, settings.steps, CHUNK)}
    checkpoint_steps = {settings.steps * k // checkpoints for k in range(1, checkpoints + 1)}
    stops = sorted(checked | checkpoint_steps)
    nets = []
    for head, (seed, start) in enumerate(zip(seeds, starts, strict=True)):
        if start is None and (settings.weights is not None or settings.has_backbone):
            random = compiled.init(np.uint32(seed), data.images).params
            start = first_variables(random, settings, statistics)
        if start is None:
            first = compiled.init(np.uint32(seed), data.images)
        else:  # a copy, since the step donates its state
            first = compiled.resume(jax.tree.map(jnp.array, start))
        rows = plan(seed, counts, settings, share)
        data = data._replace(seed=np.uint32(seed))
        for stop, state, loss in _updates(compiled, first, data, rows, stops, stepwise):
            if error := error_of(loss, stop, settings):
                raise TrainingError(error)
            if progress is not None and stop in checked:
                progress(head * settings.steps + stop, loss)
            if at_checkpoint is not None and stop in checkpoint_steps:
                averages = rows.weight[stop - 1] > 0
                at_checkpoint(state.trained if averages else state._replace(mean=None).trained)
        if error := error_of_weights(state.trained, settings):
            raise TrainingError(error)
        nets.append(state.trained)
    return stacked(nets)


def _updates(
    compiled: Functions,
    state: TrainState,
    data: Data,
    rows: Plan,
    stops: Sequence[int],
    stepwise: bool,
) -> Iterator[tuple[int, TrainState, float]]:
    """Update a network with one head, and yield each of the stops with the state and the last loss.

    A state is valid until the next one is requested.
    """
    for start, stop in pairwise([0, *stops]):
        if stepwise:
            for i in range(start, stop):
                state, loss = compiled.step(state, data, rows.rows(i))
        else:
            state, losses = compiled.steps(state, data, rows.rows(slice(start, stop)))
            loss = losses[-1]
        yield stop, state, float(loss)


def _heads_at_once(
    rng_seed: int,
    prepared: Prepared,
    starts: Sequence[Variables | None],
    settings: TrainSettings,
    classes: int,
    progress: Callable[[int, float], None] | None,
) -> Variables:
    """Train all heads of a network at once; arguments and errors are those of `train`."""
    start = [variables for variables in starts if variables is not None] or None

    def report(step: int, loss: float) -> None:
        if progress is not None:
            progress(step * settings.heads, loss)

    networks, (error,) = train_at_once([rng_seed], [prepared], settings, classes, report, start)
    if error is not None:
        raise TrainingError(error)
    return jax.tree.map(lambda leaf: leaf[0], networks)
