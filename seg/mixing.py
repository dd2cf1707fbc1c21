"""Images mixed with a training set: a few images, drawn so often that they fill a share of all batches."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float32, Int

from seg.data import LabelledImages
from seg.pyramid import Statistics


class TrainingSet(NamedTuple):
    """The images that a network trains on, in one or two parts, and each part's share of all batches."""

    parts: tuple[Any, ...]
    """Labelled images of one size; in a job, the recipes that they are made from."""
    shares: tuple[float, ...] = (1.0,)


def training_set(images: LabelledImages, extra: LabelledImages | None, share: float) -> TrainingSet:
    """Join images and, if there are any, extra images, which have a share of all batches.

    Raises:
        ValueError: a share of 0 or 1, or images of two sizes.
    """
    if extra is None:
        return TrainingSet((images,))
    if not 0 < share < 1:
        raise ValueError(f"the share of the extra images must lie in (0, 1); got {share}")
    size, extra_size = images.images.shape[1:], extra.images.shape[1:]
    if size != extra_size:
        raise ValueError(f"extra images must have the size of the others, {size}; got {extra_size}")
    return TrainingSet((images, extra), (1 - share, share))


def mean_share(share: float, last_share: float | None = None) -> float:
    """The second part's share of all batches, where it changes linearly from the first to the last."""
    return share if last_share is None else (share + last_share) / 2


def extra_count(share: float, images: int) -> int:
    """How many of the images in all batches are extra ones: their share, rounded."""
    return int(np.floor(images * share + 0.5))


def batch_indices(
    rng: np.random.Generator,
    counts: Sequence[int],
    share: float,
    needed: int,
    last_share: float | None = None,
) -> Int[np.ndarray, " needed"]:
    """Choose the images of all updates, one after the other.

    Each part comes in permutations, so that its images are seen equally often. The images of the second
    part are spread evenly: every batch has their share, rounded up or down.

    Args:
        rng: consumed.
        counts: images of each part; the second part's indices follow the first part's.
        share: the second part's share, of the first batch.
        needed: total number of images.
        last_share: that of the last batch, if the share changes linearly.
    """
    if len(counts) == 1:
        return _epochs(rng, counts[0], needed)
    image = np.arange(needed + 1)
    extra_until = image * share
    if last_share is not None:
        extra_until = extra_until + (last_share - share) * image**2 / (2 * needed)
    second = np.diff(np.floor(extra_until + 0.5)) > 0
    indices = np.empty(needed, np.int64)
    indices[~second] = _epochs(rng, counts[0], int(np.sum(~second)))
    indices[second] = counts[0] + _epochs(rng, counts[1], int(np.sum(second)))
    return indices


def _epochs(rng: np.random.Generator, count: int, needed: int) -> np.ndarray:
    epochs = [rng.permutation(count) for _ in range(-(-needed // count))]
    return np.concatenate([np.zeros(0, np.int64), *epochs])[:needed]


def joined(parts: Sequence[Any]) -> Any:
    """Concatenate the arrays (or feature maps) of all parts."""
    if len(parts) == 1:
        return parts[0]
    return jax.tree.map(lambda *arrays: np.concatenate(arrays), *parts)


def mixed(shares: Sequence[float], statistics: Sequence[Statistics]) -> Statistics:
    """Mean and deviation of each channel over parts weighted by their shares.

    m = sum_k s_k m_k, v = sum_k s_k (v_k + m_k^2) - m^2.
    """
    if len(statistics) == 1:
        return statistics[0]
    weights = np.array(shares, np.float64)[:, None]
    means, deviations = (
        np.stack(column).astype(np.float64) for column in zip(*statistics, strict=True)
    )
    mean = (weights * means).sum(0)
    variance = (weights * (deviations**2 + means**2)).sum(0) - mean**2
    return _single(mean), _single(np.maximum(np.sqrt(np.maximum(variance, 0)), 1e-3))


def _single(values: np.ndarray) -> Float32[np.ndarray, " channels"]:
    return values.astype(np.float32)
