"""Rewards: NaN where an evaluation failed, and what is done to them before a method learns."""

import jax.numpy as jnp
from jaxtyping import Array, Float

LARGEST = 1e15
"""Sums of the squares of larger rewards do not fit into single precision."""


def identity(rewards: Float[Array, "n"]) -> Float[Array, "n"]:
    """The reward itself, as in the paper."""
    return rewards


def squared_percent(rewards: Float[Array, "n"]) -> Float[Array, "n"]:
    """`sign(r) (100 r)^2`, as in the authors' code: differences between high rewards count for more.

    It is meant for mean IoU. It keeps the sign: otherwise the lower of two negative rewards would count as
    the higher one.
    """
    return jnp.sign(rewards) * (100 * rewards) ** 2


def only_finite(rewards: Float[Array, "n"]) -> Float[Array, "n"]:
    """The rewards, with NaN in place of infinite ones."""
    return jnp.where(jnp.isfinite(rewards), rewards, jnp.nan)


def mean_known(rewards: Float[Array, "n"]) -> Float[Array, ""]:
    """The mean of the rewards that are not NaN; NaN if there are none.

    If no reward is NaN, the result equals `rewards.mean()` to the bit; a division by a count would not.
    """
    return jnp.where(jnp.isnan(rewards).any(), jnp.nanmean(rewards), rewards.mean())
