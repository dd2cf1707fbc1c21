"""Trains networks of one shape at once: one compiled step, vectorised over training sets and heads.

One small network keeps a GPU busy for a fraction of its time. XLA's CPU backend is slow at convolutions
inside a loop, so that a CPU trains them one after the other (`seg.train`).
"""

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float32, Int32

from seg.batches import padded
from seg.prepare import CHUNK, Prepared, error_of, error_of_weights, first_variables, head_seeds
from seg.settings import TrainSettings
from seg.step import Data, Plan, Variables, functions, plan


def train_at_once(
    seeds: Sequence[int],
    sets: Sequence[Prepared],
    settings: TrainSettings,
    classes: int,
    progress: Callable[[int, float], None] | None = None,
    starts: Sequence[Variables] | None = None,
) -> tuple[Variables, list[str | None]]:
    """Train all heads of all networks at once.

    Args:
        seeds: one for each network.
        sets: what each network trains on.
        settings: of every training.
        classes: the networks' number of classes.
        progress: called every 50 steps with their number and the mean loss.
        starts: variables of the first network's heads, from which every network starts; None for fresh ones.

    Returns:
        Variables as those of `train`, stacked along a first axis; and for each network the error of its
        training, or None.
    """
    compiled = functions(settings, classes)
    seeds_of = [head_seeds(seed, settings.heads) for seed in seeds]
    data, positions = _shared_data(sets, seeds_of)
    data = jax.device_put(data)
    if starts is None:
        variables = _fresh(seeds_of, sets, data, settings, classes)
    else:
        heads = jax.tree.map(lambda *leaves: jnp.stack(leaves), *starts)
        variables = jax.tree.map(
            lambda leaf: jnp.broadcast_to(leaf, (len(sets), *leaf.shape)), heads
        )
    states = jax.vmap(jax.vmap(compiled.resume))(variables)
    rows = _plans(seeds_of, sets, positions, settings)
    losses: list[Array] = []
    for start, stop in pairwise([*range(0, settings.steps, CHUNK), settings.steps]):
        states, of_chunk = compiled.many(states, data, rows.rows(slice(start, stop)))
        losses.append(of_chunk[-1])
        if progress is not None:
            progress(stop, float(jnp.mean(of_chunk[-1])))
    trained = states.trained
    # Heads share their set's statistics; a single head has no axis.
    fixed = {name: tree for name, tree in trained.items() if name != "params"}
    one_head = fixed if settings.heads > 1 else trained
    without_axis = jax.tree.map(lambda leaf: leaf[:, 0], one_head)
    trained = {**trained, **without_axis}
    checked = np.stack([np.asarray(loss) for loss in losses], axis=-1)
    weights = jax.device_get(trained)
    return trained, [
        _first_error(of_network, settings)
        or error_of_weights(jax.tree.map(lambda leaf: leaf[k], weights), settings)  # noqa: B023
        for k, of_network in enumerate(checked)
    ]


def _first_error(
    losses: Float32[np.ndarray, "heads checks"], settings: TrainSettings
) -> str | None:
    """The error of the first head whose loss was not finite at a check."""
    steps = [*range(CHUNK, settings.steps, CHUNK), settings.steps]
    errors = (
        error_of(float(loss), step, settings)
        for of_head in losses
        for loss, step in zip(of_head, steps, strict=True)
    )
    return next(filter(None, errors), None)


def _plans(
    seeds: Sequence[Sequence[int]],
    sets: Sequence[Prepared],
    positions: Sequence[Int32[np.ndarray, " _count"]],
    settings: TrainSettings,
) -> Plan:
    """The plans of all heads, of axes steps, sets and heads; they share the schedule."""
    plans = [
        [plan(seed, prepared.counts, settings, prepared.share) for seed in of_set]
        for of_set, prepared in zip(seeds, sets, strict=True)
    ]
    batch_indices = [
        [where[p.batch_indices] for p in of_set]
        for of_set, where in zip(plans, positions, strict=True)
    ]
    draws = [[p.draws for p in of_set] for of_set in plans]
    by_step = (np.moveaxis(np.array(column), 2, 0) for column in (batch_indices, draws))
    return Plan(*by_step, plans[0][0].lr, plans[0][0].weight)  # type: ignore[call-arg]


def _shared_data(
    sets: Sequence[Prepared], seeds: Sequence[Sequence[int]]
) -> tuple[Data, list[Int32[np.ndarray, " _count"]]]:
    """The images of all sets in one padded array, and where in it those of each set are."""
    starts: dict[int, int] = {}
    parts = []
    total = 0
    for part in (part for prepared in sets for part in prepared.parts):
        if id(part) not in starts:
            starts[id(part)] = total
            parts.append(part)
            total += len(part.labels)

    def column(arrays: Sequence[np.ndarray]) -> np.ndarray:
        rows = np.zeros((padded(total), *arrays[0].shape[1:]), arrays[0].dtype)
        np.concatenate(arrays, out=rows[:total])
        return rows

    inputs = jax.tree.map(lambda *arrays: column(arrays), *(part.inputs for part in parts))
    labels = column([part.labels for part in parts])
    weights = np.stack([prepared.class_weights for prepared in sets])
    positions = [
        np.concatenate(
            [starts[id(part)] + np.arange(len(part.labels)) for part in prepared.parts]
        ).astype(np.int32)
        for prepared in sets
    ]
    return Data(inputs, labels, weights, np.array(seeds, np.uint32)), positions


def _fresh(
    seeds: Sequence[Sequence[int]],
    sets: Sequence[Prepared],
    data: Data,
    settings: TrainSettings,
    classes: int,
) -> Variables:
    """The variables before the first step, of axes sets and heads."""
    compiled = functions(settings, classes)
    blank = jax.tree.map(lambda leaf: jnp.zeros((1, *leaf.shape[1:]), leaf.dtype), data.images)

    def random(seed: Array) -> Any:
        return compiled.init(seed, blank).params

    params = jax.vmap(jax.vmap(random))(jnp.array(seeds, jnp.uint32))
    if not settings.has_backbone and settings.weights is None:
        return {"params": params}
    params = jax.device_get(params)

    def of_head(number: int, head: int) -> Variables:
        head_params = jax.tree.map(lambda leaf: leaf[number, head], params)
        return first_variables(head_params, settings, sets[number].statistics)

    def stack(trees: Iterable[Variables]) -> Variables:
        return jax.tree.map(lambda *leaves: np.stack(leaves), *trees)

    heads = range(settings.heads)
    return stack(stack(of_head(number, head) for head in heads) for number in range(len(sets)))
