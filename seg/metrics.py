"""Confusion matrix, intersection over union, and their mean.

The mean is over the classes that occur in the ground truth of the tested set. An absent class is left
out even if it is predicted, since those pixels already count against their true classes. A class that
occurs and is never predicted counts 0.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64, Int64, Integer

from seg.classes import IGNORE_LABEL

PIECE = 2**16
"""So many pixels are counted at a time, so that temporary arrays stay in the processor's cache."""


def confusion_matrix(
    labels: Integer[np.ndarray, "*shape"],
    predictions: Integer[np.ndarray, "*shape"],
    classes: int,
) -> Int64[np.ndarray, "classes classes"]:
    """Count pixels by true and by predicted class. Matrices of several batches add up.

    Args:
        labels: true class ids; `IGNORE_LABEL` for pixels that do not count.
        predictions: predicted class ids, same shape.
        classes: the number of classes.

    Returns:
        Counts; row: true class, column: predicted class.

    Raises:
        ValueError: shapes differ, or an id lies outside 0 .. classes - 1.
    """
    if labels.shape != predictions.shape:
        raise ValueError(
            f"labels {labels.shape} and predictions {predictions.shape} must have the same shape"
        )
    confusion = np.zeros((classes, classes), np.int64)
    truth, guess = labels.ravel(), predictions.ravel()
    for first in range(0, labels.size, PIECE):
        piece = slice(first, first + PIECE)
        confusion += _counts(truth[piece], guess[piece], classes)
    return confusion


def _counts(labels: np.ndarray, predictions: np.ndarray, classes: int) -> np.ndarray:
    counted = labels != IGNORE_LABEL
    truth = labels[counted].astype(np.int64)
    guess = predictions[counted].astype(np.int64)
    for name, ids in (("labels", truth), ("predictions", guess)):
        if ids.size and (ids.min() < 0 or ids.max() >= classes):
            raise ValueError(
                f"{name} must be in 0..{classes - 1} (or {IGNORE_LABEL}, ignored, in labels); "
                f"found {ids.min()}..{ids.max()}"
            )
    return np.bincount(truth * classes + guess, minlength=classes * classes).reshape(
        classes, classes
    )


def iou(confusion: Int64[np.ndarray, "classes classes"]) -> Float64[np.ndarray, " classes"]:
    """IoU of each class: true positives / (truth + predicted - true positives).

    NaN for classes that do not occur in the ground truth.
    """
    hits = np.diagonal(confusion).astype(np.float64)
    truth = confusion.sum(1)
    union = truth + confusion.sum(0) - hits
    return np.where(truth > 0, hits / np.maximum(union, 1), np.nan)


def mean_iou(
    confusion: Int64[np.ndarray, "classes classes"], classes: Sequence[int] | None = None
) -> float:
    """Mean IoU over the classes that occur in the ground truth.

    Args:
        confusion: from `confusion_matrix`.
        classes: ids to take the mean over, such as `seg.classes.SYNTHIA_16`; None for all. Pixels
            predicted as another class count against their true class.

    Returns:
        mIoU in [0, 1].

    Raises:
        ValueError: the ground truth has no pixel of these classes.
    """
    chosen = slice(None) if classes is None else list(classes)
    if not confusion[chosen].any():
        of_these = "" if classes is None else f" of the classes {', '.join(map(str, classes))}"
        raise ValueError(f"the test set has no labelled pixel{of_these}")
    return float(np.nanmean(iou(confusion)[chosen]))


def absent_classes(
    confusion: Int64[np.ndarray, "classes classes"], names: Sequence[str]
) -> tuple[str, ...]:
    """Names of the classes that are absent from the ground truth, which `mean_iou` leaves out."""
    return tuple(name for name, truth in zip(names, confusion.sum(1), strict=True) if truth == 0)
