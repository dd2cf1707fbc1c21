"""Trains and scores networks of one shape at once, for accelerators.

One network of this size keeps a GPU busy for a fraction of its time. Here the step of `seg.step` is
vectorised over networks and scanned over all updates, so that one compiled call trains all of them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int32, Int64, Shaped, UInt8

from seg import pyramid
from seg.beside import TrainingSet, training_set
from seg.check import check_settings
from seg.classes import IGNORE_LABEL
from seg.data import LabelledImages
from seg.nets import net_of
from seg.prepare import (
    Prepared,
    check_arrays,
    check_inputs,
    check_labels,
    check_seed,
    error_of,
    first_variables,
    head_seeds,
    prepare,
)
from seg.pyramid import Statistics
from seg.settings import TrainSettings
from seg.step import Data, Plan, TrainState, Variables, functions, plan
from seg.train import CHUNK, TrainingError, _from_maps, _of_net, _over_mirror, apply, heads_of
from seg.views import with_mirror


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

    @property
    def confusions(self) -> Int64[np.ndarray, "networks classes classes"] | None:
        """The confusion matrix of each network on all test images; None without test images."""
        return None if self.by_image is None else self.by_image.sum(axis=1)


def padded(count: int) -> int:
    """The least of 1, 2, 3, 4, 6, 8, 12, 16, 24 ... that is not below a count.

    Arrays of these lengths serve for all counts, so that few shapes are compiled.
    """
    power = 1 << max(count - 1, 0).bit_length()
    return 3 * power // 4 if power > 2 and count <= 3 * power // 4 else power


def train_many(
    seeds: Sequence[int],
    sets: Sequence[LabelledImages | TrainingSet],
    settings: TrainSettings,
    classes: int,
    *,
    statistics: Statistics | None = None,
    test: LabelledImages | None = None,
) -> TrainedNetworks:
    """Train a network on each training set, all at once, and test them.

    Each network is that of `train` with the same seed and set, up to rounding. Their number and the numbers
    of images are padded to those of `padded`, so that one compilation serves sets of similar sizes; padding
    is not trained on.

    It is meant for GPUs: XLA's CPU backend is slow at convolutions inside a loop. The images (or features) of
    all sets, and for the compact and VGG networks all activations of the networks' batches, must fit into the
    device's memory.

    Args:
        seeds: for each network 32 bits for initial parameters, the order of the images and augmentation.
        sets: for each network its labelled images u8[n, h, w, 3] with labels u8[n, h, w]; or a
            `TrainingSet` of two parts, the second of which has a share of all batches (`beside` and `share`
            of `train`). Images of all sets have one size. For a frozen backbone they may have the features
            of all their views.
        settings: everything else.
        classes: the networks' number of classes.
        statistics: for `head_statistics` "target": the statistics of every network's features.
        test: images u8[n, h, w, 3] with labels, on which every network is scored; for a frozen backbone
            they may have the features of `seg.views.with_mirror`.

    Returns:
        The networks, and their confusion matrices. A network whose loss is not finite has an error; it does
        not change the others.

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
    prepared = []
    for number, images in enumerate(sets):
        try:
            whole = images if isinstance(images, TrainingSet) else TrainingSet((images,))
            if len(whole.parts) > 1:
                whole = training_set(*whole.parts, whole.shares[1])
            prepared.append(prepare(whole, settings, classes, statistics))
        except ValueError as error:
            raise ValueError(f"sets[{number}]: {error}") from error
    sizes = {images.labels[0].shape[1:]: number for number, images in enumerate(prepared)}
    if len(sizes) > 1:
        listed = ", ".join(f"{w}x{h} in sets[{number}]" for (h, w), number in sizes.items())
        raise ValueError(f"images of all sets must have one size; got {listed}")
    tests = None if test is None else _test_inputs(test, settings, classes)
    count = len(seeds)
    # The last network is trained again in the place of each missing one.
    networks = np.minimum(np.arange(padded(count)), count - 1)
    trained, losses = _trained(
        [seeds[k] for k in networks], [prepared[k] for k in networks], settings, classes
    )
    errors = tuple(_first_error(losses[:, k], settings) for k in range(count))
    stacked = jax.tree.map(lambda leaf: leaf[:count], trained)
    if test is None or tests is None:
        return TrainedNetworks(stacked, errors)
    counts = _scorer(_of_net(settings), classes)(trained, *tests)
    matrices = np.asarray(counts, np.int64)[:, :, :count]
    succeeded = np.array([error is None for error in errors])
    # [batches, b, networks, 1 + heads, classes, classes] -> [networks, n, 1 + heads, classes, classes]
    matrices = matrices.reshape(-1, *matrices.shape[2:])[: len(test.images)].swapaxes(0, 1)
    matrices = matrices * succeeded[:, None, None, None, None]
    by_head = matrices[:, :, 1:].sum(axis=1) if settings.heads > 1 else None
    return TrainedNetworks(stacked, errors, matrices[:, :, 0], by_head)


def _first_error(losses: Shaped[np.ndarray, "steps heads"], settings: TrainSettings) -> str | None:
    """The error of `train`, which looks at the loss from time to time, head by head."""
    checked = [*range(CHUNK, settings.steps, CHUNK), settings.steps]
    errors = (
        error_of(float(row[step - 1]), step, settings) for row in losses.T for step in checked
    )
    return next(filter(None, errors), None)


def _trained(
    seeds: Sequence[int], sets: Sequence[Prepared], settings: TrainSettings, classes: int
) -> tuple[Variables, Shaped[np.ndarray, "steps networks heads"]]:
    """Train all heads of all networks; their stacked variables, and the losses of all steps."""
    compiled = functions(settings, classes)
    of_heads = [head_seeds(seed, settings.heads) for seed in seeds]
    data = jax.device_put(_stacked(sets, of_heads))
    states = _first_states(of_heads, sets, data, settings, classes)
    plans = [
        [plan(seed, own.counts, settings, own.share) for seed in heads]
        for heads, own in zip(of_heads, sets, strict=True)
    ]
    rows = Plan(
        *(
            np.array([[getattr(p, name) for p in own] for own in plans])
            for name in ("picks", "draws")
        ),
        plans[0][0].lr,
        plans[0][0].weight,
    )
    # [networks, heads, steps, ...] -> [steps, networks, heads, ...]
    rows = rows._replace(picks=np.moveaxis(rows.picks, 2, 0), draws=np.moveaxis(rows.draws, 2, 0))
    states, losses = compiled.many(states, data, rows)
    trained = states.trained
    fixed = {name: tree for name, tree in trained.items() if name != "params"}
    # Statistics are those of the set; parameters have an axis of heads only if there are several.
    fixed = jax.tree.map(lambda leaf: leaf[:, 0], fixed)
    params = trained["params"]
    if settings.heads == 1:
        params = jax.tree.map(lambda leaf: leaf[:, 0], params)
    return {"params": params, **fixed}, np.asarray(losses)


def _stacked(sets: Sequence[Prepared], seeds: Sequence[Sequence[int]]) -> Data:
    """The data of all sets, padded to one number of images."""
    rows = padded(max(sum(own.counts) for own in sets))

    def column(of_sets: list[list[Any]]) -> np.ndarray:
        first = of_sets[0][0]
        stacked = np.zeros((len(sets), rows, *first.shape[1:]), first.dtype)
        for row, parts in zip(stacked, of_sets, strict=True):
            start = 0
            for part in parts:
                row[start : start + len(part)] = part
                start += len(part)
        return stacked

    inputs: Any
    if isinstance(sets[0].inputs[0], tuple):
        maps = range(len(sets[0].inputs[0]))
        inputs = tuple(column([[part[m] for part in own.inputs] for own in sets]) for m in maps)
    else:
        inputs = column([list(own.inputs) for own in sets])
    labels = column([list(own.labels) for own in sets])
    weights = np.stack([own.class_weights for own in sets])
    return Data(inputs, labels, weights, np.array(seeds, np.uint32))


def _first_states(
    seeds: Sequence[Sequence[int]],
    sets: Sequence[Prepared],
    data: Data,
    settings: TrainSettings,
    classes: int,
) -> TrainState:
    """The states before the first step, of axes sets and heads."""
    compiled = functions(settings, classes)
    blank = jax.tree.map(lambda leaf: jnp.zeros((1, *leaf.shape[2:]), leaf.dtype), data.images)

    def first(seed: Array) -> Any:
        return compiled.init(seed, blank).params

    params = jax.vmap(jax.vmap(first))(jnp.array(seeds, jnp.uint32))
    if settings.has_trunk or settings.weights is not None:
        params = jax.device_get(params)
        variables = [
            [
                first_variables(
                    jax.tree.map(lambda leaf, at=(k, head): leaf[at], params),
                    settings,
                    own.statistics,
                )
                for head in range(settings.heads)
            ]
            for k, own in enumerate(sets)
        ]
        of_sets = [jax.tree.map(lambda *leaves: np.stack(leaves), *heads) for heads in variables]
        start = jax.tree.map(lambda *leaves: np.stack(leaves), *of_sets)
    else:
        start = {"params": params}
    return jax.vmap(jax.vmap(compiled.resume))(start)


def _test_inputs(
    test: LabelledImages, settings: TrainSettings, classes: int
) -> tuple[Any, UInt8[np.ndarray, "batches b h w"]]:
    """Test images (or features of each side) and labels in batches; padding is labelled as ignored."""
    images, labels, maps = test.images, test.labels, test.features
    check_arrays(images, labels)
    check_labels(labels, classes)
    sides = 2 if settings.average_mirror else 1
    check_inputs(images, settings, maps, sides)
    count, size = len(images), min(settings.predict_batch, len(images))

    def batches(rows: np.ndarray, fill: int = 0) -> np.ndarray:
        padding = [(0, -count % size), *[(0, 0)] * (rows.ndim - 1)]
        rows = np.pad(rows, padding, constant_values=fill)
        return rows.reshape(-1, size, *rows.shape[1:])

    inputs: Any = batches(images)
    if settings.frozen:
        maps = maps or pyramid.features(with_mirror(images, settings), settings)
        inputs = [
            tuple(batches(m[side * count : (side + 1) * count]) for m in maps)
            for side in range(sides)
        ]
    return inputs, batches(labels, IGNORE_LABEL)


@lru_cache(maxsize=32)
def _scorer(net_settings: TrainSettings, classes: int) -> Callable[..., Array]:
    """A compiled function of stacked variables, inputs and labels of batches, which counts."""
    module, alone = net_of(net_settings, classes), replace(net_settings, heads=1)

    def labels_of(variables: Variables, inputs: Any, size: tuple[int, int]) -> Array:
        """Classes by all heads, then by each of several heads alone: [1 + heads, b, h, w]."""

        def logits(variables: Variables, settings: TrainSettings) -> Array:
            if not net_settings.frozen:
                return apply(variables, inputs, settings, classes)
            return _over_mirror(
                lambda maps: _from_maps(module, variables, maps, size, settings), inputs
            )

        if net_settings.heads == 1:
            return jnp.argmax(logits(variables, alone), axis=-1)[None]
        by_head = [logits(own, alone) for own in heads_of(variables, net_settings)]
        return jnp.stack([jnp.argmax(x, axis=-1) for x in (sum(by_head), *by_head)])

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
        def batch(both: tuple[Any, Array]) -> Array:
            own, truth = both
            size = (truth.shape[1], truth.shape[2])
            of_network = lambda variables: of_images(truth, labels_of(variables, own, size))  # noqa: E731
            return jax.vmap(of_network, out_axes=1)(variables)

        return jax.lax.map(batch, (inputs, labels))

    return score
