"""Which streets a dataset is made from: an interval of [0, 1] per attribute, and what is drawn from it.

The same idea as the search's proposals, in NumPy and drawn street by street, so that any street of a
dataset can be made again without those before it. What ``describe`` writes, ``parse_proposal`` reads, and
``draw`` makes the same streets of.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from scene.attributes import SPACES, SpaceName, check_unit, default_unit, names, space_of

RELAXATION = 0.15
"""Width of the intervals around the street set by eye, as a share of each range."""
BELOW_ONE = float(np.nextafter(np.float32(1), np.float32(0)))
UNITS_STREAM = 1
"""Third word of the seed, apart from the streams that the streets themselves draw from."""


class Proposal(NamedTuple):
    """A distribution over streets: each attribute uniform on an interval of [0, 1]."""

    centre: np.ndarray  # f32[attributes], the middle of the interval
    width: np.ndarray  # f32[attributes], its length


def slide(centre: np.ndarray, width: np.ndarray | float) -> Proposal:
    """A proposal whose intervals, where they stick out of [0, 1], are moved inside at full width.

    What was slid once stays as it is.
    """
    centre = np.asarray(centre, np.float32)
    width = np.clip(np.broadcast_to(np.asarray(width, np.float32), centre.shape), 0, 1)
    return Proposal(np.clip(centre, width / 2, 1 - width / 2), width)


def random_proposal(space: SpaceName = "scenex") -> Proposal:
    """Every attribute of a space anywhere in its range."""
    return slide(np.full(len(SPACES[space]), 0.5), 1.0)


def default_proposal(width: float = RELAXATION, space: SpaceName = "scenex") -> Proposal:
    """Intervals of one ``width`` around the street set by eye; what it adds to the 23 stands there exactly.

    So both spaces have the same streets by eye, but for chance.
    """
    centre = default_unit(space)
    widths = np.full(len(centre), width)
    widths[len(SPACES["scenex"]) :] = 0.0
    return slide(centre, widths)


def named(name: str, space: SpaceName) -> Proposal:
    """The proposal ``random`` or, around the street set by eye, ``default``."""
    return random_proposal(space) if name == "random" else default_proposal(space=space)


def describe(proposal: Proposal) -> dict[str, dict[str, Any]]:
    """A proposal as ``attributes.json`` holds it: every attribute in unit and physical values."""
    rows = {}
    attributes = SPACES[space_of(len(proposal.centre))]
    centres, widths = (np.asarray(part, np.float32).tolist() for part in proposal)
    for attribute, centre, width in zip(attributes, centres, widths, strict=True):
        low, high = max(centre - width / 2, 0.0), min(centre + width / 2, 1.0)
        rows[attribute.name] = {
            "unit": {"centre": shortest(centre), "width": shortest(width)},
            "physical": {
                "centre": round(attribute.physical(centre), 4),
                "low": round(attribute.physical(low), 4),
                "high": round(attribute.physical(high), 4),
                "unit": attribute.unit,
            },
            "meaning": attribute.meaning,
        }
    return rows


def shortest(value: float) -> float:
    """The shortest number that is read back as the same float32."""
    exact = np.float32(value)
    short = float(str(exact))
    return short if np.float32(short) == exact else float(exact)


def parse_proposal(value: Any) -> Proposal:
    """The proposal in a file: every attribute of a space by name, with a unit value or an interval.

    A number is the value of all streets. An interval is ``{"centre": c, "width": w}``, or that below
    ``"unit"``, as in the ``attributes.json`` of a run.

    Raises:
        ValueError: not an object, an unknown or missing attribute, or a value outside [0, 1], by name.
    """
    if not isinstance(value, dict):
        raise ValueError("expected a JSON object of attribute names and unit values")
    known = names("extended")
    for name in value:
        if name not in known:
            raise ValueError(f"unknown attribute {name!r}; known: {', '.join(known)}")
    wanted = names("scenex") if set(value) <= set(names("scenex")) else known
    for name in wanted:
        if name not in value:
            raise ValueError(f"attribute {name} is missing; all {len(wanted)} must be given")
    rows = [_interval(name, value[name]) for name in wanted]
    centre, width = np.array(rows, np.float32).T
    return slide(check_unit(centre), width)


def _interval(name: str, entry: Any) -> tuple[float, float]:
    """Centre and width of one attribute, both in [0, 1]."""
    if isinstance(entry, dict):
        unit = entry.get("unit", entry)
        if not isinstance(unit, dict) or "centre" not in unit:
            raise ValueError(f"attribute {name}: expected a number, or centre and width")
        found = (unit["centre"], unit.get("width", 0.0))
    else:
        found = (entry, 0.0)
    for number in found:
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise ValueError(f"attribute {name} is {number!r}; unit values are numbers in [0, 1]")
        if not 0 <= number <= 1:
            raise ValueError(f"attribute {name} is {number}; unit values must lie in [0, 1]")
    return float(found[0]), float(found[1])


def draw(proposal: Proposal, seed: int, streets: int) -> np.ndarray:
    """Attributes f32[streets, attributes] in [0, 1); street ``k`` depends on (proposal, seed, k) only."""
    centre, width = slide(*proposal)
    units = np.empty((streets, len(centre)), np.float32)
    low = centre - width / 2
    for street in range(streets):
        rng = np.random.default_rng([seed, street, UNITS_STREAM])
        units[street] = low + width * rng.random(len(centre), dtype=np.float32)
    return np.clip(units, 0.0, BELOW_ONE)  # rounding could reach 1
