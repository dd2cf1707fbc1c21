"""Search methods by name, with options that are plain values."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import optax

from sdr_jax.actor_critic import actor_critic
from sdr_jax.attribute_descent import attribute_descent
from sdr_jax.baseline import ema, leave_one_out
from sdr_jax.cma_es import cma_es
from sdr_jax.gaussian import gaussian
from sdr_jax.linear import linear
from sdr_jax.method import Method
from sdr_jax.pbil import pbil
from sdr_jax.random_search import random_search
from sdr_jax.sdr import sdr
from sdr_jax.space import Space
from sdr_jax.tpe import tpe
from sdr_jax.tune.errors import TuneError

DEFAULT_METHOD = "actor_critic"

BASELINES = {"ema": ema, "leave_one_out": leave_one_out}

Width = float | tuple[float, ...] | None


def _sdr(
    space: Space,
    width: Width = None,
    *,
    updates_per_group: int = 50,
    hidden: int = 256,
    learning_rate: float = 0.01,
    baseline: str = "ema",
    normalise: bool = False,
    unoptimised: str = "random",
) -> Method:
    if baseline not in BASELINES:
        raise ValueError(f"baseline is {baseline!r}, but must be one of {', '.join(BASELINES)}")
    return sdr(
        space,
        optax.adam(learning_rate),
        updates_per_group=updates_per_group,
        hidden=hidden,
        baseline=BASELINES[baseline](),
        normalise=normalise,
        width=width,
        unoptimised=unoptimised,
    )


def _gaussian(
    space: Space,
    width: Width = None,
    *,
    learning_rate: float = 0.1,
    normalise: bool = True,
    std: float = 1.5,
) -> Method:
    return gaussian(space, optax.adam(learning_rate), normalise=normalise, std=std, width=width)


METHODS: dict[str, Callable[..., Method]] = {
    "actor_critic": actor_critic,
    "attribute_descent": attribute_descent,
    "cma_es": cma_es,
    "gaussian": _gaussian,
    "linear": linear,
    "pbil": pbil,
    "random_search": random_search,
    "sdr": _sdr,
    "tpe": tpe,
}
"""Each takes the space, the width of the relaxed bins, and its options as keywords."""


def options_of(name: str) -> dict[str, Any]:
    """The options of a method with their defaults.

    Args:
        name: one of `METHODS`.

    Returns:
        Default by name; None where the method chooses by itself.
    """
    parameters = inspect.signature(METHODS[name]).parameters.values()
    return {p.name: p.default for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY}


def make(name: str, space: Space, width: Width, n: int, options: dict[str, Any]) -> Method:
    """Builds a method, and has it learn once, so that no option fails after hours of simulation.

    Args:
        name: one of `METHODS`.
        space: the attributes.
        width: of the relaxed bins, see `relax`.
        n: data sets per update.
        options: among those of `options_of`.

    Returns:
        The method.

    Raises:
        TuneError: an option that the method refuses, or a library that it needs and is not there.
    """
    try:
        method = METHODS[name](space, width, **options)
        state = method.init(jax.random.key(0))
        actions, _ = method.sample(jax.random.key(0), state, n)
        method.update(state, actions, jnp.zeros(n))
    except (ImportError, TypeError, ValueError) as error:
        raise TuneError(f"method {name}: {error}") from None
    return method
