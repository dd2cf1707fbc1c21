"""The intervals that an attribute can choose from, of several widths, and their features for a model."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sdr_jax.bins import bin_centres, bin_mask, ordered
from sdr_jax.models.effects import Effects, effects_of
from sdr_jax.models.features import affordable, check_degrees, lay_out, main_variances
from sdr_jax.relaxation import bin_widths
from sdr_jax.space import Proposal, Space, Width

NARROW = 1 / 16
"""The model does not tell narrower intervals apart."""

Start = tuple[Float[np.ndarray, "attributes"], Float[np.ndarray, "attributes"]]
"""Centre and width of every attribute's interval at the start of a search."""


class Choices(NamedTuple):
    """The choices of each attribute (constants)."""

    space: Space  # the attributes with their choices in place of bins
    centre: Float[np.ndarray, "attributes choices"]  # 0.5 where an attribute has no such choice
    width: Float[np.ndarray, "attributes choices"]  # 1 where an attribute has no such choice
    start: Int[np.ndarray, "attributes"]  # the choice at the start of the search
    scale: Int[np.ndarray, "attributes choices"]  # index of the width; -1 for no such choice


def runs(bins: int, in_order: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """List the centres and widths f32[intervals] of runs of 1, 2, 4, ... neighbouring bins, and of all bins.

    Runs of two or more overlap their neighbours by half; the last one ends at the end of the range. Bins
    without an order are taken one by one, or all together.
    """
    intervals = {(0, bins)}  # first bin, number of bins
    length = 1
    while length < bins and (in_order or length == 1):
        last = bins - length
        intervals |= {(first, length) for first in (*range(0, last, max(length // 2, 1)), last)}
        length *= 2
    widest_first = sorted(intervals, key=lambda interval: (-interval[1], interval[0]))
    first, count = np.asarray(widest_first, np.float32).T
    return (first + count / 2) / bins, count / bins


def choices(space: Space, start: Start, width: Width = None) -> Choices:
    """List the runs of bins of each attribute, and then the interval of the start if it is not among them.

    Args:
        space: the attributes, their bins and groups.
        start: the intervals at the start of the search.
        width: an attribute whose width is 0 has no intervals. Its choices, and its start, are single values,
            or single bins if these have no order. Other widths have no effect.
    """
    rows, start_choices = [], []
    single = np.asarray(bin_widths(space, 0.0))
    no_width = np.broadcast_to(1.0 if width is None else width, space.attributes) == 0
    for attribute, bins in enumerate(space.bins):
        in_order = attribute not in space.unordered
        centre, wide = runs(bins, in_order)
        first = np.asarray([part[attribute] for part in start], np.float32)
        if no_width[attribute]:
            centre = centre[-bins:]  # single bins come last
            if not in_order:
                first[0] = centre[min(int(first[0] * bins), bins - 1)]
            first[1] = single[attribute]
            wide = np.full(bins, first[1])
        equal = np.all(np.abs(np.stack([centre, wide]) - first[:, None]) < 1e-5, axis=0)
        if not equal.any():
            centre, wide = np.append(centre, first[0]), np.append(wide, first[1])
            equal = np.append(equal, True)
        rows.append((centre, wide))
        start_choices.append(int(np.argmax(equal)))
    sizes = tuple(len(centre) for centre, _ in rows)
    padded = [np.full((space.attributes, max(sizes)), fill, np.float32) for fill in (0.5, 1.0)]
    for attribute, row in enumerate(rows):
        for table, values in zip(padded, row, strict=True):
            table[attribute, : len(values)] = values
    scale = np.full((space.attributes, max(sizes)), -1, np.int32)
    for attribute, (_, wide) in enumerate(rows):
        scale[attribute, : len(wide)] = np.unique(wide.round(6), return_inverse=True)[1]
    chosen = Space(space.names, sizes, space.groups, space.unordered)
    return Choices(chosen, padded[0], padded[1], np.asarray(start_choices, np.int32), scale)


def integrated(
    centre: Float[np.ndarray, "*batch"] | float,
    width: Float[np.ndarray, "*batch"] | float,
    degree: int,
) -> Float[np.ndarray, "*batch features"]:
    """Compute an interval's features for a model that is linear in the density, `degree` + 1 numbers.

        sqrt(2) E[cos(pi m x)] = sqrt(2) cos(pi m c) sinc(m w / 2),   m = 1..degree,   and  -log2(w) / 4

    for x uniform on [c - w/2, c + w/2], sinc(t) = sin(pi t) / (pi t). All are 0 for the whole of [0, 1].
    The last one depends on the width alone.
    """
    m = np.arange(1, degree + 1)
    centre, width = np.asarray(centre)[..., None], np.asarray(width)[..., None]
    cosines = np.sqrt(2) * np.cos(np.pi * m * centre) * np.sinc(m * width / 2)
    narrow = -np.log2(np.clip(width, NARROW, 1.0)) / 4
    return np.concatenate([cosines, narrow], axis=-1).astype(np.float32)


def covered(
    bins: int, centre: Float[np.ndarray, "*batch"], width: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch bins"]:
    """Compute the share of each interval that lies in each bin."""
    edges = np.arange(bins + 1) / bins
    width = np.maximum(np.asarray(width), 1e-6)[..., None]
    filled = np.diff(np.clip((edges - np.asarray(centre)[..., None]) / width + 0.5, 0, 1))
    return filled / filled.sum(axis=-1, keepdims=True)


def shares_of_bins(space: Space, proposals: Proposal) -> Float[Array, "attributes bins"]:
    """Compute the share of each bin in streets of n proposals f32[n attributes]; rows sum to 1."""
    bins = jnp.asarray(space.bins, jnp.float32)[:, None]
    edges = jnp.arange(space.max_bins + 1)[None, :] / bins
    width = jnp.maximum(proposals.width, 1e-4)[..., None]
    below = (edges[None] - proposals.centre[..., None]) / width + 0.5
    filled = jnp.diff(jnp.clip(below, 0.0, 1.0), axis=-1).mean(axis=0)
    filled = jnp.where(jnp.arange(space.max_bins)[None, :] < bins, filled, 0.0)
    return filled / filled.sum(axis=1, keepdims=True)


def make_effects(
    space: Space, chosen: Choices, degree: int, pair_degree: int | None = None
) -> Effects:
    """Make the model over choices: `effects.make_effects` with features integrated over intervals.

    All attributes share the second cosine and the term for narrowness. An interval of bins without an
    order has the mean of the features of the bins that it covers.

    Raises:
        ValueError: a degree out of range.
    """
    check_degrees(degree, 0 if pair_degree is None else pair_degree)
    variances = main_variances(space, degree)
    columns = variances.shape[1]
    basis = integrated(chosen.centre, chosen.width, columns)
    for attribute in space.unordered:
        bins = space.bins[attribute]
        centres = bin_centres(space)[attribute, :bins, None]
        cosines = np.sqrt(2) * np.cos(np.pi * centres * np.arange(1, columns + 1))
        shares = covered(bins, chosen.centre[attribute], chosen.width[attribute])
        basis[attribute, :, :columns] = shares @ cosines
    has_feature = np.append(variances > 0, ordered(space)[:, None], axis=1)
    basis = basis * has_feature[:, None, :] * bin_mask(chosen.space)[:, :, None]
    variances = np.append(variances, 0.25 * ordered(space)[:, None], axis=1)
    pair_degree = affordable(space, degree) if pair_degree is None else pair_degree
    layout = lay_out(chosen.space, basis, variances, pair_degree)
    return effects_of(chosen.space, layout, columns=(1, columns) if columns > 1 else (columns,))
