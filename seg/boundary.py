"""Boundary IoU: how well a network finds the outlines of classes, whatever the size of their areas."""

import cv2
import numpy as np
from jaxtyping import Float64, Int64, UInt8

from seg.classes import IGNORE_LABEL

SHARE = 0.02
"""Width of the strip along an outline, as a share of the image's diagonal."""


def boundary_counts(
    labels: UInt8[np.ndarray, "h w"],
    predictions: UInt8[np.ndarray, "h w"],
    classes: int,
) -> Int64[np.ndarray, "2 classes"]:
    """Count the pixels of the strips along the outlines of classes. Counts of several images add up.

    The strip of a class is its pixels within a distance d of its outline or of the image's border, with
    d = max(1, round(SHARE * diagonal)); a distance is the larger of its rows and columns.

    Args:
        labels: true class ids; ignored pixels count for no class, in predictions either.
        predictions: predicted class ids.
        classes: the number of classes.

    Returns:
        Pixels of each class in both the true and the predicted strip, and pixels in either of them.

    Source: Cheng et al., "Boundary IoU: improving object-centric image segmentation evaluation" (2021);
    for semantic classes, with counts added up over images as for IoU, and ignored pixels left out.
    """
    distance = max(1, round(SHARE * float(np.hypot(*labels.shape))))
    predictions = np.where(labels == IGNORE_LABEL, IGNORE_LABEL, predictions)
    counts = np.zeros((2, classes), np.int64)
    present = np.union1d(labels, predictions)
    for k in present[present < classes]:
        truth, guess = (_strip(ids == k, distance) for ids in (labels, predictions))
        counts[:, k] = np.sum(truth & guess), np.sum(truth | guess)
    return counts


def perimeters(
    labels: UInt8[np.ndarray, "n h w"], classes: int, against: int | None = None
) -> tuple[Int64[np.ndarray, " classes"], Int64[np.ndarray, " classes"]]:
    """Count each class's pixels, and the sides at which they meet another class or ignored pixels.

    Sides per pixel say how ragged a class is: an outline around a whole crown has fewer than its leaves.

    Args:
        labels: class ids.
        classes: the number of classes.
        against: count only sides at which a pixel meets this id.
    """
    sides = np.zeros(256, np.int64)
    for axis in (1, 2):
        lines = np.moveaxis(labels, axis, 0)
        differs = lines[1:] != lines[:-1]
        for pixels, others in ((lines[1:], lines[:-1]), (lines[:-1], lines[1:])):
            counted = differs if against is None else differs & (others == against)
            sides += np.bincount(pixels[counted], minlength=256)
    return sides[:classes], np.bincount(labels.ravel(), minlength=256)[:classes]


def _strip(mask: np.ndarray, distance: int) -> np.ndarray:
    """The part of a mask near its outline; nothing of it lies beyond the image's border."""
    inner = cv2.erode(
        mask.astype(np.uint8),
        np.ones((3, 3), np.uint8),
        iterations=distance,
        borderType=cv2.BORDER_CONSTANT,
        borderValue=0,
    )
    return mask & (inner == 0)


def boundary_iou(
    counts: Int64[np.ndarray, "2 classes"], confusion: Int64[np.ndarray, "classes classes"]
) -> Float64[np.ndarray, " classes"]:
    """Boundary IoU of each class, NaN for classes that do not occur in the ground truth.

    Args:
        counts: from `boundary_counts`.
        confusion: the confusion matrix of the same images, which says what classes occur.
    """
    intersection, union = counts
    return np.where(confusion.sum(1) > 0, intersection / np.maximum(union, 1), np.nan)
