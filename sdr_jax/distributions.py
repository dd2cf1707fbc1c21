"""Distributions over bins: the uniform one, their entropy, and the intervals with their moments."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sdr_jax.bins import bin_centres, bin_mask, ordered
from sdr_jax.relaxation import bin_widths, slide
from sdr_jax.space import Proposal, Space, Width


def uniform(space: Space) -> Float[Array, "attributes bins"]:
    """The uniform distribution of every attribute over the bins it has."""
    return jnp.asarray(bin_mask(space) / np.asarray(space.bins, np.float32)[:, None])


def entropy(probabilities: Float[Array, "attributes bins"]) -> Float[Array, ""]:
    """Compute the entropy in nats, `-sum_i sum_k p_i(k) log p_i(k)`, summed over attributes."""
    return -jnp.sum(probabilities * jnp.log(jnp.where(probabilities > 0, probabilities, 1.0)))


def moments(
    space: Space, probabilities: Float[Array, "attributes bins"], width: Width = None
) -> Proposal:
    """Make the intervals that have the moments of distributions over bins.

        centre = sum_k p_k c_k,   width = sqrt(12 sum_k p_k (c_k - centre)^2 + w^2)

    with c_k the bins' centres and w their (relaxed) width, slid into [0, 1]. With the default width, uniform
    distributions give all of [0, 1], certain ones their bin. Bins without an order have no moments: the
    interval is the likeliest bin if it is likelier than all others together, otherwise all of [0, 1].

    Args:
        space: the attributes and their bins.
        probabilities: f32[attributes bins], rows sum to 1, zero for bins an attribute lacks.
        width: width of the relaxed bins, see `relax`.

    Returns:
        The proposal, f32[attributes] each.
    """
    centres = jnp.asarray(bin_centres(space))
    mean = jnp.sum(probabilities * centres, axis=1)
    variance = jnp.sum(probabilities * (centres - mean[:, None]) ** 2, axis=1)
    widths = bin_widths(space, width)
    certain = jnp.max(probabilities, axis=1) > 0.5
    most_likely = jnp.argmax(probabilities, axis=1)[:, None]
    mode = jnp.take_along_axis(centres, most_likely, axis=1)[:, 0]
    in_order = ordered(space)
    return slide(
        jnp.where(in_order, mean, jnp.where(certain, mode, 0.5)),
        jnp.where(in_order, jnp.sqrt(12 * variance + widths**2), jnp.where(certain, widths, 1.0)),
    )
