"""Dropout at a quarter of the random numbers."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray


def dropout(
    rng_key: PRNGKeyArray, x: Float[Array, "*shape"], rate: float
) -> Float[Array, "*shape"]:
    """Leave out a random share of the values, and scale the others so that the mean stays.

    The same as `nn.Dropout`, but a byte decides on a value where it takes a word of four: the random numbers
    are most of dropout's time on a CPU.

    Args:
        rng_key: of the choice.
        x: values.
        rate: the share, in [0, 1); rounded to a multiple of 1/256, at most 255/256.
    """
    left_out = min(round(256 * rate), 255)
    words = jax.random.bits(rng_key, (-(-x.size // 4),), jnp.uint32)
    numbers = jax.lax.bitcast_convert_type(words, jnp.uint8).reshape(-1)[: x.size]
    return jnp.where(numbers.reshape(x.shape) < left_out, 0, x * (256 / (256 - left_out)))
