"""Rewards: NaN where an evaluation failed, and the authors' transform of them."""

import jax.numpy as jnp
from jaxtyping import Array, Float

LARGEST = 1e15
"""The largest reward; sums of squares of larger ones do not fit into single precision."""


def squared_percent(rewards: Float[Array, "n"]) -> Float[Array, "n"]:
    """Compute `sign(r) (100 r)^2`, as in the authors' code: differences between high rewards count for more.

    It is meant for mean IoU. Without the sign, the lower of two negative rewards would count as the
    higher one. Squares are at most `LARGEST`.
    """
    percent = jnp.clip(100 * rewards, -(LARGEST**0.5), LARGEST**0.5)
    return jnp.sign(rewards) * percent**2


def nan_if_infinite(rewards: Float[Array, "n"]) -> Float[Array, "n"]:
    """Put NaN in place of infinite rewards."""
    return jnp.where(jnp.isfinite(rewards), rewards, jnp.nan)


def mean_without_nan(rewards: Float[Array, "n"]) -> Float[Array, ""]:
    """Compute the mean of the rewards that are not NaN; NaN if all are.

    If no reward is NaN, the result equals `rewards.mean()` to the bit, unlike a division by a count.
    """
    return jnp.where(jnp.isnan(rewards).any(), jnp.nanmean(rewards), rewards.mean())
