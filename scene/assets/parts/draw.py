"""How the parameters of an asset are drawn: those of its kind, some fields replaced by rules like these."""

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
"""Draws a field, given the kind's value of it."""


def between(low: float, high: float) -> Rule:
    """A number between two, whatever the kind's is."""
    return lambda rng, value: float(rng.uniform(low, high))


def integer(low: int, high: int) -> Rule:
    """A whole number from ``low`` to below ``high``."""
    return lambda rng, value: int(rng.integers(low, high))


def times(low: float, high: float) -> Rule:
    """The kind's number, or each of its numbers, times one between two."""

    def draw(rng: np.random.Generator, value: Any) -> Any:
        factor = rng.uniform(low, high)
        return tuple(factor * x for x in value) if isinstance(value, tuple) else factor * value

    return draw


def plus(low: int, high: int) -> Rule:
    """The kind's whole number plus one from ``low`` to below ``high``."""
    return lambda rng, value: value + int(rng.integers(low, high))


def near(spread: float, *colors: Color) -> Rule:
    """A colour near one of ``colors``, or near the kind's where there are none; see ``vary``."""
    return lambda rng, value: pick(rng, colors or (value,), spread)


def one_of(*options: Any) -> Rule:
    """One of several values or rules, each as likely."""
    return lambda rng, value: resolve(rng, options[rng.integers(len(options))], value)


def perhaps(chance: float, rule: Any, otherwise: Any = None) -> Rule:
    """With a probability of ``chance`` one value or rule, else the other."""
    return lambda rng, value: resolve(rng, rule if rng.random() < chance else otherwise, value)


def maybe(chance: float) -> Rule:
    """True with a probability of ``chance``."""
    return perhaps(chance, rule=True, otherwise=False)


def keep(rng: np.random.Generator, value: Any) -> Any:
    """The kind's value."""
    return value


class SameAs(NamedTuple):
    """In the place of a rule: the value that another field gets."""

    field: str


SEED = integer(0, 2**31)
"""Of what is drawn while the asset is built."""


def sample_fields(rng: np.random.Generator, kind: Params, **rules: Any) -> Params:
    """The parameters of a kind with some fields drawn, in the order of ``rules``.

    Args:
        rng: draws them.
        kind: the parameters before.
        **rules: by field, a rule, the value itself, a tuple of them for the numbers of
            a tuple, or ``Like`` another field.
    """
    fields = {name: resolve(rng, rule, getattr(kind, name)) for name, rule in rules.items()}
    likes = {name: fields[v.field] for name, v in fields.items() if isinstance(v, SameAs)}
    return kind._replace(**{**fields, **likes})


def resolve(rng: np.random.Generator, rule: Any, value: Any = None) -> Any:
    """What a rule draws, or the value itself that stands in its place; ``value`` is the kind's."""
    if callable(rule):
        return rule(rng, value)
    if type(rule) is tuple:
        same = isinstance(value, tuple) and len(value) == len(rule)
        return tuple(map(partial(resolve, rng), rule, value if same else repeat(value)))
    return rule


def sampler(
    kinds: Mapping[str, Params], **rules: Any
) -> Callable[[np.random.Generator, str], Params]:
    """The ``sample`` of a family whose table of kinds holds parameters; see ``drawn``."""

    def sample(rng: np.random.Generator, kind: str) -> Params:
        return sample_fields(rng, kinds[kind], **rules)

    return sample
