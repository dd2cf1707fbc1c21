"""Attributes held at known values, in physical units: ``--fix field_of_view=90``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import overload

import numpy as np

from common.errors import UserError
from scene.attributes import BY_NAME, SpaceName, names, unit_value
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
    fixed: dict[str, float] = {}
    for word in words:
        name, _, text = word.partition("=")
        try:
            unit = unit_value(name, text, space)
        except UserError as error:
            raise UserError(f"--fix {word}: {error}") from None
        if name in fixed:
            raise UserError(f"--fix {word}: {name} is held already")
        fixed[name] = float(np.float32(unit))
    return {name: fixed[name] for name in names(space) if name in fixed}


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
