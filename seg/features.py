"""Describes an image by one vector: averages of a trained compact network's penultimate features."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Float32, UInt8

from seg.batches import in_batches
from seg.nets import Compact, variables_of
from seg.nets.compact import PENULTIMATE

GRID = 2
"""Cells along each side of the coarse grid, which keeps some of the layout."""
BATCH = 16
"""Images per call of the network."""


def penultimate(
    params: Any, images: Float[Array, "b h w 3"], classes: int
) -> Float[Array, "b rows cols features"]:
    """The input of the compact network's last layer; no feature is below 0."""
    _, state = Compact(classes).apply(params, images, mutable=["intermediates"])
    return state["intermediates"][PENULTIMATE][0]


def pool(maps: Float[Array, "b rows cols features"]) -> Float[Array, "b vector"]:
    """Average over the whole map, then over each cell of the coarse grid, row by row."""
    _, rows, cols, _ = maps.shape
    parts = [maps.mean(axis=(1, 2))]
    for i in range(GRID):
        for j in range(GRID):
            r = slice(i * rows // GRID, (i + 1) * rows // GRID)
            c = slice(j * cols // GRID, (j + 1) * cols // GRID)
            parts.append(maps[:, r, c].mean(axis=(1, 2)))
    return jnp.concatenate(parts, axis=1)


@lru_cache(maxsize=8)
def _extractor(classes: int) -> Callable[[Any, ArrayLike], Array]:
    @jax.jit
    def extract(params: Any, images: UInt8[Array, "b h w 3"]) -> Float[Array, "b vector"]:
        return pool(penultimate(params, images.astype(jnp.float32) / 255, classes))

    return extract


def features(
    params: Any, images: UInt8[np.ndarray, "n h w 3"], classes: int
) -> Float32[np.ndarray, "n vector"]:
    """Describe images.

    Args:
        params: a trained compact network, from `seg.train` or from a file of any version.
        images: RGB, at least 16x16.
        classes: the network's number of classes.

    Returns:
        One vector per image.
    """
    extract, variables = _extractor(classes), variables_of(params)
    return in_batches(lambda batch: extract(variables, batch), images, BATCH)
