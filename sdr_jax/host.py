"""What host adapters share: the jitted parts of a method that itself is not to be jitted."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Key

from sdr_jax import bins
from sdr_jax.method import plain_info
from sdr_jax.space import UNDECIDED, Proposal, Space, relax

info = jax.jit(lambda rewards, probabilities: plain_info(rewards, bins.entropy(probabilities)))
"""The info of an update, f32[n] rewards and f32[attributes bins] probabilities given."""


def seed(rng_key: Key[Array, ""]) -> int:
    """A library's seed, of 32 bits; the key is consumed."""
    return int(_bits(rng_key))


def relaxation(
    space: Space, width: float | tuple[float, ...] | None
) -> Callable[[Array | np.ndarray], Proposal]:
    """`relax` for a space and a width, looked up: the same numbers without its dispatches.

    Raises:
        ValueError: a width outside [0, 1].
    """
    choices = np.arange(UNDECIDED, space.max_bins, dtype=np.int32)
    table = relax(space, np.repeat(choices[:, None], space.attributes, axis=1), width)
    centres, widths = (np.asarray(part) for part in table)
    columns = np.arange(space.attributes)

    def relaxed(actions: Array | np.ndarray) -> Proposal:
        rows = np.asarray(actions) - UNDECIDED
        return Proposal(jnp.asarray(centres[rows, columns]), jnp.asarray(widths[rows, columns]))

    return relaxed


@jax.jit
def _bits(rng_key: Key[Array, ""]) -> Array:
    return jax.random.bits(rng_key, (), jnp.uint32)
