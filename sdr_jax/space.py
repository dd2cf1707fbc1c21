"""Attribute spaces, and the proposals that every search method makes.

An attribute is a number in [0, 1], cut into bins. A data set is made from a *proposal*: one interval per
attribute, from which every street of the data set draws its own value.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float

Width = float | tuple[float, ...] | None
"""The width of relaxed bins: one for all attributes, one for each, or by default 1 / K."""


@dataclass(frozen=True)
class Space:
    """The attributes to search over; static and hashable. `space` builds one from names.

    Attributes:
        names: one unique name per attribute; the paper's N is their number.
        bins: each attribute's number of bins (the paper's K, which may differ), >= 2.
        groups: a partition of the attributes' indices; groups are optimised in this order.
        unordered: indices of attributes whose bins have no order (a weather): to models no two of them
            are alike, and relaxation does not mix them.
    """

    names: tuple[str, ...]
    bins: tuple[int, ...]
    groups: tuple[tuple[int, ...], ...]
    unordered: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Validate the fields; see `space` for the errors."""
        indices = range(len(self.names))
        members = [index for group in self.groups for index in group]
        outside = [index for index in (*members, *self.unordered) if index not in indices]
        if not self.names:
            raise ValueError("a space needs at least one attribute")
        if len(self.bins) != len(self.names):
            raise ValueError(f"{len(self.names)} attributes, but {len(self.bins)} numbers of bins")
        for name, bins in zip(self.names, self.bins, strict=True):
            if not isinstance(bins, int) or bins < 2:
                raise ValueError(
                    f"attribute {name!r} has {bins!r} bins; the number must be an integer, at least 2"
                )
        if outside:
            raise ValueError(f"there is no attribute {outside[0]}, but only {len(self.names)}")
        if not all(self.groups):
            raise ValueError("a group needs at least one attribute")
        _refuse_duplicates(self.names, "attribute name(s)")
        _refuse_duplicates([self.names[index] for index in members], "attribute(s) in the groups")
        missing = [repr(self.names[index]) for index in indices if index not in members]
        if missing:
            raise ValueError(f"in no group: {', '.join(missing)}")

    @property
    def attributes(self) -> int:
        """The number of attributes."""
        return len(self.names)

    @property
    def max_bins(self) -> int:
        """The largest number of bins of any attribute."""
        return max(self.bins)


class Proposal(NamedTuple):
    """A distribution over streets: each attribute is uniform on an interval of [0, 1]."""

    centre: Float[Array, "*batch attributes"]  # the middle of the interval
    width: Float[Array, "*batch attributes"]  # its length


def space(
    names: Sequence[str],
    bins: int | np.integer | Sequence[int] | np.ndarray = 10,
    groups: Sequence[Sequence[str]] | None = None,
    unordered: Sequence[str] = (),
) -> Space:
    """Build a `Space` from names.

    Args:
        names: one unique name per attribute.
        bins: the number of bins of all attributes, or one number for each.
        groups: the partition into groups of names, in the order in which they are optimised.
            By default all attributes are one group and are optimised jointly.
        unordered: names of attributes whose bins have no order.

    Returns:
        The space.

    Raises:
        ValueError: names that are one string, a name that is unknown, repeated or in no group, fewer than two
            bins, or an empty group.

    Source: section "Scalable Discretization-and-Relaxation", "Method scalability"; section "SDR in Groups".
    """
    if isinstance(names, str):
        raise ValueError(f"names is the string {names!r}, but must be a list of names")
    names = tuple(names)
    counts = np.asarray(bins).tolist()  # NumPy's integers become Python's
    per_attribute = tuple(counts) if isinstance(counts, list) else (counts,) * len(names)
    groups = (names,) if groups is None else groups
    grouped = [name for group in groups for name in group]
    for where, members in (("the groups", grouped), ("unordered", unordered)):
        unknown = [repr(name) for name in members if name not in names]
        if unknown:
            raise ValueError(
                f"unknown attribute(s) in {where}: {', '.join(unknown)}; choose from {', '.join(names)}"
            )
    indices = tuple(tuple(names.index(name) for name in group) for group in groups)
    without_order = tuple(index for index, name in enumerate(names) if name in unordered)
    return Space(names, per_attribute, indices, without_order)


def _refuse_duplicates(names: Sequence[str], what: str) -> None:
    repeated = [repr(name) for name, count in Counter(names).items() if count > 1]
    if repeated:
        raise ValueError(f"{what} given more than once: {', '.join(repeated)}")
