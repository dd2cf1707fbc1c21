"""The table of search methods by name, with plain values as options; all command lines read it."""

import inspect
from collections.abc import Callable
from typing import Any

import optax

from sdr_jax.baseline import ema, leave_one_out
from sdr_jax.method import Method
from sdr_jax.models.intervals import intervals
from sdr_jax.models.surrogate import surrogate
from sdr_jax.rewards import identity, squared_percent
from sdr_jax.rivals.attribute_descent import attribute_descent
from sdr_jax.rivals.gaussian import gaussian
from sdr_jax.rivals.random_attributes import random_attributes
from sdr_jax.rivals.random_search import random_search
from sdr_jax.sdr import sdr
from sdr_jax.space import Space, Width

BASELINES = {
    "ema": ema(),
    "ema_current": ema(includes_current=True),
    "leave_one_out": leave_one_out(),
}
"""The paper's baseline, that of the authors' code, and the mean of the update's other rewards."""


def _sdr(
    space: Space,
    width: Width = None,
    *,
    updates_per_group: int = 50,
    hidden: int = 256,
    learning_rate: float = 0.01,
    baseline: str = "ema",
    normalise: bool = False,
    squared_reward: bool = False,
    unoptimised: str = "random",
) -> Method:
    if baseline not in BASELINES:
        raise ValueError(f"baseline is {baseline!r}, but must be one of {', '.join(BASELINES)}")
    return sdr(
        space,
        optax.adam(learning_rate),
        updates_per_group=updates_per_group,
        hidden=hidden,
        baseline=BASELINES[baseline],
        transform=squared_percent if squared_reward else identity,
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


def _random_attributes(space: Space, width: Width = None) -> Method:
    del width  # nothing is ever decided
    return random_attributes(space)


METHODS: dict[str, Callable[..., Method]] = {
    "surrogate": surrogate,
    "sdr": _sdr,
    "random_attributes": _random_attributes,
    "random_search": random_search,
    "attribute_descent": attribute_descent,
    "gaussian": _gaussian,
    "intervals": intervals,
}
"""What makes each method, by name: of a space and a width; its keywords are the options."""


def options_of(name: str) -> dict[str, Any]:
    """The options of a method with their defaults, None where it chooses by itself.

    Raises:
        ValueError: an unknown name.
    """
    parameters = inspect.signature(_entry(name)).parameters.values()
    return {p.name: p.default for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY}


def make(name: str, space: Space, width: Width = None, **options: Any) -> Method:
    """Makes a method.

    Args:
        name: one of `METHODS`.
        space: the attributes.
        width: width of the relaxed bins, see `relax`.
        options: among those of `options_of`.

    Returns:
        The method.

    Raises:
        ValueError: an unknown name, or an option that is unknown or out of range.
    """
    known = options_of(name)
    unknown = [option for option in options if option not in known]
    if unknown:
        some = ", ".join(known) or "none"
        raise ValueError(f"{name} has no option {unknown[0]!r}; known: {some}")
    return _entry(name)(space, width, **options)


def _entry(name: str) -> Callable[..., Method]:
    if name not in METHODS:
        raise ValueError(f"unknown method {name!r}; known are {', '.join(METHODS)}")
    return METHODS[name]
