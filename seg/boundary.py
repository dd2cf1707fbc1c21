"""Boundary IoU: how well the outlines of classes are found, whatever the size of what they enclose."""

import cv2
import numpy as np
from jaxtyping import Float64, Int64, UInt8

from seg.classes import IGNORE_LABEL

SHARE = 0.02
"""Of an image's diagonal: how wide the strip along an outline is."""


def boundary_counts(
    labels: UInt8[np.ndarray, "h w"],
    predictions: UInt8[np.ndarray, "h w"],
    classes: int,
    share: float = SHARE,
) -> Int64[np.ndarray, "2 classes"]:
    """Count the pixels of the strips along the outlines of classes. Counts of several images add up.

    The strip of a class is what lies within it and within d pixels of its outline or of the image's border,
    d = max(1, round(share * diagonal)); distances are the larger of rows and columns.

    Args:
        labels: true class ids; void belongs to no class, in the prediction neither.
        predictions: predicted class ids.
        classes: how many classes there are.
        share: of the diagonal.

    Returns:
        Pixels in both the true strip and the predicted one, and pixels in either.

    Source: Cheng et al., "Boundary IoU: improving object-centric image segmentation evaluation" (2021);
    for semantic classes, with counts added up over images as for IoU, and void left out.
    """
    distance = max(1, round(share * float(np.hypot(*labels.shape))))
    predictions = np.where(labels == IGNORE_LABEL, IGNORE_LABEL, predictions)
    counts = np.zeros((2, classes), np.int64)
    present = np.union1d(labels, predictions)
    for k in present[present < classes]:
        truth, guess = (_strip(ids == k, distance) for ids in (labels, predictions))
        counts[:, k] = np.sum(truth & guess), np.sum(truth | guess)
    return counts


def _strip(mask: np.ndarray, distance: int) -> np.ndarray:
    """What of a mask is near its outline; beyond the image's border lies no more of it."""
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
        confusion: of the same images, which says what occurs.
    """
    both, either = counts
    return np.where(confusion.sum(1) > 0, both / np.maximum(either, 1), np.nan)
