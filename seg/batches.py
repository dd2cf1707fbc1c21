"""Runs a compiled function, which takes one shape, on any number of images."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jaxtyping import Shaped

BATCH, ACCELERATOR_BATCH = 8, 96
"""Images per call, on a CPU and on an accelerator, where an H200 computes the features of 96 images of
240x176 in 4 ms at once, and in 47 ms by batches of 8."""


def usual_batch(images: int) -> int:
    """The number of images per call that suits the backend, at most all."""
    return min(BATCH if jax.default_backend() == "cpu" else ACCELERATOR_BATCH, images)


def padded(count: int) -> int:
    """The least of 1, 2, 3, 4, 6, 8, 12, 16, 24 ... that is not below a count.

    Arrays of these lengths serve for all counts, so that few shapes are compiled.
    """
    power = 1 << max(count - 1, 0).bit_length()
    return 3 * power // 4 if power > 2 and count <= 3 * power // 4 else power


def in_batches(
    run: Callable[[Shaped[np.ndarray, "b ..."]], Any],
    images: Shaped[np.ndarray, "n ..."],
    size: int,
) -> Any:
    """Apply `run` to each image (or its index) in batches of a fixed size; zeros fill the last batch.

    The result is an array, or a tree of arrays; of no images it is None.
    """
    results: Any = None
    for start in range(0, len(images), size):
        batch = images[start : start + size]
        padding = [(0, size - len(batch)), *[(0, 0)] * (batch.ndim - 1)]
        part = jax.tree.map(np.asarray, run(np.pad(batch, padding)))
        if results is None:
            results = jax.tree.map(lambda a: np.empty((len(images), *a.shape[1:]), a.dtype), part)
        for target, values in zip(*map(jax.tree.leaves, (results, part)), strict=True):
            target[start : start + len(batch)] = values[: len(batch)]
    return results
