"""The bins of a space as tables; rows are padded to the most bins of any attribute."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key

from sdr_jax.space import Space


def ordered(space: Space) -> Bool[np.ndarray, "attributes"]:
    """The mask of attributes whose bins have an order."""
    return ~np.isin(np.arange(space.attributes), space.unordered)


def bin_mask(space: Space) -> Bool[np.ndarray, "attributes bins"]:
    """The mask of the bins that each attribute has."""
    return np.arange(space.max_bins) < np.asarray(space.bins)[:, None]


def bin_centres(space: Space) -> Float[np.ndarray, "attributes bins"]:
    """The centre of every bin, `(k + 0.5) / K`; beyond 1 for bins an attribute lacks."""
    bins = np.asarray(space.bins, np.float32)[:, None]
    return (np.arange(space.max_bins, dtype=np.float32) + np.float32(0.5)) / bins


def random_bins(rng_key: Key[Array, ""], space: Space, n: int) -> Int[Array, "n attributes"]:
    """Sample the bins of all attributes uniformly, n times; the key is consumed."""
    shape = (n, space.attributes)
    sizes = jnp.broadcast_to(jnp.asarray(space.bins, jnp.int32), shape)
    return jax.random.randint(rng_key, shape, 0, sizes, jnp.int32)
