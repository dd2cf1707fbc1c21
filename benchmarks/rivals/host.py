"""What adapters of other libraries share: the import, their history, and functions that can be jitted."""

import importlib
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Key

from sdr_jax.distributions import entropy
from sdr_jax.method import basic_info
from sdr_jax.relaxation import UNDECIDED, relax
from sdr_jax.rewards import nan_if_infinite
from sdr_jax.space import Proposal, Space, Width

info = jax.jit(lambda rewards, chances: basic_info(nan_if_infinite(rewards), entropy(chances)))
"""The info of an update, from rewards f32[n] and probabilities f32[attributes bins]."""


def needs(module: str, method: str, package: str | None = None) -> Any:
    """Import a module of another library; by default its package has the same name.

    Raises:
        ImportError: it is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:  # the module is installed, but lacks another one
            raise
        raise ModuleNotFoundError(
            f"{method} needs the package {package or module}: pip install {package or module}",
            name=module,
        ) from None


def seed(rng_key: Key[Array, ""]) -> int:
    """Make the 32-bit seed of a library; the key is consumed."""
    return int(_bits(rng_key))


def relaxation(space: Space, width: Width) -> Callable[[Array | np.ndarray], Proposal]:
    """Tabulate `relax` for a space and a width: the same numbers without dispatches to JAX.

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


class Evaluations(NamedTuple):
    """All evaluations so far; its size grows, so it cannot be jitted."""

    actions: np.ndarray  # i32[evaluations attributes]: bins
    rewards: np.ndarray  # f64[evaluations]: finite


def no_evaluations(space: Space) -> Evaluations:
    """The state before any evaluation."""
    return Evaluations(np.zeros((0, space.attributes), np.int32), np.zeros(0))


def with_new(
    evaluations: Evaluations, actions: Array | np.ndarray, rewards: Array | np.ndarray
) -> Evaluations:
    """Add n evaluations, i32[n attributes] and [n], except those without a finite reward."""
    rows, values = np.asarray(actions, np.int32), np.asarray(rewards, np.float64)
    finite = np.isfinite(values)
    return Evaluations(
        np.concatenate([evaluations.actions, rows[finite]]),
        np.concatenate([evaluations.rewards, values[finite]]),
    )


def best_quarter(prior: np.ndarray, actions: np.ndarray, values: np.ndarray) -> Array:
    """Compute the share of each bin, f32[attributes bins], among the best quarter of evaluations.

    Args:
        prior: f32[attributes bins], with the weight of one evaluation.
        actions: i32[evaluations attributes]: bins.
        values: f64[evaluations].
    """
    counts = prior.copy()
    order = np.argsort(-values, kind="stable")
    for index in order[: -(-len(order) // 4)]:
        counts[np.arange(len(counts)), actions[index]] += 1
    return jnp.asarray(counts / counts.sum(axis=1, keepdims=True))


@jax.jit
def _bits(rng_key: Key[Array, ""]) -> Array:
    return jax.random.bits(rng_key, (), jnp.uint32)
