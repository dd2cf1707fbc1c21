"""Bounds of values, which are annotations on the fields of dataclasses, and their check.

@dataclass(frozen=True)
class Settings:
    steps: Annotated[int, at_least(1)] = 200

check_bounds(Settings(steps=0))  # UserError: steps must be 1 or more, not 0
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import lru_cache
from typing import Any, NamedTuple, get_args, get_type_hints

from shell.errors import UserError, refuse_repeats


class Bound(NamedTuple):
    """A condition on the value of a field."""

    refuse: Callable[[str, Any], None]  # raises UserError for (name, value); not called with None


def check_bounds(value: Any, prefix: str = "") -> None:
    """Raise UserError for the first field of a dataclass that is out of bounds.

    Fields that are dataclasses are checked as well. None is within all bounds.

    Args:
        value: the dataclass.
        prefix: prefix of names in the message; ``--`` makes them flags: ``--reward.train.head-width``.
    """
    kind: Any = type(value)  # mypy takes no type for hashable
    for name, bounds in _bounds(kind):
        own = vars(value)[name]
        word = prefix + (name.replace("_", "-") if prefix.startswith("--") else name)
        if is_dataclass(own):
            check_bounds(own, f"{word}.")
        elif own is not None:
            for bound in bounds:
                bound.refuse(word, own)


@lru_cache
def _bounds(kind: type) -> tuple[tuple[str, tuple[Bound, ...]], ...]:
    """The fields of a dataclass with their bounds."""
    hints = get_type_hints(kind, include_extras=True)
    return tuple(
        (field.name, tuple(m for m in get_args(hints[field.name]) if isinstance(m, Bound)))
        for field in fields(kind)
    )


def must(be: str, holds: Callable[[Any], bool]) -> Bound:
    """A bound of a number, or of each number of a tuple.

    Args:
        be: the condition in words, such as "be positive".
        holds: whether a number meets it.
    """

    def refuse(name: str, value: Any) -> None:
        for number in value if isinstance(value, tuple) else (value,):
            if not holds(number):
                raise UserError(f"{name} must {be}, not {number}")

    return Bound(refuse)


def at_least(least: float) -> Bound:
    """Allow finite numbers that are not smaller."""
    return must(f"be {least} or more", lambda number: least <= number < math.inf)


def at_most(most: float) -> Bound:
    """Allow numbers that are not larger."""
    return must(f"be {most} or less", lambda number: number <= most)


def within(low: float, high: float, ends: str = "[]") -> Bound:
    """Allow numbers of an interval; a square bracket in ``ends`` includes that end."""

    def holds(number: float) -> bool:
        above = low <= number if ends[0] == "[" else low < number
        return above and (number <= high if ends[1] == "]" else number < high)

    return must(f"lie in {ends[0]}{low}, {high}{ends[1]}", holds)


POSITIVE = must("be positive", lambda number: 0 < number < math.inf)
"""Finite numbers above 0."""


def _refuse_few(name: str, values: tuple[Any, ...]) -> None:
    if not values:
        raise UserError(f"{name} needs at least one value")
    refuse_repeats(name, values)


DISTINCT = Bound(_refuse_few)
"""Allows tuples of one value or more, without a value twice."""
