"""The table of search methods by name, which all command lines read."""

import inspect
from collections.abc import Callable
from typing import Any

from sdr_jax.method import Method
from sdr_jax.models.intervals import intervals
from sdr_jax.models.surrogate import surrogate
from sdr_jax.rivals.attribute_descent import attribute_descent
from sdr_jax.rivals.gaussian import gaussian
from sdr_jax.rivals.random_attributes import random_attributes
from sdr_jax.rivals.random_search import random_search
from sdr_jax.sdr import sdr
from sdr_jax.space import Space, Width

METHODS: dict[str, Callable[..., Method]] = {
    function.__name__: function
    for function in (
        surrogate,
        sdr,
        random_attributes,
        random_search,
        attribute_descent,
        gaussian,
        intervals,
    )
}
"""Every method by name: a function of a space, a width and options, the last two by keyword."""


def options_of(name: str) -> dict[str, Any]:
    """List the options of a method with their defaults, None where the method chooses.

    Raises:
        ValueError: an unknown name.
    """
    parameters = inspect.signature(_entry(name)).parameters.values()
    return {p.name: p.default for p in parameters if p.name not in ("space", "width")}


def make(name: str, space: Space, width: Width = None, **options: Any) -> Method:
    """Make a method.

    Args:
        name: one of `METHODS`.
        space: the attributes.
        width: width of the relaxed bins, see `relax`.
        options: those of `options_of`.

    Returns:
        The method.

    Raises:
        ValueError: an unknown name, or an option that is unknown or out of range.
    """
    defaults = options_of(name)
    unknown = [option for option in options if option not in defaults]
    if unknown:
        choices = ", ".join(defaults) or "none"
        raise ValueError(f"{name} has no option {unknown[0]!r}; its options: {choices}")
    return _entry(name)(space, width=width, **options)


def _entry(name: str) -> Callable[..., Method]:
    if name not in METHODS:
        raise ValueError(f"unknown method {name!r}; choose from {', '.join(METHODS)}")
    return METHODS[name]
