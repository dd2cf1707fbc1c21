"""A network's uncertainty about an image and its layout of classes, to choose the next images to label."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

PARTS = 2
"""Parts of an image along each side in which classes are counted."""


class Uncertainty(NamedTuple):
    """A summary of a network's scores of one image."""

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
    edges = [np.linspace(0, size, PARTS + 1).astype(int) for size in p.shape[:2]]
    parts = [
        p[top:bottom, left:right]
        for top, bottom in zip(edges[0], edges[0][1:], strict=False)
        for left, right in zip(edges[1], edges[1][1:], strict=False)
    ]
    means = [part.mean(axis=(0, 1)) if part.size else np.zeros(p.shape[-1]) for part in parts]
    return Uncertainty(margin, tuple(np.concatenate(means).tolist()))


def order(uncertainties: Sequence[Uncertainty], first: int) -> list[int]:
    """Order images by index for labelling.

    The first image has the largest margin. Each of the next ``first`` - 1 has the largest product of its
    margin and its layout's distance to the nearest earlier one, so that similar images do not follow each
    other. The others follow by margin.

    Args:
        uncertainties: the uncertainties of all images.
        first: the number of images that are labelled together, 1 or more.

    Source: farthest-first, Sener and Savarese (2018), "Active Learning for Convolutional Neural Networks: A
    Core-Set Approach"; the product with uncertainty is ours.
    """
    if not uncertainties:
        return []
    margins = np.array([image.margin for image in uncertainties])
    layouts = np.array([image.layout for image in uncertainties])
    nearest = np.ones(len(uncertainties))
    chosen: list[int] = []
    for _ in range(min(first, len(uncertainties))):
        values = margins * nearest
        values[chosen] = -1
        chosen.append(int(values.argmax()))
        distance = np.linalg.norm(layouts - layouts[chosen[-1]], axis=1)
        nearest = distance if len(chosen) == 1 else np.minimum(nearest, distance)
    rest = np.argsort(-margins, kind="stable").tolist()
    return [*chosen, *(k for k in rest if k not in set(chosen))]
