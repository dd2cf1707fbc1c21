"""How the parameters of an asset are drawn: those of its kind, some fields replaced by rules like these."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np

from scene.assets.parts.palette import pick
from scene.mesh.asset import Color

Params = TypeVar("Params", bound=NamedTuple)


class Between(NamedTuple):
    """A number between two, each as likely."""

    low: float
    high: float

    def draw(self, rng: np.random.Generator, value: Any) -> float:
        """The number, whatever the kind's ``value``."""
        return float(rng.uniform(self.low, self.high))


class Times(NamedTuple):
    """The kind's number, or its numbers, times one between two."""

    low: float
    high: float

    def draw(self, rng: np.random.Generator, value: Any) -> Any:
        """The product with ``value``."""
        factor = rng.uniform(self.low, self.high)
        if isinstance(value, tuple):
            return tuple(float(one * factor) for one in value)
        return float(value * factor)


class Near:
    """A colour near one of ``colors``, or near the kind's where there are none; see ``vary``."""

    def __init__(self, spread: float, *colors: Color) -> None:
        self.spread, self.colors = spread, colors

    def draw(self, rng: np.random.Generator, value: Any) -> Color:
        """The colour; ``value`` is the kind's."""
        return pick(rng, self.colors or (value,), self.spread)


class Whole(NamedTuple):
    """A whole number from ``low`` to below ``high``."""

    low: int
    high: int

    def draw(self, rng: np.random.Generator, value: Any) -> int:
        """The number, whatever the kind's ``value``."""
        return int(rng.integers(self.low, self.high))


class OneOf:
    """One of several values or rules, each as likely."""

    def __init__(self, *options: Any) -> None:
        self.options = options

    def draw(self, rng: np.random.Generator, value: Any) -> Any:
        """The option, whatever the kind's ``value``."""
        return _resolved(rng, self.options[rng.integers(len(self.options))], value)


SEED = Whole(0, 2**31)
"""Of what is drawn while the asset is built."""


def drawn(rng: np.random.Generator, kind: Params, **rules: Any) -> Params:
    """The parameters of a kind with some fields drawn, in the order of ``rules``.

    Args:
        rng: draws them.
        kind: the parameters before.
        **rules: by field, a rule, the value itself, or a tuple of them.
    """
    fields = {name: _resolved(rng, rule, getattr(kind, name)) for name, rule in rules.items()}
    return kind._replace(**fields)


def _resolved(rng: np.random.Generator, rule: Any, value: Any) -> Any:
    if hasattr(rule, "draw"):
        return rule.draw(rng, value)
    if type(rule) is tuple:
        return tuple(_resolved(rng, one, value) for one in rule)
    return rule


def sampler(
    kinds: Mapping[str, Params], **rules: Any
) -> Callable[[np.random.Generator, str], Params]:
    """The ``sample`` of a family whose table of kinds holds parameters; see ``drawn``."""

    def sample(rng: np.random.Generator, kind: str) -> Params:
        return drawn(rng, kinds[kind], **rules)

    return sample
