"""Trains a fresh network on a labelled set, predicts with it, and tests it.

The step is one jitted function, called in a host loop: on XLA's CPU backend gradient convolutions
run ten times slower inside `lax.scan`. On accelerators the same step is scanned in chunks.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from itertools import pairwise
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float32, Int64, UInt8

from seg import pyramid
from seg.at_once import train_at_once
from seg.batches import in_batches
from seg.beside import joined, training_set
from seg.check import check_settings
from seg.data import LabelledImages
from seg.metrics import confusion_matrix
from seg.nets import net_of, normalise, variables_of
from seg.nets.head import Maps, OnTrunk
from seg.nets.trunks import trunk_of
from seg.prepare import (
    CHUNK,
    Prepared,
    TrainingError,
    check_arrays,
    check_inputs,
    check_seed,
    error_of,
    first_variables,
    head_seeds,
    prepare,
)
from seg.pyramid import Statistics
from seg.settings import NetSpec, TrainSettings
from seg.step import Data, Functions, Plan, TrainState, Variables, functions, plan
from seg.step import Params as Params
from seg.views import with_mirror


def apply(
    variables: Variables, images: UInt8[Array, "b h w 3"], settings: TrainSettings, classes: int
) -> Float32[Array, "b h w classes"]:
    """The result of `logits` as one function that JAX can trace, with a frozen backbone, too."""
    sides: Any = (images, images[:, :, ::-1]) if settings.average_mirror else (images,)
    backbone = settings.net_spec.backbone
    if settings.frozen:
        assert backbone is not None
        with jax.ensure_compile_time_eval():  # a backbone may draw its weights
            params = pyramid.trunk_params(settings)
        sides = tuple(pyramid.maps_of(params, side, backbone) for side in sides)
    size = (images.shape[1], images.shape[2])
    return mean_logits(settings.net_spec, heads_of(variables, settings.heads), sides, size, classes)


def mean_logits(
    spec: NetSpec,
    heads: Sequence[Variables],
    sides: Sequence[Any],
    size: tuple[int, int],
    classes: int,
) -> Float32[Array, "b h w classes"]:
    """Mean logits over heads and sides, inside a compiled function.

    Args:
        spec: of the network.
        heads: the variables of each head.
        sides: images u8[b, h, w, 3], or the feature maps of a frozen backbone; then, if they count, those of
            the mirror images, whose logits are mirrored back.
        size: rows and columns of the images.
        classes: the network's number of classes.
    """
    module = net_of(spec, classes)

    def side_logits(inputs: Any) -> Array:
        if not spec.frozen:
            (variables,) = heads
            return module.apply(variables, normalise(inputs.astype(jnp.float32) / 255), train=False)
        scores = [module.apply(head, inputs, method=OnTrunk.scores) for head in heads]
        mean = scores[0] if len(scores) == 1 else sum(scores) / len(scores)
        return module.apply(heads[0], mean, size, method=OnTrunk.enlarged)

    direct, *mirrored = map(side_logits, sides)
    return (direct + mirrored[0][:, :, ::-1]) / 2 if mirrored else direct


def heads_of(variables: Variables, heads: int) -> list[Variables]:
    """The variables of a network with each of its heads alone."""
    if heads == 1:
        return [variables]
    params = variables["params"]
    return [
        {**variables, "params": jax.tree.map(lambda leaf, k=k: leaf[k], params)}
        for k in range(heads)
    ]


def stacked(nets: Sequence[Variables]) -> Variables:
    """The variables of networks with one head each as those of one network: their parameters are stacked."""
    if len(nets) == 1:
        return nets[0]
    params = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(net["params"] for net in nets))
    return {**nets[0], "params": params}


Output = Literal["labels", "scores", "heads"]
"""What a predictor gives: labels, the scores of all classes, or labels of all heads, then of each alone."""


@lru_cache(maxsize=32)
def _predictor(
    spec: NetSpec, heads: int, classes: int, output: Output
) -> Callable[[Variables, Sequence[Any], tuple[int, int]], Array]:
    """A compiled function of variables, `prediction_inputs` of a batch, and the size of the images."""

    @partial(jax.jit, static_argnums=2)
    def predict_batch(variables: Variables, sides: Sequence[Any], size: tuple[int, int]) -> Array:
        head_variables = heads_of(variables, heads)
        if output == "heads":
            head_logits = [
                mean_logits(spec, [head], sides, size, classes) for head in head_variables
            ]
            labels = [jnp.argmax(logits, axis=-1) for logits in (sum(head_logits), *head_logits)]
            return jnp.stack(labels, axis=1).astype(jnp.uint8)
        logits = mean_logits(spec, head_variables, sides, size, classes)
        return logits if output == "scores" else jnp.argmax(logits, axis=-1).astype(jnp.uint8)

    return predict_batch


def prediction_inputs(
    images: UInt8[np.ndarray, "n h w 3"], settings: TrainSettings, features: Maps | None = None
) -> tuple[Any, ...]:
    """What a network sees of images: themselves, or features; and of mirror images, if they count, too.

    Args:
        images: RGB.
        settings: of the training.
        features: for a frozen backbone, `seg.pyramid.features` of `seg.views.with_mirror`; None computes
            them.

    Raises:
        ValueError: there are no images, they are not RGB bytes, or too small for the network.
        WeightsError: the frozen backbone's weights cannot be used.
    """
    check_arrays(images)
    sides = 2 if settings.average_mirror else 1
    check_inputs(images, settings, features, sides)
    if not settings.frozen:
        return (images, images[:, :, ::-1])[:sides]
    maps = features or pyramid.features(with_mirror(images, settings), settings)
    count = len(images)
    return tuple(tuple(m[k * count : (k + 1) * count] for m in maps) for k in range(sides))


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
    beside: LabelledImages | None = None,
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
        features: for a frozen backbone, the features of all views of the images, `seg.pyramid.features` of
            `seg.views.view_images`; None computes them.
        statistics: for a network with a backbone and `head_statistics` "target": the fixed statistics of its
            head, from `channel_statistics` of real images. Not needed, and not used, with ``params``.
        beside: more images of the same size, such as labelled photographs mixed with renders; for a frozen
            backbone they may have the features of all their views. Class weights and training statistics are
            those of the images in the batches.
        share: share of ``beside`` in the images of all batches, in (0, 1), even if they are few; with the
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
    if checkpoints > 1 and settings.heads > 1:
        raise ValueError(
            f"checkpoints are for networks of one head; the settings have {settings.heads}"
        )
    whole_set = training_set(LabelledImages(images, labels, features=features), beside, share)
    prepared = prepare(whole_set, settings, classes, statistics, resumes=params is not None)
    starts = (
        [None] * settings.heads
        if params is None
        else heads_of(variables_of(params), settings.heads)
    )
    if stepwise is None:
        stepwise = jax.default_backend() == "cpu"
    if settings.heads > 1 and not stepwise and at_checkpoint is None:
        return _heads_at_once(rng_seed, prepared, starts, settings, classes, progress)
    compiled = functions(settings, classes)
    seeds = head_seeds(rng_seed, settings.heads)
    data = jax.device_put(
        Data(
            joined(prepared.inputs),
            joined(prepared.labels),
            prepared.class_weights,
            np.uint32(rng_seed),
        )
    )
    counts, statistics = prepared.counts, prepared.statistics
    del whole_set, prepared  # features are large, and joined ones are a copy
    nets = []
    for head, (seed, start) in enumerate(zip(seeds, starts, strict=True)):
        if start is not None or settings.weights is not None or settings.has_trunk:
            if start is None:
                random = compiled.init(np.uint32(seed), data.images).params
                start = first_variables(random, settings, statistics)
            # The step donates its state, so it gets a copy.
            state = compiled.resume(jax.tree.map(jnp.array, start))
        else:
            state = compiled.init(np.uint32(seed), data.images)
        rows = plan(seed, counts, settings, share)
        report = progress and partial(_report, progress, head * settings.steps)
        data = data._replace(seed=np.uint32(seed))
        nets.append(
            _after(
                compiled, state, data, rows, settings, report, stepwise, checkpoints, at_checkpoint
            )
        )
    return stacked(nets)


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


def _report(progress: Callable[[int, float], None], before: int, step: int, loss: float) -> None:
    progress(before + step, loss)


def _after(
    compiled: Functions,
    state: TrainState,
    data: Data,
    rows: Plan,
    settings: TrainSettings,
    progress: Callable[[int, float], None] | None,
    stepwise: bool,
    checkpoints: int,
    at_checkpoint: Callable[[Variables], None] | None,
) -> Variables:
    """The variables of a network with one head after all steps; arguments and errors are those of `train`."""
    checked = {settings.steps, *range(CHUNK, settings.steps, CHUNK)}
    checkpoint_steps = {settings.steps * k // checkpoints for k in range(1, checkpoints + 1)}
    for start, stop in pairwise(sorted({0, *checked, *checkpoint_steps})):
        if stepwise:
            for i in range(start, stop):
                state, loss = compiled.step(state, data, rows.rows(i))
        else:
            state, every_loss = compiled.steps(state, data, rows.rows(slice(start, stop)))
            loss = every_loss[-1]
        value = float(loss)
        if error := error_of(value, stop, settings):
            raise TrainingError(error)
        if progress is not None and stop in checked:
            progress(stop, value)
        if at_checkpoint is not None and stop in checkpoint_steps:
            averages = rows.weight[stop - 1] > 0
            at_checkpoint(state.trained if averages else state._replace(mean=None).trained)
    return state.trained


def predict(
    params: Variables,
    images: UInt8[np.ndarray, "n h w 3"],
    settings: TrainSettings,
    classes: int,
    *,
    features: Maps | None = None,
) -> UInt8[np.ndarray, "n h w"]:
    """Segment images.

    Args:
        params: a trained network, from `train` or from a file of any version.
        images: RGB of any size; with a backbone no side is shorter than its largest stride.
        settings: the settings of the training.
        classes: the network's number of classes.
        features: for a frozen backbone, `seg.pyramid.features` of `seg.views.with_mirror`; None computes
            them. The prediction is the same.

    Returns:
        The most likely class of each pixel.

    Raises:
        ValueError: there are no images, they are not RGB bytes, or too small for the network.
        WeightsError: the frozen backbone's weights cannot be used.
    """
    return _predict_batches(params, images, settings, classes, features, "labels")


def logits(
    params: Variables,
    images: UInt8[np.ndarray, "n h w 3"],
    settings: TrainSettings,
    classes: int,
    *,
    features: Maps | None = None,
) -> Float32[np.ndarray, "n h w classes"]:
    """Scores of all classes, of which `predict` takes the largest; arguments and errors are the same."""
    return _predict_batches(params, images, settings, classes, features, "scores")


def _predict_batches(
    params: Variables,
    images: np.ndarray,
    settings: TrainSettings,
    classes: int,
    features: Maps | None,
    output: Output,
) -> np.ndarray:
    """Compute labels, or the scores of all classes; only networks on a frozen backbone have "heads"."""
    sides = prediction_inputs(images, settings, features)
    variables = jax.device_put(variables_of(params))  # once, not for every batch
    predict_batch = _predictor(settings.net_spec, settings.heads, classes, output)
    size = (images.shape[1], images.shape[2])

    def run(batch: np.ndarray) -> Array:
        return predict_batch(variables, jax.tree.map(lambda side: side[batch], sides), size)

    return in_batches(run, np.arange(len(images)), settings.predict_batch)


def outline(settings: TrainSettings, classes: int) -> Variables:
    """Shapes and types of the result of `train`, as a tree of `jax.ShapeDtypeStruct`."""
    compiled = functions(settings, classes)
    images: Any = jax.ShapeDtypeStruct((1, 64, 64, 3), np.uint8)
    if settings.frozen:
        channels = trunk_of(settings).channels
        images = tuple(jax.ShapeDtypeStruct((1, 1, 1, c), np.float16) for c in channels)
    seed = jax.ShapeDtypeStruct((), np.uint32)
    return jax.eval_shape(
        lambda *arguments: stacked([compiled.init(*arguments).trained] * settings.heads),
        seed,
        images,
    )


def score(
    params: Variables,
    images: UInt8[np.ndarray, "n h w 3"],
    labels: UInt8[np.ndarray, "n h w"],
    settings: TrainSettings,
    classes: int,
    *,
    features: Maps | None = None,
) -> Int64[np.ndarray, "classes classes"]:
    """Predict and compare with the ground truth.

    Args:
        params: from `train`.
        images: RGB.
        labels: class ids, 255 for ignored pixels.
        settings: the settings of the training.
        classes: the network's number of classes.
        features: as for `predict`.

    Returns:
        Confusion matrix over all images; row: true class, column: predicted class.

    Raises:
        ValueError: no images, shapes that do not match, or labels outside the classes.
    """
    check_arrays(images, labels)
    predicted = predict(params, images, settings, classes, features=features)
    return confusion_matrix(labels, predicted, classes)


def predict_heads(
    params: Variables,
    images: UInt8[np.ndarray, "n h w 3"],
    settings: TrainSettings,
    classes: int,
    *,
    features: Maps | None = None,
) -> UInt8[np.ndarray, "n nets h w"]:
    """As `predict`, and for a network of several heads the classes by each head alone behind those by all."""
    if settings.heads == 1:
        return predict(params, images, settings, classes, features=features)[:, None]
    return _predict_batches(params, images, settings, classes, features, "heads")
