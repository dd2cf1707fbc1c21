"""Relaxation: it turns bins into intervals, so that streets of one data set differ."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sdr_jax.bins import ordered
from sdr_jax.space import Proposal, Space, Width

UNDECIDED = -1
"""The action of an attribute whose bin is not decided yet: theta in the paper, not theta'."""

UNOPTIMISED = ("random", "half")
"""An undecided attribute is drawn from all of [0, 1], or is 0.5."""


def relax(
    space: Space,
    actions: Int[Array | np.ndarray, "*batch attributes"],
    width: Width = None,
    unoptimised: str = "random",
) -> Proposal:
    """Turn bins into intervals: `centre = (k + 0.5) / K`, `width = 1 / K`.

    With these defaults the bins tile [0, 1]; bins without an order always do. The paper publishes
    neither the shape nor the width of the variance it injects; the uniform over the bin is our choice.

    Args:
        space: the attributes; K is the number of bins of each.
        actions: bins k, int[*batch attributes], each in [0, K), or -1 where nothing is decided.
        width: another width, for all attributes or one for each, in [0, 1]. Wider intervals slide
            back inside at the borders; 0 means no relaxation.
        unoptimised: the meaning of -1: "random" (the paper: centre 0.5, width 1) or "half" (the
            authors' code: 0.5, relaxed like any decided value; without an order, the bin in the middle).

    Returns:
        The proposal, f32[*batch attributes] each.

    Raises:
        ValueError: a width outside [0, 1] or another meaning of -1.

    Source: section "Scalable Discretization-and-Relaxation", "a relaxation process is added".
    """
    check_relaxation(space, width, unoptimised)
    bins = jnp.broadcast_to(jnp.asarray(space.bins, jnp.float32), actions.shape)
    widths = jnp.broadcast_to(bin_widths(space, width), actions.shape)
    decided = actions >= 0
    middle = jnp.where(jnp.asarray(ordered(space)), 0.5, (jnp.floor(bins / 2) + 0.5) / bins)
    centre = jnp.where(decided, (actions.astype(jnp.float32) + 0.5) / bins, middle)
    if unoptimised == "random":
        centre, widths = jnp.where(decided, centre, 0.5), jnp.where(decided, widths, 1.0)
    return slide(centre, widths)


def slide(
    centre: Float[Array | np.ndarray, "*batch attributes"],
    width: Float[Array | np.ndarray, "*batch attributes"],
) -> Proposal:
    """Make a proposal, and move intervals that stick out of [0, 1] back inside at full width.

    Clipping the drawn values instead would pile them up at the borders.
    """
    width = jnp.clip(width, 0.0, 1.0)
    return Proposal(jnp.clip(centre, width / 2, 1 - width / 2), width)


def bin_widths(space: Space, width: Width) -> Float[Array, "attributes"]:
    """The widths of relaxed bins: `width`, but 1 / K by default and for bins without an order."""
    default = 1 / np.asarray(space.bins, np.float32)
    widths = default if width is None else np.asarray(width, np.float32)
    return jnp.asarray(np.where(ordered(space), np.broadcast_to(widths, default.shape), default))


def check_relaxation(space: Space, width: Width, unoptimised: str = "random") -> None:
    """Raise ValueError if `relax` cannot work with these options."""
    if unoptimised not in UNOPTIMISED:
        raise ValueError(f"unoptimised is {unoptimised!r}, but must be one of {UNOPTIMISED}")
    if width is None:
        return
    widths = np.asarray(width, np.float64)
    if widths.shape not in ((), (space.attributes,)):
        raise ValueError(f"{widths.size} widths for {space.attributes} attributes")
    if not np.all((widths >= 0) & (widths <= 1)):
        raise ValueError(f"width is {width}, but must lie in [0, 1]")
