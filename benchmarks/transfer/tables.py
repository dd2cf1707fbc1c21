"""From confusion matrices to the rows of the transfer benchmark's tables. Shares are in percent."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.report import Row
from scene.assets.families import FAMILIES
from seg.classes import class_table
from seg.metrics import iou, mean_iou

LEAST = 20
"""Pixels of a class from which on an image says something about its tone."""
Confusions = Sequence[np.ndarray]
"""One confusion matrix i64[classes, classes] per seed, the same seeds everywhere."""


def transfer_rows(nets: Mapping[str, Confusions], classes: Sequence[str]) -> list[Row]:
    """What nets trained on renders score on real images: mIoU by seed, then each class's mean IoU."""
    rows = []
    for attributes, confusions in nets.items():
        scores = [100 * mean_iou(c) for c in confusions]
        by_class = 100 * np.nanmean([iou(c) for c in confusions], axis=0)
        rows.append(
            {"attributes": attributes, "mIoU": float(np.mean(scores)), "spread": _spread(scores)}
            | {name: float(value) for name, value in zip(classes, by_class, strict=True)}
        )
    return rows


def tone_rows(
    sets: Mapping[str, tuple[np.ndarray, np.ndarray]], classes: Sequence[str]
) -> list[Row]:
    """How light every class is in each set of images u8[n, h, w, 3] and labels [n, h, w].

    The middle grey of the class, and that over the road's: the mean over images of the median over
    pixels, of images with at least ``LEAST`` pixels of the class.
    """
    tones = {name: _tones(*images, len(classes)) for name, images in sets.items()}
    road = list(classes).index("road")
    rows: list[Row] = []
    for k, name in enumerate(classes):
        row: Row = {"class": name}
        for title, tone in tones.items():
            row[title] = float(tone[k])
            row[f"{title} / road"] = float(tone[k] / tone[road])
        rows.append(row)
    return rows


def _tones(images: np.ndarray, labels: np.ndarray, classes: int) -> np.ndarray:
    greys = images @ np.array([0.299, 0.587, 0.114])
    tones = np.full(classes, np.nan)
    for k in range(classes):
        medians = [
            np.median(grey[label == k])
            for grey, label in zip(greys, labels, strict=True)
            if (label == k).sum() >= LEAST
        ]
        if medians:
            tones[k] = np.mean(medians)
    return tones


def content_rows(contents: Mapping[str, Confusions], classes: Sequence[str]) -> list[Row]:
    """mIoU and IoU of each class in percent, and what is gained over the first row, paired by seed."""
    first = next(iter(contents.values()))
    rows: list[Row] = []
    for name, confusions in contents.items():
        values = 100 * np.array([mean_iou(c) for c in confusions])
        worth = values - 100 * np.array([mean_iou(c) for c in first])
        spread = _spread(list(worth))
        by_class = 100 * np.nanmean([iou(c) for c in confusions], axis=0)
        rows.append(
            {
                "streets": name,
                "mIoU": float(values.mean()),
                "worth": float(worth.mean()),
                "error": None if spread is None else spread / math.sqrt(len(worth)),
                **dict(zip(classes, map(float, by_class), strict=True)),
            }
        )
    return rows


def ingredient_rows(
    whole: Confusions, without: Mapping[str, Confusions], classes: Sequence[str]
) -> list[Row]:
    """What each ingredient is worth: mIoU with everything less mIoU without it, paired by seed.

    ``error`` is the standard error of that mean; ``gains`` and ``loses`` name the classes whose IoU
    the ingredient changes most.
    """
    rows = []
    for name, confusions in without.items():
        pairs = list(zip(whole, confusions, strict=True))
        worth = [100 * (mean_iou(a) - mean_iou(b)) for a, b in pairs]
        by_class = 100 * np.nanmean([iou(a) - iou(b) for a, b in pairs], axis=0)
        spread = _spread(worth)
        best, worst = int(np.nanargmax(by_class)), int(np.nanargmin(by_class))
        rows.append(
            {
                "without": name,
                "mIoU": float(np.mean([100 * mean_iou(c) for c in confusions])),
                "worth": float(np.mean(worth)),
                "error": None if spread is None else spread / math.sqrt(len(worth)),
                "gains": f"{classes[best]} {by_class[best]:+.1f}",
                "loses": f"{classes[worst]} {by_class[worst]:+.1f}",
            }
        )
    return rows


def recognition_rows(real: Confusions, renders: Confusions, classes: Sequence[str]) -> list[Row]:
    """How nets trained on real images see unseen real images and renders, class by class."""
    seen, rendered = np.sum(real, axis=0), np.sum(renders, axis=0)
    rows: list[Row] = []
    for k, name in enumerate(classes):
        rows.append(
            {
                "class": name,
                "real recall": _share(seen[k], k),
                "render recall": _share(rendered[k], k),
                "real IoU": 100 * float(iou(seen)[k]),
                "render IoU": 100 * float(iou(rendered)[k]),
                "taken for": taken_for(rendered[k], k, classes),
            }
        )
    rows.append(
        {
            "class": "mean",
            "real recall": float(np.mean([_share(seen[k], k) for k in range(len(classes))])),
            "render recall": float(np.mean([_share(rendered[k], k) for k in range(len(classes))])),
            "real IoU": 100 * mean_iou(seen),
            "render IoU": 100 * mean_iou(rendered),
            "taken for": "",
        }
    )
    return rows


def close_up_rows(
    families: Mapping[str, np.ndarray], real: Confusions, classes: Sequence[str]
) -> list[Row]:
    """How close-ups of each asset family are seen.

    Args:
        families: name -> i64[classes], its pixels by predicted class.
        real: the same nets on unseen real images, to compare with.
        classes: names.
    """
    seen, rows = np.sum(real, axis=0), []
    for family, predicted in families.items():
        k = int(class_table("camvid").from_train_id[FAMILIES[family].train_id])
        rows.append(
            {
                "family": family,
                "class": classes[k],
                "recall": _share(predicted, k),
                "real recall": _share(seen[k], k),
                "taken for": taken_for(predicted, k, classes),
            }
        )
    return rows


def taken_for(predicted: np.ndarray, own: int, classes: Sequence[str], most: int = 3) -> str:
    """The classes most often seen instead of ``own``, with their share of the pixels."""
    others = [int(k) for k in np.argsort(-predicted, kind="stable") if k != own][:most]
    shares = [(classes[k], _share(predicted, k)) for k in others]
    return ", ".join(f"{name} {share:.0f}" for name, share in shares if share >= 5)


def _share(row: np.ndarray, k: int) -> float:
    return 100 * float(row[k]) / max(float(row.sum()), 1.0)


def _spread(values: Sequence[float]) -> float | None:
    """Standard deviation over the seeds, None for a single one."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else None
