"""Attributes held at known values, in physical units: ``--fix field_of_view=90``."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import overload

import numpy as np

from common.errors import UserError
from scene.attributes import BY_NAME, SpaceName, names
from scene.proposal import Component, Histogram, Proposal, Streets, components, mixture


def read_fixed(words: Iterable[str], space: SpaceName) -> dict[str, float]:
    """Read the unit values of the attributes that ``--fix`` holds, by name, in the order of the space.

    Args:
        words: words such as ``field_of_view=90``, in the units of the table of attributes.
        space: the space of the streets.

    Raises:
        UserError: a value is no number or out of range, or an attribute is unknown, of another space, or
            named twice; the message begins with the flag.
    """
    found: dict[str, float] = {}
    for word in words:
        name, _, text = word.partition("=")
        _refuse_unknown(word, name, space)
        if name in found:
            raise UserError(f"--fix {word}: {name} is held already")
        attribute = BY_NAME[name]
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not attribute.low <= value <= attribute.high:
            raise UserError(
                f"--fix {word}: {name} must be a number from {attribute.low:g} to {attribute.high:g} "
                f"({attribute.unit})"
            )
        found[name] = float(np.float32(attribute.to_unit(value)))
    return {name: found[name] for name in names(space) if name in found}


def _refuse_unknown(word: str, name: str, space: SpaceName) -> None:
    if name in names(space):
        return
    if name in BY_NAME:
        raise UserError(
            f"--fix {word}: streets of --space {space} do not have {name}; --space extended does"
        )
    raise UserError(f"--fix {word}: {no_attribute(name, space)}")


def no_attribute(name: str, space: SpaceName) -> str:
    """What an error says of a name that no attribute has."""
    near = get_close_matches(name, BY_NAME, 1)
    known = f"did you mean {near[0]}?" if near else f"known: {', '.join(names(space))}"
    return f"there is no attribute {name!r}; {known}"


@overload
def hold(streets: Proposal, held: Mapping[str, float]) -> Proposal: ...
@overload
def hold(streets: Streets, held: Mapping[str, float]) -> Streets: ...
def hold(streets: Streets, held: Mapping[str, float]) -> Streets:
    """Set the attributes ``held`` (unit values by name) of streets; the others stay as they are.

    Proposals may have more axes before that of attributes.
    """
    if not held:
        return streets
    parts = components(streets)
    return mixture([share for share, _ in parts], [_held(own, held) for _, own in parts])


def _held(own: Component, held: Mapping[str, float]) -> Component:
    where = [list(BY_NAME).index(name) for name in held]
    if isinstance(own, Histogram):
        kept = dict(own.held) | dict(zip(where, held.values(), strict=True))
        return own._replace(held=tuple(sorted(kept.items())))
    centre, width = (np.array(part, np.float32) for part in own)
    centre[..., where], width[..., where] = [*held.values()], 0.0
    return own._replace(centre=centre, width=width)


def in_words(held: Mapping[str, float]) -> str:
    """The held attributes in physical units: ``field_of_view 90 deg, ...``; empty without any."""
    values = ((BY_NAME[name], value) for name, value in held.items())
    return ", ".join(f"{a.name} {a.physical(value):.4g} {a.unit}" for a, value in values)
