"""Trains a fresh net on a labelled set, predicts with it, and tests it.

The step is one jitted function, called in a host loop: on XLA's CPU backend gradient convolutions
run ten times slower inside `lax.scan`. On accelerators the same step is scanned in chunks.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from itertools import pairwise
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float32, Int64, UInt8

from seg import pyramid
from seg.batches import in_batches
from seg.beside import joined, training_set
from seg.check import check_settings
from seg.data import LabelledImages
from seg.metrics import confusion_matrix
from seg.nets import net_of, normalise, variables_of
from seg.nets.head import Maps, OnTrunk
from seg.nets.trunks import trunk_of
from seg.prepare import (
    check_arrays,
    check_inputs,
    check_seed,
    error_of,
    first_variables,
    head_seeds,
    prepare,
)
from seg.pyramid import Statistics
from seg.settings import TrainSettings
from seg.step import Data, Functions, Plan, TrainState, Variables, functions, plan
from seg.step import Params as Params
from seg.views import with_mirror

CHUNK = 50  # steps between two checks of the loss; also the length of a scan on an accelerator


class TrainingError(Exception):
    """The loss is no longer finite."""


def apply(
    variables: Variables, images: UInt8[Array, "b h w 3"], settings: TrainSettings, classes: int
) -> Float32[Array, "b h w classes"]:
    """The result of `logits` as one function that JAX can trace, with a frozen trunk, too."""
    module = net_of(settings, classes)
    if settings.frozen:
        with jax.ensure_compile_time_eval():  # a trunk may draw its weights
            params = pyramid.trunk_params(settings)

    def seen(images: UInt8[Array, "b h w 3"]) -> Float32[Array, "b h w classes"]:
        if not settings.frozen:
            return module.apply(variables, normalise(images.astype(jnp.float32) / 255), train=False)
        maps = pyramid.maps_of(params, images, settings)
        return _from_maps(module, variables, maps, (images.shape[1], images.shape[2]), settings)

    return _over_mirror(
        seen, (images, images[:, :, ::-1]) if settings.average_mirror else (images,)
    )


def _from_maps(
    module: Any, variables: Variables, maps: Maps, size: tuple[int, int], settings: TrainSettings
) -> Float32[Array, "b h w classes"]:
    """Mean logits of all heads from the features of images of a size."""
    each = [module.apply(own, maps, method=OnTrunk.scores) for own in heads_of(variables, settings)]
    mean = each[0] if len(each) == 1 else sum(each) / len(each)
    return module.apply(variables, mean, size, method=OnTrunk.enlarged)


def _over_mirror(seen: Callable[[Any], Array], sides: Sequence[Any]) -> Array:
    """Logits of images, or their mean with those of the mirror images, mirrored back."""
    direct, *mirror = map(seen, sides)
    return (direct + mirror[0][:, :, ::-1]) / 2 if mirror else direct


def heads_of(variables: Variables, settings: TrainSettings) -> list[Variables]:
    """The variables of a net with each of its heads alone."""
    if settings.heads == 1:
        return [variables]
    params = variables["params"]
    return [
        {**variables, "params": jax.tree.map(lambda leaf, k=k: leaf[k], params)}
        for k in range(settings.heads)
    ]


def stacked(nets: Sequence[Variables]) -> Variables:
    """The variables of nets with one head each as those of one net: their parameters are stacked."""
    if len(nets) == 1:
        return nets[0]
    params = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(net["params"] for net in nets))
    return {**nets[0], "params": params}


Output = Literal["labels", "scores", "heads"]
"""What a predictor gives: labels, the scores of all classes, or labels of all heads, then of each alone."""


@lru_cache(maxsize=32)
def _predictor(
    net_settings: TrainSettings, classes: int, output: Output
) -> Callable[[Variables, ArrayLike], Array]:
    @jax.jit
    def predict_batch(variables: Variables, images: UInt8[Array, "b h w 3"]) -> Array:
        logits = apply(variables, images, net_settings, classes)
        return logits if output == "scores" else jnp.argmax(logits, axis=-1).astype(jnp.uint8)

    return predict_batch


@lru_cache(maxsize=32)
def _head_predictor(
    net_settings: TrainSettings, classes: int, output: Output
) -> Callable[..., Array]:
    module, alone = net_of(net_settings, classes), replace(net_settings, heads=1)

    @partial(jax.jit, static_argnums=2)
    def predict_batch(variables: Variables, sides: Sequence[Maps], size: tuple[int, int]) -> Array:
        def logits_of(variables: Variables, settings: TrainSettings) -> Array:
            return _over_mirror(
                lambda maps: _from_maps(module, variables, maps, size, settings), sides
            )

        if output == "heads":
            each = [logits_of(own, alone) for own in heads_of(variables, net_settings)]
            labels = [jnp.argmax(logits, axis=-1) for logits in (sum(each), *each)]
            return jnp.stack(labels, axis=1).astype(jnp.uint8)
        logits = logits_of(variables, net_settings)
        return logits if output == "scores" else jnp.argmax(logits, axis=-1).astype(jnp.uint8)

    return predict_batch


def _of_net(settings: TrainSettings) -> TrainSettings:
    """The settings on which a prediction depends; the others have their defaults."""
    names = ["net", "dtype", "norm", "trunk", "head_width", "head_dropout", "heads"]
    names.append("average_mirror")
    if settings.has_trunk:
        names.append("weights")
    return replace(TrainSettings(), **{name: getattr(settings, name) for name in names})


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
    """Train a net; the same arguments give the same variables.

    Heads train one after the other: the first as if it were alone.

    Args:
        rng_seed: 32 bits for initial parameters, the order of the images and augmentation.
        images: RGB.
        labels: class ids, 255 for void.
        settings: everything else.
        classes: the net's number of classes.
        progress: called every 50 steps with the number of steps and the last loss.
        params: start from this trained net (it is not changed); None starts from the settings' `weights`
            and at random elsewhere: `seg.weights.described` says which layers.
        stepwise: call the step from the host (True) or scan it in chunks (False); the default suits the
            backend. The steps are the same.
        features: for a frozen trunk, the features of all views of the images, `seg.pyramid.features` of
            `seg.views.view_images`; None computes them.
        statistics: for a net with a trunk and `head_statistics` "target": the fixed statistics of its head,
            from `channel_statistics` of real images. Not needed, and not used, with ``params``.
        beside: more images of the same size, such as labelled real ones beside renders; for a frozen trunk
            they may have the features of all their views. Class weights and training statistics are those
            of the images in the batches.
        share: share of ``beside`` in the images of all batches, in (0, 1), even if they are few; with the
            settings' `last_share` that of the first batch.
        checkpoints: number of evenly spaced steps after which `at_checkpoint` is called, at most all; the
            last one is the end. More than one are for nets of one head.
        at_checkpoint: called with the net's variables, which are valid until it returns. Until the steps
            begin that the settings average, they are those after the step.

    Returns:
        The net's variables by collection: `params` after the last step, or their mean over the steps that
        the settings average, and a head's `statistics`. With a frozen trunk they are the head's alone, since
        the trunk's do not change and `predict` loads them as training did. Those of several heads are
        stacked along a first axis.

    Raises:
        ValueError: no images, shapes that do not match, labels outside the classes, settings or a seed
            out of range, or images too small for the net.
        TrainingError: the loss is not finite.
        WeightsError: the settings' `weights`, or the trunk's, cannot be used.
    """
    check_settings(settings)
    check_seed(rng_seed)
    if not 1 <= checkpoints <= settings.steps:
        raise ValueError(
            f"checkpoints must lie in 1..{settings.steps}, the steps; got {checkpoints}"
        )
    if checkpoints > 1 and settings.heads > 1:
        raise ValueError(f"checkpoints are of nets of one head; the settings have {settings.heads}")
    own = training_set(LabelledImages(images, labels, features=features), beside, share)
    prepared = prepare(own, settings, classes, statistics, resumes=params is not None)
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
    del own, prepared  # features are large, and joined ones are a copy
    starts = [None] * settings.heads if params is None else heads_of(variables_of(params), settings)
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
        told = progress and partial(_told, progress, head * settings.steps)
        data = data._replace(seed=np.uint32(seed))
        nets.append(
            _after(
                compiled, state, data, rows, settings, told, stepwise, checkpoints, at_checkpoint
            )
        )
    return stacked(nets)


def _told(progress: Callable[[int, float], None], before: int, step: int, loss: float) -> None:
    progress(before + step, loss)


def _after(
    compiled: Functions,
    state: TrainState,
    data: Data,
    rows: Plan,
    settings: TrainSettings,
    progress: Callable[[int, float], None] | None,
    stepwise: bool | None,
    checkpoints: int,
    at_checkpoint: Callable[[Variables], None] | None,
) -> Variables:
    """The variables of a net with one head after all steps; arguments and errors are those of `train`."""
    if stepwise is None:
        stepwise = jax.default_backend() == "cpu"
    checked = {settings.steps, *range(CHUNK, settings.steps, CHUNK)}
    kept = {settings.steps * k // checkpoints for k in range(1, checkpoints + 1)}
    for start, stop in pairwise(sorted({0, *checked, *kept})):
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
        if at_checkpoint is not None and stop in kept:
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
        params: a trained net, from `train` or from a file of any version.
        images: RGB of any size; with a trunk no side is shorter than its largest stride.
        settings: the settings of the training.
        classes: the net's number of classes.
        features: for a frozen trunk, `seg.pyramid.features` of `seg.views.with_mirror`; None computes
            them. The prediction is the same.

    Returns:
        The most likely class of each pixel.

    Raises:
        ValueError: there are no images, they are not RGB bytes, or too small for the net.
        WeightsError: the frozen trunk's weights cannot be used.
    """
    return _of_batches(params, images, settings, classes, features, "labels")


def logits(
    params: Variables,
    images: UInt8[np.ndarray, "n h w 3"],
    settings: TrainSettings,
    classes: int,
    *,
    features: Maps | None = None,
) -> Float32[np.ndarray, "n h w classes"]:
    """Scores of all classes, of which `predict` takes the largest; arguments and errors are the same."""
    return _of_batches(params, images, settings, classes, features, "scores")


def _of_batches(
    params: Variables,
    images: np.ndarray,
    settings: TrainSettings,
    classes: int,
    features: Maps | None,
    output: Output,
) -> np.ndarray:
    """Compute labels, or the scores of all classes; only nets on a frozen trunk have "heads"."""
    check_arrays(images)
    sides = 2 if settings.average_mirror else 1
    check_inputs(images, settings, features, sides)
    variables = jax.device_put(variables_of(params))  # once, not for every batch
    if settings.frozen:
        size, count = (images.shape[1], images.shape[2]), len(images)
        maps = features or pyramid.features(with_mirror(images, settings), settings)
        predict_head = _head_predictor(_of_net(settings), classes, output)

        def run(picks: np.ndarray) -> Array:
            of_side = [tuple(m[picks + side * count] for m in maps) for side in range(sides)]
            return predict_head(variables, of_side, size)

        return in_batches(run, np.arange(count), settings.predict_batch)
    predict_batch = _predictor(_of_net(settings), classes, output)
    return in_batches(lambda batch: predict_batch(variables, batch), images, settings.predict_batch)


def outline(settings: TrainSettings, classes: int) -> Variables:
    """Shapes and types of the result of `train`, as a tree of `jax.ShapeDtypeStruct`."""
    compiled = functions(settings, classes)
    images: Any = jax.ShapeDtypeStruct((1, 64, 64, 3), np.uint8)
    if settings.frozen:
        channels = trunk_of(settings).channels
        images = tuple(jax.ShapeDtypeStruct((1, 1, 1, c), np.float16) for c in channels)
    seed = jax.ShapeDtypeStruct((), np.uint32)
    return jax.eval_shape(
        lambda *given: stacked([compiled.init(*given).trained] * settings.heads), seed, images
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
        labels: class ids, 255 for void.
        settings: the settings of the training.
        classes: the net's number of classes.
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
    """As `predict`, and for a net of several heads the classes by each head alone behind those by all."""
    if settings.heads == 1:
        return predict(params, images, settings, classes, features=features)[:, None]
    return _of_batches(params, images, settings, classes, features, "heads")
