"""Trains and scores many networks of one shape at once, for accelerators."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int32, Int64, UInt8

from seg.at_once import train_at_once
from seg.batches import padded
from seg.check import check_settings
from seg.classes import IGNORE_LABEL
from seg.data import LabelledImages
from seg.inference import heads_of, labels_by_head, prediction_inputs
from seg.mixing import TrainingSet, training_set
from seg.prepare import (
    PartCache,
    TrainingError,
    check_arrays,
    check_labels,
    check_seed,
    prepare,
)
from seg.pyramid import Statistics
from seg.settings import NetSpec, TrainSettings
from seg.step import Variables


@dataclass(frozen=True)
class TrainedNetworks:
    """Networks that were trained at once.

    Attributes:
        stacked: the variables of all networks, stacked along a first axis, on the device.
        errors: why the training of a network failed; None where it succeeded.
        by_image: confusion matrices of each network on each test image (row: true class, column: predicted
            class), all 0 where the training failed; None without test images.
        by_head: confusion matrices of each network's heads alone on all test images; None for one head.
    """

    stacked: Variables
    errors: tuple[str | None, ...]
    by_image: Int64[np.ndarray, "networks n classes classes"] | None = None
    by_head: Int64[np.ndarray, "networks heads classes classes"] | None = None

    def __len__(self) -> int:
        """The number of networks."""
        return len(self.errors)

    def variables(self, network: int) -> Variables:
        """The variables of one network, as `seg.train` returns them.

        Raises:
            TrainingError: its training failed.
        """
        error = self.errors[network]
        if error is not None:
            raise TrainingError(error)
        return jax.tree.map(lambda leaf: leaf[network], self.stacked)


def train_many(
    seeds: Sequence[int],
    sets: Sequence[LabelledImages | TrainingSet],
    settings: TrainSettings,
    classes: int,
    *,
    statistics: Statistics | None = None,
    test: LabelledImages | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> TrainedNetworks:
    """Train a network on each training set, all at once, and test them.

    Each network is that of `train` with the same seed and set, up to rounding. The numbers of networks and of
    images are padded to those of `padded`, so that one compilation serves a whole search; networks do not
    see the padding. Images that several sets share (the same arrays) are prepared and stored once.

    It is meant for GPUs: XLA's CPU backend is slow at convolutions inside a loop. The images (or features) of
    all sets, and the activations of all networks' batches, must fit into the device's memory.

    Args:
        seeds: for each network 32 bits for initial parameters, the order of the images and augmentation.
        sets: for each network its labelled images u8[n, h, w, 3] with labels u8[n, h, w]; or a
            `TrainingSet` of two parts, the second of which has a share of all batches (`extra` and `share`
            of `train`). Images of all sets have one size. For a frozen backbone they may have the features
            of all their views.
        settings: everything else.
        classes: the networks' number of classes.
        statistics: for `head_statistics` "target": the statistics of every network's features.
        test: images u8[n, h, w, 3] with labels, on which every network is scored; for a frozen backbone
            they may have `seg.pyramid.prediction_features`.
        progress: called every 50 steps with the number of steps and the mean loss.

    Returns:
        The networks, and their confusion matrices. A network whose loss or weights are not finite has an
        error; it does not change the others.

    Raises:
        ValueError: as for `train`; the message begins with the set, if it is about one.
        WeightsError: the settings' `weights`, or the backbone's, cannot be used.
    """
    check_settings(settings)
    if len(seeds) != len(sets) or not seeds:
        raise ValueError(
            f"seeds and sets must be one of each per network; got {len(seeds)} and {len(sets)}"
        )
    for seed in seeds:
        check_seed(seed)
    prepared, cache = [], PartCache()
    for number, images in enumerate(sets):
        try:
            whole = images if isinstance(images, TrainingSet) else TrainingSet((images,))
            if len(whole.parts) != len(whole.shares) or len(whole.parts) > 2:
                raise ValueError(
                    f"a training set has one or two parts, with a share for each; got {len(whole.parts)} "
                    f"and {len(whole.shares)}"
                )
            if len(whole.parts) > 1:
                whole = training_set(whole.parts[0], whole.parts[1], whole.shares[1])
            prepared.append(prepare(whole, settings, classes, statistics, cache=cache))
        except ValueError as error:
            raise ValueError(f"sets[{number}]: {error}") from error
    sizes = {one_set.parts[0].labels.shape[1:]: number for number, one_set in enumerate(prepared)}
    if len(sizes) > 1:
        listed = ", ".join(f"{w}x{h} in sets[{number}]" for (h, w), number in sizes.items())
        raise ValueError(f"images of all sets must have one size; got {listed}")
    tests = None if test is None else _test_batches(test, settings, classes)
    count = len(seeds)
    # The last network is trained again in the place of each missing one.
    networks = np.minimum(np.arange(padded(count)), count - 1)
    trained, padded_errors = train_at_once(
        [seeds[k] for k in networks], [prepared[k] for k in networks], settings, classes, progress
    )
    errors = tuple(padded_errors[:count])
    stacked = jax.tree.map(lambda leaf: leaf[:count], trained)
    if test is None or tests is None:
        return TrainedNetworks(stacked, errors)
    counts = _scorer(settings.net_spec, settings.heads, classes)(trained, *tests)
    matrices = np.asarray(counts, np.int64)[:, :, :count]
    succeeded = np.array([error is None for error in errors])
    # [batches, b, networks, 1 + heads, classes, classes] -> [networks, n, 1 + heads, classes, classes]
    matrices = matrices.reshape(-1, *matrices.shape[2:])[: len(test.images)].swapaxes(0, 1)
    matrices = matrices * succeeded[:, None, None, None, None]
    by_head = matrices[:, :, 1:].sum(axis=1) if settings.heads > 1 else None
    return TrainedNetworks(stacked, errors, matrices[:, :, 0], by_head)


def _test_batches(
    test: LabelledImages, settings: TrainSettings, classes: int
) -> tuple[Any, UInt8[np.ndarray, "batches b h w"]]:
    """Inputs and labels of all test images in batches; padding is labelled as ignored."""
    check_arrays(test.images, test.labels)
    check_labels(test.labels, classes)
    count = len(test.images)
    size = min(settings.predict_batch, count)

    def batches(rows: np.ndarray, fill: int = 0) -> np.ndarray:
        padding = [(0, -count % size), *[(0, 0)] * (rows.ndim - 1)]
        return np.pad(rows, padding, constant_values=fill).reshape(-1, size, *rows.shape[1:])

    inputs = jax.tree.map(batches, prediction_inputs(test.images, settings, test.features))
    return inputs, batches(test.labels, IGNORE_LABEL)


@lru_cache(maxsize=32)
def _scorer(spec: NetSpec, heads: int, classes: int) -> Callable[..., Array]:
    """A compiled function of stacked variables, inputs and labels of batches, which counts."""

    def labels_of(variables: Variables, inputs: Any) -> Array:
        """Classes by all heads, then by each of several heads alone: [1 + heads, b, h, w]."""
        return jnp.stack(labels_by_head(spec, heads_of(variables, heads), inputs, classes))

    def count(truth: Array, predicted: Array) -> Int32[Array, "classes classes"]:
        cell = jnp.where(truth < classes, truth.astype(jnp.int32) * classes + predicted, classes**2)
        counts = jnp.zeros(classes**2, jnp.int32).at[cell.ravel()].add(1, mode="drop")
        return counts.reshape(classes, classes)

    of_heads = jax.vmap(count, in_axes=(None, 0))
    of_images = jax.vmap(of_heads, in_axes=(0, 1))

    @jax.jit
    def score(
        variables: Variables, inputs: Any, labels: UInt8[Array, "batches b h w"]
    ) -> Int32[Array, "batches b networks views classes classes"]:
        def batch(pair: tuple[Any, Array]) -> Array:
            inputs, truth = pair
            of_network = lambda variables: of_images(truth, labels_of(variables, inputs))  # noqa: E731
            return jax.vmap(of_network, out_axes=1)(variables)

        return jax.lax.map(batch, (inputs, labels))

    return score
