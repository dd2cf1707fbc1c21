"""How unsure a net is of an image, class by class: what orders images that are to be labelled next."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

RAREST = 1e-4
"""Classes count as if they had this share of all pixels at least: what is hardly seen is hardly known."""


class ClassEntropy(NamedTuple):
    """What the probabilities of one image's pixels come to; both are means over its pixels."""

    shares: Float[np.ndarray, "classes"]  # p[c], in all 1
    entropy: Float[np.ndarray, "classes"]  # p[c] H, in all the mean entropy, in [0, 1]


def class_entropy(scores: Float32[np.ndarray, "rows cols classes"]) -> ClassEntropy:
    """The entropy of each pixel, H = -sum_c p[c] log p[c] / log classes, shared out to its classes.

    Args:
        scores: logits of an image; p is their softmax.
    """
    p = np.exp(scores - scores.max(axis=-1, keepdims=True)).astype(np.float64)
    p /= p.sum(axis=-1, keepdims=True)
    entropy = -(p * np.log(np.maximum(p, 1e-300))).sum(axis=-1) / np.log(max(scores.shape[-1], 2))
    return ClassEntropy(p.mean(axis=(0, 1)), (p * entropy[..., None]).mean(axis=(0, 1)))


def uncertainties(own: Sequence[ClassEntropy]) -> Float[np.ndarray, "images"]:
    """How unsure a net is of each image, its classes balanced.

        u[i] = mean_c entropy[i, c] / mean_j shares[j, c]

    The mean entropy of pixels is that of large classes; mIoU counts all classes alike, so each is weighted by
    the inverse of its share of all images, as the net sees them.

    Args:
        own: of all images that are compared.

    Source: entropy as an acquisition function, Settles (2009), "Active Learning Literature Survey"; weights
    of classes by how rare their predictions are, Cai et al. (2021), "Revisiting Superpixels for Active
    Learning in Semantic Segmentation With Realistic Annotation Costs" (theirs are exponential).
    """
    shares = np.mean([each.shares for each in own], axis=0)
    return np.mean([each.entropy for each in own] / np.maximum(shares, RAREST), axis=1)
