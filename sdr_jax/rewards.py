"""Rewards: NaN where an evaluation failed, and what is done to them before a method learns."""

import jax.numpy as jnp
from jaxtyping import Array, Float

LARGEST = 1e15
"""Sums of the squares of larger rewards do not fit into single precision."""


def identity(rewards: Float[Array, "n"]) -> Float[Array, "n"]:
    """The score itself, as in the paper."""
    return rewards


def squared_percent(rewards: Float[Array, "n"]) -> Float[Array, "n"]:
    """`sign(r) (100 r)^2`, as in the authors' code: differences between good scores count for more.

    For mean IoU. The sign is kept, or of two negative rewards the worse would count as the better.
    """
    return jnp.sign(rewards) * (100 * rewards) ** 2


def only_finite(rewards: Float[Array, "n"]) -> Float[Array, "n"]:
    """NaN for whatever is not finite: an infinite reward is no reward either."""
    return jnp.where(jnp.isfinite(rewards), rewards, jnp.nan)


def mean_known(rewards: Float[Array, "n"]) -> Float[Array, ""]:
    """The mean of those that are not NaN; NaN if there is none.

    With nothing left out it is `rewards.mean()` to the bit, which a division by a count is not.
    """
    return jnp.where(jnp.isnan(rewards).any(), jnp.nanmean(rewards), rewards.mean())
