"""A linear net on a frozen trunk's features, solved in closed form, and the credit of every training image.

Linear discriminant analysis of the finest cells: features of all classes have one covariance, and each class
its own mean. The net depends on its training images through sums over their cells (`Moments`), so mIoU has
an exact derivative by an image's weight in the training set: its credit.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import cho_factor, cho_solve
from jaxtyping import Array, Float, Float32, Int64, UInt8

from seg.metrics import confusion_matrix
from seg.nets.head import Maps
from seg.nets.ops.resize import bilinear
from seg.nets.trunks import trunk_of
from seg.pyramid import Statistics
from seg.settings import TrainSettings

RIDGE = 1.0
"""Share of the mean variance of a feature that is added to each. With less, credits depend on fine details of
single images, and those of two sets of streets agree less on attributes; with much more, a net is worse."""
TINY = 1e-6
"""It keeps denominators of absent classes above 0."""
NEVER = -1e9
"""The log probability of a class that no training image has."""


class Moments(NamedTuple):
    """Sums over the labelled cells of images."""

    counts: Float[Any, " classes"]
    sums: Float[Any, "classes channels"]
    squares: Float[Any, "channels channels"]

    def __add__(self, other: Any) -> "Moments":
        """The moments of both sets of images."""
        return Moments(*(a + b for a, b in zip(self, other, strict=True)))

    def times(self, factor: float) -> "Moments":
        """The moments of images with other weights."""
        return Moments(*(factor * part for part in self))


def cell_labels(
    labels: UInt8[np.ndarray, "n h w"], settings: TrainSettings
) -> UInt8[np.ndarray, "n rows cols"]:
    """The labels in the centres of the finest map's cells."""
    stride = trunk_of(settings).strides[0]
    rows, cols = (
        np.minimum(np.arange(-(-size // stride)) * stride + stride // 2, size - 1)
        for size in labels.shape[1:]
    )
    return labels[:, rows[:, None], cols]


def moments(
    maps: Maps,
    labels: UInt8[np.ndarray, "n rows cols"],
    statistics: Statistics,
    settings: TrainSettings,
    classes: int,
) -> Moments:
    """Sum over the cells of images, in NumPy.

    Args:
        maps: features of the images.
        labels: class ids of their cells, see `cell_labels`.
        statistics: mean and deviation of each channel, by which features are normalised.
        settings: they name the trunk.
        classes: the number of classes.
    """
    own = _functions(trunk_of(settings).strides, classes).moments(tuple(maps), labels, statistics)
    return Moments(*map(np.asarray, own))


def tested(
    training: Moments,
    maps: Maps,
    labels: UInt8[np.ndarray, "n rows cols"],
    statistics: Statistics,
    settings: TrainSettings,
) -> tuple[Int64[np.ndarray, "classes classes"], Moments]:
    """Solve the net for training images and test it on the cells of others.

    Args:
        training: the moments of the training images.
        maps: features of the tested images.
        labels: class ids of their cells; at least one counts.
        statistics: as for `training`.
        settings: they name the trunk.

    Returns:
        The confusion matrix, and the derivative of the soft mIoU in [0, 1] by the training moments. In the
        soft mIoU a pixel counts for each class with its probability.
    """
    classes = len(training.counts)
    predicted, slope = _functions(trunk_of(settings).strides, classes).tested(
        training, tuple(maps), labels, statistics
    )
    return confusion_matrix(labels, np.asarray(predicted), classes), Moments(
        *map(np.asarray, slope)
    )


def credits(
    slope: Moments,
    maps: Maps,
    labels: UInt8[np.ndarray, "n rows cols"],
    statistics: Statistics,
    settings: TrainSettings,
) -> Float32[np.ndarray, "n"]:
    """The derivative of the soft mIoU by the weight of each training image.

    The arguments are those of `moments`, and the derivative from `tested`.
    """
    own = _functions(trunk_of(settings).strides, len(slope.counts))
    return np.asarray(own.credits(slope, tuple(maps), labels, statistics))


_Traced = tuple[Float[Array, " channels"], Float[Array, " channels"]]
"""`Statistics` inside a compiled function."""


class _Functions(NamedTuple):
    moments: Any
    tested: Any
    credits: Any


@lru_cache(maxsize=8)
def _functions(strides: tuple[int, ...], classes: int) -> _Functions:
    """The compiled functions for the strides of a trunk and a number of classes."""

    def cells(maps: Maps, statistics: _Traced) -> Float[Array, "n cells channels"]:
        """Normalised features of all maps at the cells of the finest."""
        n, rows, cols, _ = maps[0].shape
        times = [stride // strides[0] for stride in strides]
        large = [
            bilinear(m.astype(jnp.float32), by)[:, :rows, :cols] if by > 1 else m
            for m, by in zip(maps, times, strict=True)
        ]
        mean, deviation = (jnp.asarray(part)[None, None, None] for part in statistics)
        whole = (jnp.concatenate(large, axis=-1) - mean) / deviation
        return whole.reshape(n, rows * cols, -1)

    def classes_of(labels: Array) -> Float[Array, "n cells classes"]:
        """1 for a cell's class, all 0 for void."""
        return jax.nn.one_hot(labels.reshape(len(labels), -1), classes)

    def summed(maps: Maps, labels: Array, statistics: _Traced) -> Moments:
        x, of = cells(maps, statistics), classes_of(labels)
        known = x * of.sum(axis=-1, keepdims=True)
        flat, flat_known = (part.reshape(-1, x.shape[-1]) for part in (x, known))
        sums = jnp.einsum("nqk,nqd->kd", of, x)
        return Moments(of.sum(axis=(0, 1)), sums, flat_known.T @ flat)

    def solved(of: Moments) -> tuple[Float[Array, "channels classes"], Float[Array, " classes"]]:
        """Weights and biases of the classes' log probabilities."""
        n, channels = of.counts.sum(), of.squares.shape[0]
        means = of.sums / jnp.maximum(of.counts, TINY)[:, None]
        within = (of.squares - of.sums.T @ means) / n
        ridge = RIDGE * jnp.trace(within) / channels
        covariance = within + (ridge + TINY) * jnp.eye(channels)
        weights = cho_solve(cho_factor(covariance, lower=True), means.T)
        prior = jnp.where(of.counts > 0, jnp.log(jnp.maximum(of.counts, TINY) / n), NEVER)
        return weights, prior - 0.5 * (means.T * weights).sum(axis=0)

    def soft(
        training: Moments, maps: Maps, labels: Array, statistics: _Traced
    ) -> tuple[Float[Array, ""], Array]:
        weights, bias = solved(training)
        logits = cells(maps, statistics) @ weights + bias[None, None]
        truth = classes_of(labels)
        guess = jax.nn.softmax(logits) * truth.sum(axis=-1, keepdims=True)
        both = (guess * truth).sum(axis=(0, 1))
        there = truth.sum(axis=(0, 1))
        iou = both / jnp.maximum(guess.sum(axis=(0, 1)) + there - both, TINY)
        predicted = logits.argmax(axis=-1).astype(jnp.uint8).reshape(labels.shape)
        return jnp.where(there > 0, iou, 0).sum() / (there > 0).sum(), predicted

    def derived(
        training: Moments, maps: Maps, labels: Array, statistics: _Traced
    ) -> tuple[Array, Moments]:
        (_, predicted), slope = jax.value_and_grad(soft, has_aux=True)(
            training, maps, labels, statistics
        )
        return predicted, slope

    def credited(
        slope: Moments, maps: Maps, labels: Array, statistics: _Traced
    ) -> Float[Array, "n"]:
        x, of = cells(maps, statistics), classes_of(labels)
        squares = (x @ slope.squares * x).sum(axis=-1) * of.sum(axis=-1)
        sums = ((x @ slope.sums.T + slope.counts[None, None]) * of).sum(axis=-1)
        return (squares + sums).sum(axis=1)

    return _Functions(jax.jit(summed), jax.jit(derived), jax.jit(credited))
