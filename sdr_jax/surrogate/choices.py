"""Intervals of several widths as what may be chosen for an attribute, and how a model sees an interval."""

from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from sdr_jax.space import Space
from sdr_jax.surrogate.features import Features, check_degrees

SCALES = 4
"""Widths 1, 1/2, 1/4, 1/8: 1 + 3 + 7 + 15 intervals, each overlapping its neighbours by half."""

NARROW = 1 / 16
"""Narrower intervals are alike to the model."""

MOST_PAIRS = 700
"""Features of pairs; spaces that would have more get fewer cosines for each, or no pairs."""


Start = tuple[Float[np.ndarray, "attributes"], Float[np.ndarray, "attributes"]]
"""Centre and width of every attribute's interval where a search begins."""


class Choices(NamedTuple):
    """What may be chosen for each attribute (constants); the last choice is where the search starts."""

    space: Space  # the attributes with their choices in place of bins
    centre: Float[np.ndarray, "attributes choices"]
    width: Float[np.ndarray, "attributes choices"]


def scales(count: int = SCALES) -> tuple[np.ndarray, np.ndarray]:
    """Centres and widths f32[intervals] of intervals of widths 1, 1/2, ..., half a width apart."""
    widths = [2.0**-k for k in range(count)]
    pairs = [(w / 2 * (k + 1), w) for w in widths for k in range(round(2 / w) - 1)]
    centre, width = np.asarray(pairs, np.float32).T
    return centre, width


def choices(space: Space, start: Start, count: int = SCALES) -> Choices:
    """The intervals of all scales for each attribute, and after them the start's own.

    Args:
        space: the attributes and their groups; its bins play no part.
        start: where the search begins.
        count: of scales.
    """
    common = scales(count)
    centre, width = (
        np.concatenate([np.tile(own, (space.attributes, 1)), np.asarray(first)[:, None]], axis=1)
        for own, first in zip(common, start, strict=True)
    )
    sizes = (centre.shape[1],) * space.attributes
    return Choices(Space(space.names, sizes, space.groups), centre, width)


def integrated(
    centre: Float[np.ndarray, "*batch"] | float,
    width: Float[np.ndarray, "*batch"] | float,
    degree: int,
) -> Float[np.ndarray, "*batch features"]:
    """What a model linear in the density sees of an interval, `degree` + 1 numbers.

        sqrt(2) E[cos(pi m x)] = sqrt(2) cos(pi m c) sinc(m w / 2),   m = 1..degree,   and  -log2(w) / 4

    for x uniform on [c - w/2, c + w/2], sinc(t) = sin(pi t) / (pi t). All are 0 for the whole of [0, 1]. The
    last says how narrow the interval is, whatever lies in it.
    """
    m = np.arange(1, degree + 1)
    centre, width = np.asarray(centre)[..., None], np.asarray(width)[..., None]
    cosines = np.sqrt(2) * np.cos(np.pi * m * centre) * np.sinc(m * width / 2)
    narrow = -np.log2(np.clip(width, NARROW, 1.0)) / 4
    return np.concatenate([cosines, narrow], axis=-1).astype(np.float32)


def layout_of(chosen: Choices, degree: int, pair_degree: int) -> Features:
    """The features of choices; their prior variance is 1 / m^2, the narrowness' 1 / 4, a pair's 1 / (m l)^2.

    Raises:
        ValueError: a degree out of range.
    """
    check_degrees(degree, pair_degree)
    basis = integrated(chosen.centre, chosen.width, degree)
    orders = np.arange(1, degree + 1, dtype=np.float32)
    own = np.tile(np.append(1 / orders**2, 0.25), (chosen.space.attributes, 1))
    pairs = [pair for group in chosen.space.groups for pair in combinations(group, 2)]
    while pair_degree and len(pairs) * pair_degree**2 > MOST_PAIRS:
        pair_degree -= 1
    pairs = pairs if pair_degree else []
    products = np.tile(np.outer(own[0, :pair_degree], own[0, :pair_degree]).ravel(), len(pairs))
    return Features(
        basis,
        np.asarray(pairs, np.int32).reshape(-1, 2),
        pair_degree,
        np.concatenate([own.ravel(), products]).astype(np.float32),
    )
