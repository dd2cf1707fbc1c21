"""Rewards, which are NaN where an evaluation failed, and their transforms before a method learns."""

import jax.numpy as jnp
from jaxtyping import Array, Float

LARGEST = 1e15
"""The largest reward; sums of squares of larger ones do not fit into single precision."""


def identity(rewards: Float[Array, "n"]) -> Float[Array, "n"]:
    """The reward itself, as in the paper."""
    return rewards


def squared_percent(rewards: Float[Array, "n"]) -> Float[Array, "n"]:
    """`sign(r) (100 r)^2`, as in the authors' code: differences between high rewards count for more.

    It is meant for mean IoU. Without the sign, the lower of two negative rewards would count as the
    higher one.
    """
    return jnp.sign(rewards) * (100 * rewards) ** 2


def only_finite(rewards: Float[Array, "n"]) -> Float[Array, "n"]:
    """The rewards, with NaN in place of infinite ones."""
    return jnp.where(jnp.isfinite(rewards), rewards, jnp.nan)


def mean_known(rewards: Float[Array, "n"]) -> Float[Array, ""]:
    """The mean of the rewards that are not NaN; NaN if all are.

    If no reward is NaN, the result equals `rewards.mean()` to the bit, unlike a division by a count.
    """
    return jnp.where(jnp.isnan(rewards).any(), jnp.nanmean(rewards), rewards.mean())
