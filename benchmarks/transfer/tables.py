"""Makes the rows of the transfer benchmark's tables from confusion matrices. Shares are in percent."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.report import Row
from scene.assets.families import FAMILIES
from seg.classes import class_table
from seg.metrics import iou, mean_iou

LEAST = 20
"""The least number of pixels of a class in an image that counts for the class's tone."""
Confusions = Sequence[np.ndarray]
"""One confusion matrix i64[classes, classes] per seed, the same seeds everywhere."""


def transfer_rows(nets: Mapping[str, Confusions], classes: Sequence[str]) -> list[Row]:
    """Nets trained on renders, tested on real images: mIoU with its spread, and each class's IoU."""
    return [
        {"attributes": attributes, "mIoU": float(np.mean(_mious(confusions)))}
        | {"spread": _spread(_mious(confusions)), **_by_class(confusions, classes)}
        for attributes, confusions in nets.items()
    ]


def _mious(confusions: Confusions) -> np.ndarray:
    return 100 * np.array([mean_iou(c) for c in confusions])


def _by_class(confusions: Confusions, classes: Sequence[str]) -> dict[str, float]:
    """The mean IoU of each class over the seeds."""
    means = 100 * np.nanmean([iou(c) for c in confusions], axis=0)
    return dict(zip(classes, map(float, means), strict=True))


def _worth(better: Confusions, worse: Confusions) -> Row:
    """The mean difference in mIoU, paired by seed, and its standard error."""
    worth = _mious(better) - _mious(worse)
    spread = _spread(worth)
    error = None if spread is None else spread / math.sqrt(len(worth))
    return {"worth": float(worth.mean()), "error": error}


def tone_rows(
    sets: Mapping[str, tuple[np.ndarray, np.ndarray]], classes: Sequence[str]
) -> list[Row]:
    """The lightness of every class in each set of images u8[n, h, w, 3] and labels [n, h, w].

    It is the class's median grey, also relative to the road's: the mean over images of the median over
    pixels, for images with at least ``LEAST`` pixels of the class.
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
    """mIoU and IoU of each class in percent, and the gain over the first row, paired by seed."""
    first = next(iter(contents.values()))
    return [
        {"streets": name, "mIoU": float(_mious(confusions).mean())}
        | {**_worth(confusions, first), **_by_class(confusions, classes)}
        for name, confusions in contents.items()
    ]


def ingredient_rows(
    whole: Confusions, without: Mapping[str, Confusions], classes: Sequence[str]
) -> list[Row]:
    """The gain by each ingredient: mIoU with everything minus mIoU without it, paired by seed.

    ``gains`` and ``loses`` name the classes whose IoU the ingredient changes most.
    """
    rows = []
    for name, confusions in without.items():
        pairs = zip(whole, confusions, strict=True)
        by_class = 100 * np.nanmean([iou(a) - iou(b) for a, b in pairs], axis=0)
        best, worst = int(np.nanargmax(by_class)), int(np.nanargmin(by_class))
        rows.append(
            {
                "without": name,
                "mIoU": float(_mious(confusions).mean()),
                **_worth(whole, confusions),
                "gains": f"{classes[best]} {by_class[best]:+.1f}",
                "loses": f"{classes[worst]} {by_class[worst]:+.1f}",
            }
        )
    return rows


def recognition_rows(real: Confusions, renders: Confusions, classes: Sequence[str]) -> list[Row]:
    """The IoU of nets trained on real images on unseen real images and on renders, class by class."""
    seen, rendered = np.sum(real, axis=0), np.sum(renders, axis=0)
    rows: list[Row] = [
        {
            "class": name,
            "real recall": _share(seen[k], k),
            "render recall": _share(rendered[k], k),
            "real IoU": 100 * float(iou(seen)[k]),
            "render IoU": 100 * float(iou(rendered)[k]),
            "taken for": taken_for(rendered[k], k, classes),
        }
        for k, name in enumerate(classes)
    ]
    recalls = ("real recall", "render recall")
    means = {name: float(np.mean([row[name] for row in rows])) for name in recalls}
    ious = {"real IoU": 100 * mean_iou(seen), "render IoU": 100 * mean_iou(rendered)}
    return [*rows, {"class": "mean", **means, **ious, "taken for": ""}]


def close_up_rows(
    families: Mapping[str, np.ndarray], real: Confusions, classes: Sequence[str]
) -> list[Row]:
    """The predictions in close-ups of each asset family.

    Args:
        families: name -> i64[classes], its pixels by predicted class.
        real: the same nets on unseen real images, for comparison.
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
    """The classes most often predicted instead of ``own``, with their share of the pixels."""
    others = [int(k) for k in np.argsort(-predicted, kind="stable") if k != own][:most]
    shares = [(classes[k], _share(predicted, k)) for k in others]
    return ", ".join(f"{name} {share:.0f}" for name, share in shares if share >= 5)


def _share(row: np.ndarray, k: int) -> float:
    return 100 * float(row[k]) / max(float(row.sum()), 1.0)


def _spread(values: np.ndarray) -> float | None:
    """Standard deviation over the seeds, None for a single one."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else None
