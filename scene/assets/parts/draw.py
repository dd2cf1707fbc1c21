"""Rules that draw the fields of an asset's parameters, starting from the values of its kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from itertools import repeat
from typing import Any, NamedTuple, TypeVar

import numpy as np

from scene.assets.parts.palette import pick
from scene.mesh.asset import Color

Params = TypeVar("Params", bound=NamedTuple)

Rule = Callable[[np.random.Generator, Any], Any]
"""Draws a field from a generator and the kind's value of it."""


def between(low: float, high: float) -> Rule:
    """Draw a number between two, whatever the kind's value."""
    return lambda rng, value: float(rng.uniform(low, high))


def integer(low: int, high: int) -> Rule:
    """Draw an integer from ``low`` to below ``high``."""
    return lambda rng, value: int(rng.integers(low, high))


def times(low: float, high: float) -> Rule:
    """Multiply the kind's number, or each of its numbers, by one factor between two."""

    def draw(rng: np.random.Generator, value: Any) -> Any:
        factor = rng.uniform(low, high)
        return tuple(factor * x for x in value) if isinstance(value, tuple) else factor * value

    return draw


def plus(low: int, high: int) -> Rule:
    """Add an integer from ``low`` to below ``high`` to the kind's."""
    return lambda rng, value: value + int(rng.integers(low, high))


def near(spread: float, *colors: Color) -> Rule:
    """Draw a colour near one of ``colors``, or near the kind's if none are named; see ``vary``."""
    return lambda rng, value: pick(rng, colors or (value,), spread)


def one_of(*options: Any) -> Rule:
    """Draw one of several values or rules, each as likely."""
    return lambda rng, value: resolve(rng, options[rng.integers(len(options))], value)


def perhaps(chance: float, rule: Any, otherwise: Any = None) -> Rule:
    """Use ``rule`` (a rule or a value) with probability ``chance``, else ``otherwise``."""
    return lambda rng, value: resolve(rng, rule if rng.random() < chance else otherwise, value)


def maybe(chance: float) -> Rule:
    """Draw True with probability ``chance``."""
    return perhaps(chance, rule=True, otherwise=False)


def keep(rng: np.random.Generator, value: Any) -> Any:
    """Keep the kind's value."""
    return value


class SameAs(NamedTuple):
    """Stands for a rule: the value drawn for another field."""

    field: str


SEED = integer(0, 2**31)
"""Seed of what is drawn while the asset is built."""


def sample_fields(rng: np.random.Generator, kind: Params, **rules: Any) -> Params:
    """Draw some fields of a kind's parameters, in the order of ``rules``.

    Args:
        rng: generator, advanced.
        kind: parameters of the kind; fields without a rule stay.
        **rules: for each field a rule, a value, a tuple of these for a field that is a tuple, or
            ``SameAs`` another field.
    """
    fields = {name: resolve(rng, rule, getattr(kind, name)) for name, rule in rules.items()}
    copies = {name: fields[v.field] for name, v in fields.items() if isinstance(v, SameAs)}
    return kind._replace(**{**fields, **copies})


def resolve(rng: np.random.Generator, rule: Any, value: Any = None) -> Any:
    """Return what a rule draws, or ``rule`` itself if it is a value; ``value`` is the kind's."""
    if callable(rule):
        return rule(rng, value)
    if type(rule) is tuple:
        matches = isinstance(value, tuple) and len(value) == len(rule)
        return tuple(map(partial(resolve, rng), rule, value if matches else repeat(value)))
    return rule


def sampler(
    kinds: Mapping[str, Params], **rules: Any
) -> Callable[[np.random.Generator, str], Params]:
    """Return the ``sample`` of a family whose table of kinds holds parameters; see ``sample_fields``."""

    def sample(rng: np.random.Generator, kind: str) -> Params:
        return sample_fields(rng, kinds[kind], **rules)

    return sample
