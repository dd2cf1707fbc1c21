"""Bins as numbers: what methods with a distribution over the bins of each attribute share."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from sdr_jax.space import Proposal, Space, bin_widths, slide


def mask(space: Space) -> Bool[np.ndarray, "attributes bins"]:
    """Which bins each attribute has."""
    return np.arange(space.max_bins) < np.asarray(space.bins)[:, None]


def centres(space: Space) -> Float[np.ndarray, "attributes bins"]:
    """The middle of every bin, `(k + 0.5) / K`; beyond 1 for bins an attribute lacks."""
    bins = np.asarray(space.bins, np.float32)[:, None]
    return (np.arange(space.max_bins, dtype=np.float32) + np.float32(0.5)) / bins


def uniform(space: Space) -> Float[Array, "attributes bins"]:
    """Every attribute's uniform distribution over the bins it has."""
    return jnp.asarray(mask(space) / np.asarray(space.bins, np.float32)[:, None])


def entropy(probabilities: Float[Array, "attributes bins"]) -> Float[Array, ""]:
    """Entropy in nats, `-sum_i sum_k p_i(k) log p_i(k)`, summed over attributes."""
    return -jnp.sum(probabilities * jnp.log(jnp.where(probabilities > 0, probabilities, 1.0)))


def spread(
    space: Space,
    probabilities: Float[Array, "attributes bins"],
    width: float | tuple[float, ...] | None = None,
) -> Proposal:
    """The intervals with the moments of distributions over bins.

        centre = sum_k p_k c_k,   width = sqrt(12 sum_k p_k (c_k - centre)^2 + w^2)

    with c_k the bins' centres and w their (relaxed) width, slid into [0, 1]. Uniform distributions
    give all of [0, 1], certain ones their relaxed bin.

    Args:
        space: the attributes and their bins.
        probabilities: f32[attributes bins], rows sum to 1, zero for bins an attribute lacks.
        width: of the relaxed bins, see `relax`.

    Returns:
        The proposal, f32[attributes] each.
    """
    middle = jnp.asarray(centres(space))
    mean = jnp.sum(probabilities * middle, axis=1)
    variance = jnp.sum(probabilities * (middle - mean[:, None]) ** 2, axis=1)
    return slide(mean, jnp.sqrt(12 * variance + bin_widths(space, width) ** 2))
