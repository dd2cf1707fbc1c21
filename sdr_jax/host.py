"""What host adapters share: the jitted parts of a method that itself is not to be jitted."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Key

from sdr_jax import bins
from sdr_jax.method import plain_info
from sdr_jax.space import Proposal, Space, check_relaxation, relax

info = jax.jit(lambda rewards, probabilities: plain_info(rewards, bins.entropy(probabilities)))
"""The info of an update, f32[n] rewards and f32[attributes bins] probabilities given."""


def seed(rng_key: Key[Array, ""]) -> int:
    """A library's seed, of 32 bits; the key is consumed."""
    return int(_bits(rng_key))


def relaxation(
    space: Space, width: float | tuple[float, ...] | None
) -> Callable[[Array | np.ndarray], Proposal]:
    """`relax`, jitted for a space and a width.

    Raises:
        ValueError: a width outside [0, 1].
    """
    check_relaxation(space, width, "random")
    return jax.jit(partial(relax, space, width=width))


@jax.jit
def _bits(rng_key: Key[Array, ""]) -> Array:
    return jax.random.bits(rng_key, (), jnp.uint32)
