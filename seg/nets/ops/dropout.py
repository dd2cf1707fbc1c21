"""Dropout with a quarter of the random bits."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray


def dropout(
    rng_key: PRNGKeyArray, x: Float[Array, "*shape"], rate: float
) -> Float[Array, "*shape"]:
    """Set a random share of the values to 0, and scale the others so that the mean stays.

    In distribution it is `nn.Dropout` with the rate rounded to 1/256, but takes one random byte per value
    instead of four: random numbers take most of dropout's time on a CPU.

    Args:
        rng_key: key of the choice.
        x: values.
        rate: the share, in [0, 1); rounded to a multiple of 1/256, at most 255/256.
    """
    left_out = min(round(256 * rate), 255)
    words = jax.random.bits(rng_key, (-(-x.size // 4),), jnp.uint32)
    numbers = jax.lax.bitcast_convert_type(words, jnp.uint8).reshape(-1)[: x.size]
    return jnp.where(numbers.reshape(x.shape) < left_out, 0, x * (256 / (256 - left_out)))
