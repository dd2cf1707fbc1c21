"""Any number of images through a compiled function, which wants one shape."""

from collections.abc import Callable

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Shaped, UInt8


def in_batches(
    run: Callable[[UInt8[np.ndarray, "b h w 3"]], ArrayLike],
    images: UInt8[np.ndarray, "n h w 3"],
    size: int,
) -> Shaped[np.ndarray, "n ..."]:
    """What `run` makes of each image, in batches of a fixed size; the last one is padded."""
    parts = []
    for start in range(0, len(images), size):
        batch = images[start : start + size]
        padding = [(0, size - len(batch)), (0, 0), (0, 0), (0, 0)]
        parts.append(np.asarray(run(np.pad(batch, padding))))
    return np.concatenate(parts)[: len(images)]
