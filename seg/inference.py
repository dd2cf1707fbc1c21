"""Predicts with trained networks, by all heads and for mirror images, and scores predictions."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float32, Int32, Int64, UInt8

from seg import pyramid
from seg.batches import in_batches, padded
from seg.metrics import confusion_matrix
from seg.nets import FeatureMaps, OnBackbone, net_of, variables_of
from seg.nets.backbones import backbone_of
from seg.nets.head import Maps
from seg.prepare import check_arrays, check_inputs
from seg.settings import NetSpec, TrainSettings
from seg.step import Variables, functions


def apply(
    variables: Variables, images: UInt8[Array, "b h w 3"], settings: TrainSettings, classes: int
) -> Float32[Array, "b h w classes"]:
    """The result of `logits` as one function that JAX can trace, with a frozen backbone, too."""
    sides: Any = (images, images[:, :, ::-1]) if settings.average_mirror else (images,)
    backbone = settings.net_spec.backbone
    if settings.frozen:
        assert backbone is not None
        with jax.ensure_compile_time_eval():  # a backbone may draw its weights
            params = pyramid.backbone_params(settings)
        size = (images.shape[1], images.shape[2])
        sides = tuple(FeatureMaps(pyramid.maps_of(params, s, backbone), size) for s in sides)
    return mean_logits(settings.net_spec, heads_of(variables, settings.heads), sides, classes)


def mean_logits(
    spec: NetSpec,
    heads: Sequence[Variables],
    sides: Sequence[Any],
    classes: int,
) -> Float32[Array, "b h w classes"]:
    """Mean logits over heads and sides, inside a compiled function.

    Args:
        spec: of the network.
        heads: the variables of each head; several heads are on a frozen backbone.
        sides: images u8[b, h, w, 3], or the `FeatureMaps` of a frozen backbone; then, if they count, those of
            the mirror images, whose logits are mirrored back.
        classes: the network's number of classes.
    """
    module = net_of(spec, classes)

    def side_logits(inputs: Any) -> Array:
        if not isinstance(inputs, FeatureMaps):
            inputs = inputs.astype(jnp.float32) / 255
        if len(heads) == 1:
            return module.apply(heads[0], inputs)
        # Scores are averaged before they are enlarged: with the same result for less work.
        scores = [module.apply(head, inputs.maps, method=OnBackbone.scores) for head in heads]
        mean = sum(scores) / len(scores)
        return module.apply(heads[0], mean, inputs.size, method=OnBackbone.enlarged)

    direct, *mirrored = map(side_logits, sides)
    return (direct + mirrored[0][:, :, ::-1]) / 2 if mirrored else direct


def labels_by_head(
    spec: NetSpec,
    heads: Sequence[Variables],
    sides: Sequence[Any],
    classes: int,
) -> list[Int32[Array, "b h w"]]:
    """Classes by all heads together, then by each of several heads alone; arguments as of `mean_logits`."""
    head_logits = [mean_logits(spec, [head], sides, classes) for head in heads]
    logits = head_logits if len(heads) == 1 else [sum(head_logits), *head_logits]
    return [jnp.argmax(scores, axis=-1) for scores in logits]


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
) -> Callable[[Variables, Sequence[Any]], Array]:
    """A compiled function of variables and `prediction_inputs` of a batch."""

    @jax.jit
    def predict_batch(variables: Variables, sides: Sequence[Any]) -> Array:
        head_variables = heads_of(variables, heads)
        if output == "heads":
            labels = labels_by_head(spec, head_variables, sides, classes)
            return jnp.stack(labels, axis=1).astype(jnp.uint8)
        logits = mean_logits(spec, head_variables, sides, classes)
        return logits if output == "scores" else jnp.argmax(logits, axis=-1).astype(jnp.uint8)

    return predict_batch


def prediction_inputs(
    images: UInt8[np.ndarray, "n h w 3"], settings: TrainSettings, features: Maps | None = None
) -> tuple[Any, ...]:
    """What a network sees of images: themselves, or features; and of mirror images, if they count, too.

    Args:
        images: RGB.
        settings: of the training.
        features: for a frozen backbone, `seg.pyramid.prediction_features`; None computes them.

    Raises:
        ValueError: there are no images, they are not RGB bytes, or too small for the network.
        WeightsError: the frozen backbone's weights cannot be used.
    """
    check_arrays(images)
    sides = 2 if settings.average_mirror else 1
    check_inputs(images, settings, features, sides)
    if not settings.frozen:
        return (images, images[:, :, ::-1])[:sides]
    maps = features or pyramid.prediction_features(images, settings)
    count = len(images)
    parts = [slice(k * count, (k + 1) * count) for k in range(sides)]
    return tuple(FeatureMaps(tuple(m[part] for m in maps), images.shape[1:3]) for part in parts)


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
        features: for a frozen backbone, `seg.pyramid.prediction_features`; None computes them. The
            prediction is the same.

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

    def run(batch: np.ndarray) -> Array:
        return predict_batch(variables, jax.tree.map(lambda side: side[batch], sides))

    size = min(settings.predict_batch, padded(len(images)))
    return in_batches(run, np.arange(len(images)), size)


def variable_shapes(settings: TrainSettings, classes: int) -> Variables:
    """Shapes and types of the result of `train`, as a tree of `jax.ShapeDtypeStruct`."""
    compiled = functions(settings, classes)
    images: Any = jax.ShapeDtypeStruct((1, 64, 64, 3), np.uint8)
    if settings.frozen:
        channels = backbone_of(settings).channels
        maps = tuple(jax.ShapeDtypeStruct((1, 1, 1, c), np.float16) for c in channels)
        images = FeatureMaps(maps, (8, 8))
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
