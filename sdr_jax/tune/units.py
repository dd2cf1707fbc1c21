"""Attributes in the simulator's units, and the content of the file from which it reads them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sdr_jax.space import Proposal


@dataclass(frozen=True)
class Attribute:
    """One attribute as the user describes it.

    Attributes:
        name: its name in the simulator.
        bins: its number of bins, >= 2.
        low: its value at unit value 0, in the simulator's units.
        high: its value at unit value 1.
        log: whether equal steps in [0, 1] are equal factors instead of equal differences.
        values: names of unordered values, one per bin; low, high and log then have no meaning.
    """

    name: str
    bins: int = 10
    low: float = 0.0
    high: float = 1.0
    log: bool = False
    values: tuple[str, ...] = ()


def physical(attribute: Attribute, unit: float) -> float:
    """Convert a value in [0, 1] to the simulator's units.

        low + unit (high - low),   or  low (high / low)^unit  with `log`

    Args:
        attribute: the attribute, for its range and scale.
        unit: the value in [0, 1].

    Returns:
        The value, rounded to ten digits and in [low, high].
    """
    if attribute.log:
        low, high = math.log(attribute.low), math.log(attribute.high)
        value = math.exp((1 - unit) * low + unit * high)
    else:
        value = (1 - unit) * attribute.low + unit * attribute.high
    return min(max(float(f"{value:.10g}"), attribute.low), attribute.high)


def describe(attributes: Sequence[Attribute], proposal: Proposal) -> dict[str, dict[str, Any]]:
    """Describe a proposal by name in both units, as in `attributes.json` and `answer.json`.

    Args:
        attributes: the attributes in the order of the space.
        proposal: f32[attributes] each.

    Returns:
        For every name `unit` (`centre` and `width`, in [0, 1]) and, in the simulator's units, `centre`,
        `low` and `high` of the interval to draw from. For values without an order `unit` and `values`,
        the names to draw from.
    """
    described: dict[str, dict[str, Any]] = {}
    for attribute, centre, width in zip(
        attributes, np.asarray(proposal.centre), np.asarray(proposal.width), strict=True
    ):
        # Digits beyond single precision would only make the file harder to read.
        middle, length = round(float(centre), 7), round(float(width), 7)
        unit = {"centre": middle, "width": length}
        if attribute.values:
            values = _values_inside(attribute.values, middle, length)
            described[attribute.name] = {"unit": unit, "values": values}
            continue
        described[attribute.name] = {
            "unit": unit,
            "centre": physical(attribute, middle),
            "low": physical(attribute, max(middle - length / 2, 0.0)),
            "high": physical(attribute, min(middle + length / 2, 1.0)),
        }
    return described


def _values_inside(values: Sequence[str], centre: float, width: float) -> list[str]:
    """List the values whose bins have their centre in an interval."""
    centres = (np.arange(len(values)) + 0.5) / len(values)
    inside = np.abs(centres - centre) <= max(width, 1 / len(values)) / 2 + 1e-6
    return [value for value, is_inside in zip(values, inside, strict=True) if is_inside]
