"""Relaxation: it turns bins, and distributions over bins, into intervals."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key

from sdr_jax.space import Proposal, Space, Width

UNDECIDED = -1
"""The action of an attribute that is not decided yet."""

UNOPTIMISED = ("random", "half")
"""An undecided attribute is drawn from all of [0, 1], or is 0.5."""


def slide(
    centre: Float[Array | np.ndarray, "*batch attributes"],
    width: Float[Array | np.ndarray, "*batch attributes"],
) -> Proposal:
    """Makes a proposal, and moves intervals that stick out of [0, 1] back inside at full width.

    Clipping the drawn values instead would pile them up at the borders.
    """
    width = jnp.clip(width, 0.0, 1.0)
    return Proposal(jnp.clip(centre, width / 2, 1 - width / 2), width)


def snap(space: Space, proposal: Proposal) -> Proposal:
    """Moves attributes without an order to the value in which their centre lies; others stay."""
    shape = proposal.centre.shape
    bins = jnp.broadcast_to(jnp.asarray(space.bins, jnp.float32), shape)
    in_order = jnp.broadcast_to(ordered(space), shape)
    value = (jnp.clip(jnp.floor(proposal.centre * bins), 0, bins - 1) + 0.5) / bins
    return Proposal(
        jnp.where(in_order, proposal.centre, value), jnp.where(in_order, proposal.width, 1 / bins)
    )


def check_relaxation(space: Space, width: Width, unoptimised: str) -> None:
    """Raises ValueError if `relax` cannot work with these options."""
    if unoptimised not in UNOPTIMISED:
        raise ValueError(f"unoptimised is {unoptimised!r}, but must be one of {UNOPTIMISED}")
    if width is None:
        return
    widths = np.asarray(width, np.float64)
    if widths.shape not in ((), (space.attributes,)):
        raise ValueError(f"{widths.size} widths for {space.attributes} attributes")
    if not np.all((widths >= 0) & (widths <= 1)):
        raise ValueError(f"width is {width}, but must lie in [0, 1]")


def bin_widths(space: Space, width: Width) -> Float[Array, "attributes"]:
    """The width of each attribute's relaxed bin: `width`, or 1 / K by default and for unordered values."""
    default = 1 / np.asarray(space.bins, np.float32)
    widths = default if width is None else np.asarray(width, np.float32)
    return jnp.asarray(np.where(ordered(space), np.broadcast_to(widths, default.shape), default))


def relax(
    space: Space,
    actions: Int[Array | np.ndarray, "*batch attributes"],
    width: Width = None,
    unoptimised: str = "random",
) -> Proposal:
    """Turns bins into intervals: `centre = (k + 0.5) / K`, `width = 1 / K`.

    With these defaults the bins tile [0, 1]; bins without an order always do. The paper publishes
    neither the shape nor the width of the variance it injects; the uniform over the bin is our choice.

    Args:
        space: the attribute space.
        actions: bins, int[*batch attributes], each in [0, K), or -1 where nothing is decided.
        width: another width, for all attributes or one for each, in [0, 1]. Wider intervals slide
            back inside at the borders; 0 means no relaxation.
        unoptimised: the meaning of -1: "random" (the paper: centre 0.5, width 1) or "half" (the
            authors' code: 0.5, relaxed like any decided value).

    Returns:
        The proposal, f32[*batch attributes] each.

    Raises:
        ValueError: a width outside [0, 1] or another meaning of -1.

    Source: section "Scalable Discretization-and-Relaxation".
    """
    check_relaxation(space, width, unoptimised)
    bins = jnp.broadcast_to(jnp.asarray(space.bins, jnp.float32), actions.shape)
    widths = jnp.broadcast_to(bin_widths(space, width), actions.shape)
    decided = actions >= 0
    centre = jnp.where(decided, (actions.astype(jnp.float32) + 0.5) / bins, 0.5)
    if unoptimised == "random":
        widths = jnp.where(decided, widths, 1.0)
    return slide(centre, widths)


def ordered(space: Space) -> Bool[np.ndarray, "attributes"]:
    """The mask of attributes whose bins have an order."""
    return ~np.isin(np.arange(space.attributes), space.unordered)


def bin_mask(space: Space) -> Bool[np.ndarray, "attributes bins"]:
    """The mask of the bins that each attribute has."""
    return np.arange(space.max_bins) < np.asarray(space.bins)[:, None]


def bin_centres(space: Space) -> Float[np.ndarray, "attributes bins"]:
    """The middle of every bin, `(k + 0.5) / K`; beyond 1 for bins an attribute lacks."""
    bins = np.asarray(space.bins, np.float32)[:, None]
    return (np.arange(space.max_bins, dtype=np.float32) + np.float32(0.5)) / bins


def random_bins(rng_key: Key[Array, ""], space: Space, n: int) -> Int[Array, "n attributes"]:
    """Uniform bins of all attributes, n times; the key is consumed."""
    shape = (n, space.attributes)
    sizes = jnp.broadcast_to(jnp.asarray(space.bins, jnp.int32), shape)
    return jax.random.randint(rng_key, shape, 0, sizes, jnp.int32)


def uniform(space: Space) -> Float[Array, "attributes bins"]:
    """Every attribute's uniform distribution over the bins it has."""
    return jnp.asarray(bin_mask(space) / np.asarray(space.bins, np.float32)[:, None])


def shares_of_bins(space: Space, proposals: Proposal) -> Float[Array, "attributes bins"]:
    """The share of each bin in streets of n proposals f32[n attributes]; rows add up to 1."""
    bins = jnp.asarray(space.bins, jnp.float32)[:, None]
    edges = jnp.arange(space.max_bins + 1)[None, :] / bins
    width = jnp.maximum(proposals.width, 1e-4)[..., None]
    below = (edges[None] - proposals.centre[..., None]) / width + 0.5
    filled = jnp.diff(jnp.clip(below, 0.0, 1.0), axis=-1).mean(axis=0)
    filled = jnp.where(jnp.arange(space.max_bins)[None, :] < bins, filled, 0.0)
    return filled / filled.sum(axis=1, keepdims=True)


def entropy(probabilities: Float[Array, "attributes bins"]) -> Float[Array, ""]:
    """Entropy in nats, `-sum_i sum_k p_i(k) log p_i(k)`, summed over attributes."""
    return -jnp.sum(probabilities * jnp.log(jnp.where(probabilities > 0, probabilities, 1.0)))


def moments(
    space: Space,
    probabilities: Float[Array, "attributes bins"],
    width: Width = None,
) -> Proposal:
    """Makes the intervals that have the moments of distributions over bins.

        centre = sum_k p_k c_k,   width = sqrt(12 sum_k p_k (c_k - centre)^2 + w^2)

    with c_k the bins' centres and w their (relaxed) width, slid into [0, 1]. Uniform distributions
    give all of [0, 1], certain ones their relaxed bin. Bins without an order have no moments: the interval
    is the likeliest bin if it is likelier than all others together, otherwise all of [0, 1].

    Args:
        space: the attributes and their bins.
        probabilities: f32[attributes bins], rows sum to 1, zero for bins an attribute lacks.
        width: width of the relaxed bins, see `relax`.

    Returns:
        The proposal, f32[attributes] each.
    """
    middle = jnp.asarray(bin_centres(space))
    mean = jnp.sum(probabilities * middle, axis=1)
    variance = jnp.sum(probabilities * (middle - mean[:, None]) ** 2, axis=1)
    widths = bin_widths(space, width)
    wide = jnp.sqrt(12 * variance + widths**2)
    certain = jnp.max(probabilities, axis=1) > 0.5
    likeliest = jnp.take_along_axis(middle, jnp.argmax(probabilities, axis=1)[:, None], axis=1)[
        :, 0
    ]
    in_order = ordered(space)
    return slide(
        jnp.where(in_order, mean, jnp.where(certain, likeliest, 0.5)),
        jnp.where(in_order, wide, jnp.where(certain, widths, 1.0)),
    )
