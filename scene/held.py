"""Attributes fixed at given values in physical units: ``--fix field_of_view=90``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import overload

import numpy as np

from common.errors import UserError
from scene.attributes import BY_NAME, SpaceName, names, unit_value
from scene.proposal import Component, Histogram, Proposal, Streets, components, mixture


def read_fixed(words: Iterable[str], space: SpaceName) -> dict[str, float]:
    """Read the unit values of the attributes that ``--fix`` fixes, by name, in the order of the space.

    Args:
        words: values of the flag, such as ``field_of_view=90``, in the units of the table of attributes.
        space: the space of the streets.

    Raises:
        UserError: a value is not a number or out of range, or an attribute is unknown, not in the space, or
            named twice; the message starts with the flag.
    """
    fixed: dict[str, float] = {}
    for word in words:
        name, _, text = word.partition("=")
        try:
            unit = unit_value(name, text, space)
        except UserError as error:
            raise UserError(f"--fix {word}: {error}") from None
        if name in fixed:
            raise UserError(f"--fix {word}: {name} is already fixed")
        fixed[name] = float(np.float32(unit))
    return {name: fixed[name] for name in names(space) if name in fixed}


@overload
def hold(streets: Proposal, fixed: Mapping[str, float]) -> Proposal: ...
@overload
def hold(streets: Streets, fixed: Mapping[str, float]) -> Streets: ...
def hold(streets: Streets, fixed: Mapping[str, float]) -> Streets:
    """Fix attributes of streets at unit values ``fixed``, by name; the others do not change.

    Proposals may have more axes before that of attributes.
    """
    if not fixed:
        return streets
    parts = components(streets)
    return mixture(
        [share for share, _ in parts], [_held(component, fixed) for _, component in parts]
    )


def _held(component: Component, fixed: Mapping[str, float]) -> Component:
    where = [list(BY_NAME).index(name) for name in fixed]
    if isinstance(component, Histogram):
        values = dict(component.held) | dict(zip(where, fixed.values(), strict=True))
        return component._replace(held=tuple(sorted(values.items())))
    centre, width = (np.array(part, np.float32) for part in component)
    centre[..., where], width[..., where] = [*fixed.values()], 0.0
    return component._replace(centre=centre, width=width)


def in_words(fixed: Mapping[str, float]) -> str:
    """The fixed attributes in physical units: ``field_of_view 90 deg, ...``, or an empty string."""
    values = ((BY_NAME[name], value) for name, value in fixed.items())
    return ", ".join(f"{a.name} {a.physical(value):.4g} {a.unit}" for a, value in values)
