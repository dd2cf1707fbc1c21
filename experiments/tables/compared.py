"""Networks of several training sets, compared over folds and seeds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from experiments.tables.form import Report, class_means, miou
from experiments.tables.stats import bounded, crossed

Folds = Sequence[Sequence[Report | None]]
"""Scores of the networks of one row: for each fold one for each seed, None where training failed."""
FEWEST = 3
"""The smallest number of folds for an interval over folds."""


def row(folds: Folds, classes: Sequence[str]) -> Report:
    """Compute mean and interval of a row, the mIoU of each network, and the mean IoU of each class."""
    nets = [net for fold in folds for net in fold]
    return {
        **bounded(_estimate(_miou(folds))),
        "miou": miou(nets),
        "per_class": class_means(nets, classes),
    }


def gain(folds: Folds, baseline: Folds) -> Report:
    """Compute mean and interval of a row's gain over another, paired by fold and seed."""
    return _estimate(_miou(folds) - _miou(baseline))


def by_class(folds: Folds, count: int) -> list[Report]:
    """Compute mean and interval of each class, over the folds whose test images have it."""
    absent = [None] * count
    values = np.array(
        [[absent if net is None else net["class_iou"] for net in fold] for fold in folds], float
    )
    tested = np.isfinite(values).any(axis=1)  # folds, classes
    return [bounded(_estimate(values[tested[:, k], :, k])) for k in range(count)]


def _miou(folds: Folds) -> np.ndarray:
    """Return the mIoU f64[folds, seeds] in percent, NaN where training failed."""
    return np.array([[np.nan if net is None else net["miou"] for net in fold] for fold in folds])


def _estimate(values: np.ndarray) -> Report:
    """Compute mean and 95 % interval, and the mean of each fold; seeds with a failed network are left out.

    The interval is over folds and networks if there are at least `FEWEST` folds, otherwise over networks
    alone.
    """
    complete = values[:, np.isfinite(values).all(axis=0)]
    if not complete.size:
        return {"mean": None, "ci95": None, "folds": []}
    samples = complete if len(complete) >= FEWEST else complete.mean(axis=0, keepdims=True)
    mean, ci95 = crossed(samples.tolist())
    return {"mean": mean, "ci95": ci95, "folds": complete.mean(axis=1).tolist()}
