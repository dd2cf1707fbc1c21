"""Bounds of values, written as annotations on the fields of dataclasses, and their check.

@dataclass(frozen=True)
class Settings:
    steps: Annotated[int, at_least(1)] = 200

check_bounds(Settings(steps=0))  # UserError: steps must be 1 or more, not 0
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import lru_cache
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

from common.errors import UserError, refuse_repeats


class Bound(NamedTuple):
    """A condition on the value of a field."""

    refuse: Callable[[str, Any], None]  # raises UserError for (name, value); not called with None


def check_bounds(value: Any, prefix: str = "") -> None:
    """Raise UserError for the first field of a dataclass that is of the wrong type or out of bounds.

    Nested dataclasses are checked as well. None is within all bounds.

    Args:
        value: the dataclass.
        prefix: prefix of names in the message; ``--`` turns them into flags: ``--reward.train.head-width``.
    """
    check_fields(type(value), vars(value), prefix)


def check_fields(kind: Any, values: Mapping[str, Any], prefix: str = "") -> None:
    """Raise UserError as `check_bounds` for values of some of a dataclass's fields, by name."""
    for name, annotation, bounds in _annotated(kind):
        if name not in values:
            continue
        value = values[name]
        word = prefix + (name.replace("_", "-") if prefix.startswith("--") else name)
        if is_dataclass(value):
            check_bounds(value, f"{word}.")
            continue
        if not _fits(value, annotation):
            shown = value if get_origin(annotation) is Literal else repr(value)
            raise UserError(f"{word} must be {_in_words(annotation)}, not {shown}")
        if value is not None:
            for bound in bounds:
                bound.refuse(word, value)


@lru_cache
def _annotated(kind: type) -> tuple[tuple[str, Any, tuple[Bound, ...]], ...]:
    """The fields of a dataclass with their types and bounds."""
    hints = get_type_hints(kind, include_extras=True)
    bare = get_type_hints(kind)
    return tuple(
        (
            field.name,
            bare[field.name],
            tuple(m for m in get_args(hints[field.name]) if isinstance(m, Bound)),
        )
        for field in fields(kind)
    )


_TYPES: dict[Any, tuple[type, str]] = {
    bool: (bool, "True or False"),
    int: (Integral, "a whole number"),
    float: (Real, "a number"),
    str: (str, "text"),
    NoneType: (NoneType, "None"),
}
"""The checked types, and their names; NumPy's numbers count as numbers, but True does not."""


def _fits(value: Any, annotation: Any) -> bool:
    """Whether a value fits one of `_TYPES`, or a union or tuple of them; other types are not checked."""
    kind, parts = get_origin(annotation), get_args(annotation)
    if kind is Annotated:
        return _fits(value, parts[0])
    if kind is Literal:
        return any(type(value) is type(part) and value == part for part in parts)
    if kind in (Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if kind is tuple:
        if not isinstance(value, tuple):
            return False
        if parts[-1] is ...:
            return all(_fits(part, parts[0]) for part in value)
        return len(value) == len(parts) and all(map(_fits, value, parts))
    if annotation not in _TYPES:
        return True
    return isinstance(value, _TYPES[annotation][0]) and (
        annotation is bool or not isinstance(value, bool)
    )


def _in_words(annotation: Any) -> str:
    """Describe a type in words."""
    kind, parts = get_origin(annotation), get_args(annotation)
    if kind is Literal:
        return f"one of {', '.join(map(str, parts))}"
    if kind in (Union, UnionType):
        return " or ".join(map(_in_words, parts))
    if kind is tuple:
        return f"a tuple, each {_in_words(parts[0])}"
    return _TYPES[annotation][1] if annotation in _TYPES else getattr(annotation, "__name__", "set")


def must(be: str, holds: Callable[[Any], bool]) -> Bound:
    """Make a bound for a number, or for each number of a tuple.

    Args:
        be: the condition in words, such as "be positive".
        holds: tells whether a number meets it.
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


def _refuse_empty_or_repeated(name: str, values: tuple[Any, ...]) -> None:
    if not values:
        raise UserError(f"{name} needs at least one value")
    refuse_repeats(name, values)


DISTINCT = Bound(_refuse_empty_or_repeated)
"""Allows tuples of one or more values that all differ."""
