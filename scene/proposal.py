"""The streets of a dataset: a distribution over [0, 1] per attribute, and draws from it.

The same idea as the search's proposals, but in NumPy and drawn street by street, so that any street of a
dataset can be rendered without those before it. An attribute is uniform on an interval (`Proposal`) or on
each of several bins (`Histogram`); a mixture takes its streets from several of them. ``parse_streets`` reads
what ``describe`` writes, and ``draw`` draws the same streets from it.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from common.errors import UserError, hint, suggestion
from common.files import read_json
from scene import streams
from scene.attributes import (
    BY_NAME,
    LATER,
    SPACES,
    SpaceName,
    check_unit,
    default_unit,
    names,
    space_of,
)

log = logging.getLogger(__name__)
RELAXATION = 0.15
"""Width of the intervals around the default street, as a share of each range."""
NAMES = ("default", "random", "mixed")
"""Names of streets for `streets_named`."""
BELOW_ONE = float(np.nextafter(np.float32(1), np.float32(0)))
ROUNDING = 1e-5
"""An interval in a file may exceed [0, 1] by this much, since its ends are rounded."""
NORMED = 1e-4
"""The sum of an attribute's probabilities in a file may differ from 1 by this much."""
NO_ATTRIBUTES = "expected a JSON object of attribute names and unit values"
GOLDEN = (math.sqrt(5) - 1) / 2
"""The golden ratio minus one, whose multiples fill [0, 1) evenly."""


class Proposal(NamedTuple):
    """A distribution over streets: each attribute is uniform on an interval of [0, 1]."""

    centre: np.ndarray  # f32[attributes], the middle of the interval
    width: np.ndarray  # f32[attributes], its length


class Histogram(NamedTuple):
    """A distribution over streets: each attribute is uniform in one of K equal bins of [0, 1].

    It is the paper's policy over discretised attributes; all attributes have the same number of bins.
    """

    probabilities: np.ndarray  # f32[attributes bins], 2 bins or more; rows add up to 1
    held: tuple[tuple[int, float], ...] = ()
    """Index and unit value of attributes that are fixed in all streets, whatever their bins are."""


Component = Proposal | Histogram
"""A distribution with independent attributes."""


class Mixture(NamedTuple):
    """Several components of one space, each with its share of the streets; made by `mixture`."""

    shares: tuple[float, ...]  # above 0, with sum 1
    proposals: tuple[Component, ...]  # no two of them equal


Streets = Component | Mixture
"""The distribution of a dataset's streets."""


def mixture(shares: Sequence[float], proposals: Sequence[Component]) -> Streets:
    """Mix several components; equal ones are merged, and a single one is returned as it is.

    Args:
        shares: shares of the streets, above 0, with sum 1 within a millionth.
        proposals: the components, one for each share.

    Raises:
        ValueError: shares are out of range, or proposals have different spaces.
    """
    shares = [float(share) for share in shares]
    if not shares or len(shares) != len(proposals):
        raise ValueError(f"a mixture needs one share for each of its components, not {len(shares)}")
    if any(not 0 < share <= 1 for share in shares) or abs(math.fsum(shares) - 1) > 1e-6:
        raise ValueError(
            f"shares must be above 0 and add up to 1, not {' + '.join(f'{s:g}' for s in shares)}"
        )
    if len({len(proposal[0]) for proposal in proposals}) > 1:
        raise ValueError("components have different spaces")
    merged: dict[tuple[Any, ...], tuple[float, Component]] = {}
    for share, proposal in zip(shares, proposals, strict=True):
        key = type(proposal), *(np.asarray(part, np.float32).tobytes() for part in proposal)
        merged[key] = merged.get(key, (0.0, proposal))[0] + share, proposal
    merged_shares, merged_components = zip(*merged.values(), strict=True)
    return (
        merged_components[0]
        if len(merged_components) == 1
        else Mixture(merged_shares, merged_components)
    )


def components(streets: Streets) -> tuple[tuple[float, Component], ...]:
    """Shares and components; streets that are not a mixture are their only component."""
    if isinstance(streets, Mixture):
        return tuple(zip(*streets, strict=True))
    return ((1.0, streets),)


def space_in(streets: Streets) -> SpaceName:
    """The space of the attributes."""
    return space_of(len(components(streets)[0][1][0]))


def slide(centre: np.ndarray, width: np.ndarray | float) -> Proposal:
    """Make a proposal, and move intervals that exceed [0, 1] inside at full width.

    It is idempotent.
    """
    centre = np.asarray(centre, np.float32)
    width = np.clip(np.broadcast_to(np.asarray(width, np.float32), centre.shape), 0, 1)
    return Proposal(np.clip(centre, width / 2, 1 - width / 2), width)


def moments(component: Component) -> Proposal:
    """The intervals with the mean and variance of each attribute; for a proposal, its own.

        centre = sum_k p_k c_k,   width = sqrt(12 sum_k p_k (c_k - centre)^2 + 1 / K^2)

    with c_k the centres of the bins, slid into [0, 1]: uniform attributes give all of [0, 1], certain ones
    their bin, fixed ones their value.
    """
    if isinstance(component, Proposal):
        return slide(*component)
    shares = np.diff(_ends(component), axis=1)
    bins = shares.shape[1]
    middle = (np.arange(bins) + 0.5) / bins
    mean = shares @ middle
    variance = (shares * (middle - mean[:, None]) ** 2).sum(axis=1)
    width = np.sqrt(12 * variance + bins**-2.0).astype(np.float32)
    for where, value in component.held:
        mean[where], width[where] = value, 0.0
    return slide(mean, width)


def _ends(histogram: Histogram) -> np.ndarray:
    """The ends of each bin's share in [0, 1], f64[attributes, bins + 1]."""
    sums = np.cumsum(np.asarray(histogram.probabilities, np.float64), axis=1)
    return np.pad(sums / sums[:, -1:], ((0, 0), (1, 0)))  # begins with 0 and ends with 1 exactly


def random_proposal(space: SpaceName = "scenex") -> Proposal:
    """The whole range of every attribute of a space."""
    return slide(np.full(len(SPACES[space]), 0.5), 1.0)


def default_proposal(width: float = RELAXATION, space: SpaceName = "scenex") -> Proposal:
    """Intervals of one ``width`` around the default street; attributes beyond the 23 have its exact value.

    So both spaces have the same default streets up to random choices.
    """
    centre = default_unit(space)
    widths = np.full(len(centre), width)
    widths[len(SPACES["scenex"]) :] = 0.0
    return slide(centre, widths)


def named(name: str, space: SpaceName, width: float = RELAXATION) -> Proposal:
    """The proposal ``random``, or ``default``: intervals of one ``width`` around the default street."""
    return random_proposal(space) if name == "random" else default_proposal(width, space)


def streets_named(name: str, space: SpaceName, width: float = RELAXATION) -> Streets:
    """The streets of `named`, or ``mixed``: half ``default``, half ``random``.

    Raises:
        ValueError: the name is unknown.
    """
    if name not in NAMES:
        raise ValueError(f"unknown streets {name!r}; {hint(name, NAMES)}")
    if name != "mixed":
        return named(name, space, width)
    return mixture((0.5, 0.5), (default_proposal(width, space), random_proposal(space)))


def describe(streets: Streets) -> dict[str, Any]:
    """Streets in the form of ``attributes.json``: the space, and each component's share and attributes."""
    space = space_in(streets)
    rows = [
        {"share": share, "attributes": _rows(component, space)}
        for share, component in components(streets)
    ]
    return {"space": space, "components": rows}


def _rows(component: Component, space: SpaceName) -> dict[str, dict[str, Any]]:
    rows: dict[str, dict[str, Any]] = {}
    # Slid, so that the file has no intervals that would be refused.
    centres, widths = (part.tolist() for part in moments(component))
    for attribute, centre, width in zip(SPACES[space], centres, widths, strict=True):
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
    if isinstance(component, Histogram):
        fixed = dict(component.held)
        for k, (row, shares) in enumerate(zip(rows.values(), component.probabilities, strict=True)):
            if k not in fixed:
                row["unit"]["probabilities"] = [shortest(share) for share in shares]
    return rows


def shortest(value: float) -> float:
    """The shortest decimal number that reads back as the same float32."""
    exact = np.float32(value)
    short = float(str(exact))
    return short if np.float32(short) == exact else float(exact)


def parse_streets(value: Any, where: str = "attributes") -> Streets:
    """Read streets from JSON: ``components``, each with ``share`` and ``attributes``, or attributes alone.

    ``space`` names their space; without it, they have the smallest that has them all. Attributes map names to
    a unit value, the same in all streets, or to an interval ``{"centre": c, "width": w}``, possibly below
    ``"unit"`` as in the ``attributes.json`` of a run. Missing attributes of ``LATER`` get their defaults, and
    a log line that starts with ``where`` names them. ``probabilities`` of equal bins of [0, 1] replace centre
    and width; if one attribute has them, all without must have one value.

    Raises:
        ValueError: it is not an object, shares or probabilities do not add up, the space is unknown, or an
            attribute is unknown, missing or outside [0, 1].
    """
    if not isinstance(value, dict):
        raise ValueError(NO_ATTRIBUTES)
    space = value.get("space")
    if space not in (None, *SPACES):
        raise ValueError(f"unknown space {space!r}; {hint(space, SPACES)}")
    missing: dict[str, None] = {}
    if "components" in value:
        streets = _mixed(value["components"], space, missing)
    else:
        streets = _parsed({k: v for k, v in value.items() if k != "space"}, space, missing)
    if missing:
        log.warning("%s: no %s; using their defaults", where, ", ".join(missing))
    return streets


def _mixed(rows: Any, space: SpaceName | None, missing: dict[str, None]) -> Streets:
    """Read the streets of a list of components; see `_parsed`."""
    if not isinstance(rows, list) or not rows:
        raise ValueError("components must be a list of objects with share and attributes")
    shares, proposals = [], []
    for number, row in enumerate(rows):
        where = f"components[{number}]"
        if not isinstance(row, dict) or set(row) != {"share", "attributes"}:
            raise ValueError(f"{where}: expected an object of share and attributes")
        share = row["share"]
        if isinstance(share, bool) or not isinstance(share, int | float) or not 0 < share <= 1:
            raise ValueError(f"{where}: share is {share!r}, but must be a number in (0, 1]")
        try:
            proposals.append(_parsed(row["attributes"], space, missing))
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from None
        shares.append(float(share))
    try:
        return mixture(shares, proposals)
    except ValueError as error:
        raise ValueError(f"components: {error}") from None


def streets_in(path: Path) -> Streets:
    """Read the streets that a JSON file describes, see `parse_streets`.

    Raises:
        UserError: the file is not JSON, or does not describe streets; the message names it.
        OSError: it cannot be read.
    """
    try:
        return parse_streets(read_json(path), str(path))
    except ValueError as error:
        where = "" if str(error).startswith(str(path)) else f"{path}: "
        raise UserError(f"{where}{error}") from None


def read_streets(source: str, space: SpaceName | None) -> Streets:
    """Read the streets of a name (`NAMES`) in a space, by default scenex, or of a file, which has its own.

    Raises:
        OSError: the file cannot be read.
        UserError: as `streets_in`, there is no such file, or the file has another space.
    """
    if source in NAMES:
        return streets_named(source, space or "scenex")
    path = Path(source)
    if not path.is_file():
        expected = f"{', '.join(NAMES)}, or a JSON file such as a run's attributes.json"
        raise UserError(
            f"{source}: {'not a' if path.exists() else 'no such'} file; expected {expected}"
            + suggestion(source, NAMES)
        )
    streets = streets_in(path)
    if space not in (None, space_in(streets)):
        raise UserError(f"{source} has the attributes of space {space_in(streets)}, not {space}")
    return streets


def _parsed(value: Any, space: SpaceName | None, missing: dict[str, None]) -> Component:
    """Read one component; names of attributes that its file is too old to have are added to ``missing``."""
    if not isinstance(value, dict):
        raise ValueError(NO_ATTRIBUTES)
    known_names = names(space or "extended")
    for name in value:
        if name not in known_names:
            raise ValueError(f"unknown attribute {name!r}; {hint(name, known_names)}")
    expected_names = (
        names("scenex") if not space and set(value) <= set(names("scenex")) else known_names
    )
    for name in expected_names:
        if name in value:
            continue
        if BY_NAME[name] not in LATER:
            raise ValueError(f"attribute {name} is missing; all {len(expected_names)} are required")
        missing[name] = None
        value = {**value, name: BY_NAME[name].to_unit(BY_NAME[name].default)}
    units = {name: _unit(value[name]) for name in expected_names}
    binned = [name for name, unit in units.items() if "probabilities" in unit]
    if binned:
        return _histogram(binned[0], units, value)
    rows = [_interval(name, value[name]) for name in expected_names]
    centre, width = np.array(rows, np.float32).T
    return slide(check_unit(centre), width)  # slides by rounding errors at most


def _unit(entry: Any) -> dict[str, Any]:
    """The object with the unit values of an attribute, or an empty one."""
    unit = entry.get("unit", entry) if isinstance(entry, dict) else None
    return unit if isinstance(unit, dict) else {}


def _histogram(first: str, units: dict[str, dict[str, Any]], value: dict[str, Any]) -> Histogram:
    """Make a histogram; attribute ``first`` has probabilities, those without any must have one value.

    Probabilities are not normalised, even if their sum differs from 1 by `NORMED`, so that a file reads back
    exactly; `draw` divides by their sum.
    """
    bins = len(_probabilities(first, units[first]["probabilities"]))
    rows, fixed = [], []
    for k, (name, unit) in enumerate(units.items()):
        if "probabilities" in unit:
            rows.append(_probabilities(name, unit["probabilities"]))
        else:
            centre, width = _interval(name, value[name])
            if width:
                raise ValueError(
                    f"attribute {name} has no probabilities, but {first} has; attributes without "
                    "probabilities must then have one value (width 0)"
                )
            fixed.append((k, float(np.float32(centre))))
            rows.append([1 / bins] * bins)
        if len(rows[-1]) != bins:
            raise ValueError(
                f"attribute {name} has {len(rows[-1])} probabilities, but must have {bins}, as many as "
                f"{first}"
            )
    return Histogram(np.array(rows, np.float32), tuple(fixed))


def _probabilities(name: str, probabilities: Any) -> list[float]:
    """Check the probabilities of the bins of one attribute."""
    if not isinstance(probabilities, list) or len(probabilities) < 2:
        raise ValueError(f"attribute {name}: probabilities must be a list of two or more numbers")
    for number in probabilities:
        if isinstance(number, bool) or not isinstance(number, int | float) or not 0 <= number < 2:
            raise ValueError(
                f"attribute {name} has the probability {number!r}, which must be a number in [0, 1]"
            )
    if abs(math.fsum(probabilities) - 1) > NORMED:
        raise ValueError(
            f"attribute {name} has probabilities that add up to {math.fsum(probabilities):.6g}, not 1"
        )
    return probabilities


def _interval(name: str, entry: Any) -> tuple[float, float]:
    """Centre and width of one attribute, both in [0, 1]."""
    if isinstance(entry, dict):
        unit = entry.get("unit", entry)
        if not isinstance(unit, dict) or "centre" not in unit:
            raise ValueError(f"attribute {name}: expected a number, or centre and width")
        numbers = (unit["centre"], unit.get("width", 0.0))
    else:
        numbers = (entry, 0.0)
    for number in numbers:
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise ValueError(f"attribute {name} is {number!r}; unit values are numbers in [0, 1]")
        if not 0 <= number <= 1:
            raise ValueError(f"attribute {name} is {number}; unit values must lie in [0, 1]")
    centre, width = float(numbers[0]), float(numbers[1])
    low, high = centre - width / 2, centre + width / 2
    if low < -ROUNDING or high > 1 + ROUNDING:
        raise ValueError(
            f"attribute {name} has the interval [{low:.6g}, {high:.6g}] (centre {centre:g}, width "
            f"{width:g}), which must lie in [0, 1]"
        )
    return centre, width


def draw(streets: Streets, seed: int, count: int, start: int = 0) -> np.ndarray:
    """Draw attributes f32[count, attributes] in [0, 1) of ``count`` streets from ``start`` on.

    Street ``k`` depends on (streets, seed, k) only.
    """
    inverses = [_inverse_distribution(component) for _, component in components(streets)]
    units = np.empty((count, len(components(streets)[0][1][0])), np.float32)
    for street in range(start, start + count):
        rng = streams.units(seed, street)
        uniform = rng.random(units.shape[1], dtype=np.float32)
        units[street - start] = inverses[component_of(streets, street)](uniform)
    return np.clip(units, 0.0, BELOW_ONE)  # rounding could reach 1


def _inverse_distribution(component: Component) -> Callable[[np.ndarray], np.ndarray]:
    """The inverse distribution function of the attributes: f32[attributes] in [0, 1) to the same."""
    if isinstance(component, Proposal):
        centre, width = slide(*component)
        return lambda uniform: centre - width / 2 + width * uniform
    ends = _ends(component)
    bins = ends.shape[1] - 1
    borders = (np.arange(1, bins + 1) / bins).astype(np.float32)
    last = np.nextafter(borders, np.float32(0))  # of each bin: rounding could reach the next
    rows = np.arange(len(ends))

    def inverse(uniform: np.ndarray) -> np.ndarray:
        index = (ends[:, 1:] <= uniform[:, None]).sum(axis=1)  # never a bin with probability 0
        begin, end = ends[rows, index], ends[rows, index + 1]
        inside = (uniform - begin) / (end - begin)
        values = np.minimum(((index + inside) / bins).astype(np.float32), last[index])
        for where, value in component.held:
            values[where] = value
        return values

    return inverse


def component_of(streets: Streets, street: int) -> int:
    """The index of the component of a street.

    The fractional part of (street + 1) times the golden ratio chooses it, so that the first streets of a
    dataset have about the right shares, whatever their number and the seed.
    """
    point = (street + 1) * GOLDEN % 1.0
    ends = np.cumsum([share for share, _ in components(streets)])
    return min(int(np.searchsorted(ends, point, side="right")), len(ends) - 1)
