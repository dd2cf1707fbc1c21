"""Any number of images through a compiled function, which wants one shape."""

from collections.abc import Callable

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Shaped


def in_batches(
    run: Callable[[Shaped[np.ndarray, "b ..."]], ArrayLike],
    images: Shaped[np.ndarray, "n ..."],
    size: int,
) -> Shaped[np.ndarray, "n ..."]:
    """What `run` makes of each image (or number of one), in batches of a fixed size; zeros fill the last."""
    parts = []
    for start in range(0, len(images), size):
        batch = images[start : start + size]
        padding = [(0, size - len(batch)), *[(0, 0)] * (batch.ndim - 1)]
        parts.append(np.asarray(run(np.pad(batch, padding))))
    return np.concatenate(parts)[: len(images)]
