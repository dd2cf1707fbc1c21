"""Losses over labelled pixels, and the weights that balance rare classes."""

import functools

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Int64, Integer, UInt8

from seg.classes import IGNORE_LABEL


def cross_entropy_sums(
    logits: Float[Array, "*shape classes"],
    labels: Integer[Array, "*shape"],
    class_weights: Float[Array, " classes"] | None = None,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Numerator and denominator of `cross_entropy`; both add up over the parts of a batch.

    sum_i w[y_i] * -log p_i[y_i] and sum_i w[y_i], over the labelled pixels.
    """
    labelled = labels != IGNORE_LABEL
    target = jnp.where(labelled, labels, 0).astype(jnp.int32)
    weight = labelled.astype(logits.dtype)
    if class_weights is not None:
        weight = weight * _picked(class_weights, target)
    return jnp.sum(weight * _nats(jnp.moveaxis(logits, -1, 0), target)), jnp.sum(weight)


def _picked(planes: Array, target: Array) -> Array:
    """planes[target], without a gather."""
    return functools.reduce(
        jnp.add, (jnp.where(target == k, plane, 0) for k, plane in enumerate(planes))
    )


@jax.custom_vjp
def _nats(planes: Float[Array, "classes *shape"], target: Array) -> Float[Array, "*shape"]:
    """-log softmax of the target; with classes first, a CPU works on many pixels at a time."""
    return _nats_forward(planes, target)[0]


def _nats_forward(planes: Array, target: Array) -> tuple[Array, tuple[Array, Array, Array]]:
    highest = functools.reduce(jnp.maximum, planes)
    total = functools.reduce(jnp.add, (jnp.exp(plane - highest) for plane in planes))
    normaliser = highest + jnp.log(total)
    return normaliser - _picked(planes, target), (planes, normaliser, target)


def _nats_backward(saved: tuple[Array, Array, Array], grad: Array) -> tuple[Array, None]:
    planes, normaliser, target = saved
    classes = jnp.arange(len(planes)).reshape(-1, *(1,) * target.ndim)
    return (jnp.exp(planes - normaliser[None]) - (target[None] == classes)) * grad[None], None


_nats.defvjp(_nats_forward, _nats_backward)


def cross_entropy(
    logits: Float[Array, "*shape classes"],
    labels: Integer[Array, "*shape"],
    class_weights: Float[Array, " classes"] | None = None,
) -> Float[Array, ""]:
    """Weighted mean of -log softmax(logits)[label] over the labelled pixels.

    sum_i w[y_i] * -log p_i[y_i] / sum_i w[y_i]; if all pixels are ignored, it is exactly 0 with gradient 0.

    Args:
        logits: one vector per pixel.
        labels: class ids; `IGNORE_LABEL` for ignored pixels.
        class_weights: None for equal weights.

    Returns:
        The loss, in nats.
    """
    nats, total = cross_entropy_sums(logits, labels, class_weights)
    return nats / jnp.where(total > 0, total, 1)


def soft_jaccard(
    logits: Float[Array, "*shape classes"],
    labels: Integer[Array, "*shape"],
) -> Float[Array, ""]:
    """1 - mean_c (I_c + 1) / (U_c + 1) over the classes c that occur in the labels.

    I_c = sum_i p_i[c] over the pixels of the class, and U_c = sum_i p_i[c] + their number - I_c, with the
    first sum over all labelled pixels; p = softmax(logits). If all pixels are ignored, it is exactly 0
    with gradient 0.

    Source: the soft intersection over union of Rahman and Wang (2016), smoothed by 1 pixel.

    Args:
        logits: one vector per pixel.
        labels: class ids; `IGNORE_LABEL` for ignored pixels.

    Returns:
        The loss, in 0..1.
    """
    planes = jnp.moveaxis(logits, -1, 0)
    classes = jnp.arange(len(planes)).reshape(-1, *(1,) * labels.ndim)
    pixels = tuple(range(1, planes.ndim))
    truth = labels[None] == classes
    p = jnp.where(labels[None] == IGNORE_LABEL, 0, jax.nn.softmax(planes, axis=0))
    shared = jnp.sum(jnp.where(truth, p, 0), axis=pixels)
    count = jnp.sum(truth, axis=pixels).astype(p.dtype)
    ratio = (shared + 1) / (jnp.sum(p, axis=pixels) + count - shared + 1)
    occurs = count > 0
    return jnp.sum(jnp.where(occurs, 1 - ratio, 0)) / jnp.maximum(jnp.sum(occurs), 1)


def class_shares(labels: UInt8[np.ndarray, "n h w"], classes: int) -> Float[np.ndarray, " classes"]:
    """Each class's share of the labelled pixels; 0 if every pixel is ignored."""
    counts = label_counts(labels)[:classes]  # `IGNORE_LABEL` is behind all classes
    return counts / max(counts.sum(), 1)


def label_counts(labels: UInt8[np.ndarray, "n h w"]) -> Int64[np.ndarray, "256"]:
    """Count the pixels of each id; OpenCV takes a quarter of the time of `np.bincount`."""
    counts = np.zeros(256, np.int64)
    for label in labels:
        counts += cv2.calcHist([label], [0], None, [256], [0, 256]).ravel().astype(np.int64)
    return counts


def weights_of_shares(share: Float[np.ndarray, " classes"]) -> Float32[np.ndarray, " classes"]:
    """Weights of the loss that lift rare classes: (share + 0.01)^-0.75, scaled to mean 1."""
    weights = (share + 0.01) ** -0.75
    return (weights / weights.mean()).astype(np.float32)
