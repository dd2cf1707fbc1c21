"""A net's uncertainty about an image and the layout of its classes, to choose the next images to label."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

PARTS = 2
"""Parts of an image along each side in which classes are counted."""


class Uncertainty(NamedTuple):
    """A summary of a net's scores of one image."""

    margin: float  # in [0, 1]: 0 for certainty in all pixels, 1 for a tie of two classes in all
    layout: tuple[float, ...]  # mean probability of each class in each part, row by row


def uncertainty(scores: Float32[np.ndarray, "rows cols classes"]) -> Uncertainty:
    """Compute how close the two likeliest classes are on average over pixels, and the layout of the classes.

        margin = mean_x (1 - (p1[x] - p2[x]))

    with p the softmax of the scores, p1 its highest and p2 its second highest value.

    Args:
        scores: logits of an image, with 1 class or more.

    Source: margin sampling, Scheffer et al. (2001), "Active Hidden Markov Models for Information Extraction";
    Settles (2009), "Active Learning Literature Survey", section 3.1.
    """
    p = np.exp(scores - scores.max(axis=-1, keepdims=True))
    p /= p.sum(axis=-1, keepdims=True)
    margin = 0.0
    if p.shape[-1] > 1:
        highest = np.partition(p, -2, axis=-1)
        margin = float(np.mean(1 - (highest[..., -1] - highest[..., -2]), dtype=np.float64))
    ends = [np.linspace(0, size, PARTS + 1).astype(int) for size in p.shape[:2]]
    parts = [
        p[top:bottom, left:right]
        for top, bottom in zip(ends[0], ends[0][1:], strict=False)
        for left, right in zip(ends[1], ends[1][1:], strict=False)
    ]
    means = [part.mean(axis=(0, 1)) if part.size else np.zeros(p.shape[-1]) for part in parts]
    return Uncertainty(margin, tuple(np.concatenate(means).tolist()))


def order(own: Sequence[Uncertainty], first: int) -> list[int]:
    """Order images by index for labelling.

    The first image has the largest margin. Each of the next ``first`` - 1 has the largest product of its
    margin and its layout's distance to the nearest earlier one, so that similar images do not follow each
    other. The others follow by margin.

    Args:
        own: the uncertainties of all images.
        first: the number of images that are labelled together, 1 or more.

    Source: farthest-first, Sener and Savarese (2018), "Active Learning for Convolutional Neural Networks: A
    Core-Set Approach"; the product with uncertainty is ours.
    """
    if not own:
        return []
    margins = np.array([each.margin for each in own])
    layouts = np.array([each.layout for each in own])
    nearest = np.ones(len(own))
    found: list[int] = []
    for _ in range(min(first, len(own))):
        values = margins * nearest
        values[found] = -1
        found.append(int(values.argmax()))
        distance = np.linalg.norm(layouts - layouts[found[-1]], axis=1)
        nearest = distance if len(found) == 1 else np.minimum(nearest, distance)
    rest = np.argsort(-margins, kind="stable").tolist()
    return [*found, *(k for k in rest if k not in set(found))]
