"""From confusion matrices to the rows of the transfer benchmark's tables. Shares are in percent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.report import Row, gain_text
from seg.metrics import iou, mean_iou

LEAST = 20
"""The fewest pixels of a class with which an image counts in the tone of the class."""
Confusions = Sequence[np.ndarray]
"""One confusion matrix i64[classes, classes] per seed, the same seeds everywhere."""


def transfer_rows(nets: Mapping[str, Confusions], classes: Sequence[str]) -> list[Row]:
    """Tabulate networks trained on renders on real images: mIoU with its spread, and the IoU of classes."""
    return [
        {"attributes": attributes, "mIoU": float(np.mean(_mious(confusions)))}
        | {"spread": _spread(_mious(confusions)), **_by_class(confusions, classes)}
        for attributes, confusions in nets.items()
    ]


def gain_rows(
    nets: Mapping[str, Confusions], before: Mapping[str, Confusions], classes: Sequence[str]
) -> list[Row]:
    """Tabulate the gain over another engine, paired by seed, of classes and mIoU, with 95 % intervals."""
    rows: list[Row] = []
    for k, name in enumerate((*classes, "mIoU")):
        row: Row = {"class": name}
        for attributes, confusions in nets.items():
            new, old = _of(confusions, k), _of(before[attributes], k)
            row |= {attributes: float(np.mean(new)), f"{attributes}, gain": gain_text(new, old)}
        rows.append(row)
    return rows


def _of(confusions: Confusions, k: int) -> list[float]:
    """Compute the IoU of a class per seed, or the mIoU after the last class; 0 where the class is absent."""
    values = (np.append(np.nan_to_num(iou(c)), mean_iou(c)) for c in confusions)
    return [100 * float(ious[k]) for ious in values]


def _mious(confusions: Confusions) -> np.ndarray:
    return 100 * np.array([mean_iou(c) for c in confusions])


def _by_class(confusions: Confusions, classes: Sequence[str]) -> dict[str, float]:
    """Compute the mean IoU of each class over the seeds."""
    means = 100 * np.nanmean([iou(c) for c in confusions], axis=0)
    return dict(zip(classes, map(float, means), strict=True))


def tone_rows(
    sets: Mapping[str, tuple[np.ndarray, np.ndarray]], classes: Sequence[str]
) -> list[Row]:
    """Tabulate how light every class is in each set of images u8[n, h, w, 3] and labels [n, h, w].

    The middle grey of the class, and that over the road's, if there is a road: the mean over images of the
    median over pixels, of images with at least ``LEAST`` pixels of the class.
    """
    tones = {name: _tones(*images, len(classes)) for name, images in sets.items()}
    road = classes.index("road") if "road" in classes else None
    rows: list[Row] = []
    for k, name in enumerate(classes):
        row: Row = {"class": name}
        for title, tone in tones.items():
            row[title] = float(tone[k])
            if road is not None:
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


def recognition_rows(real: Confusions, renders: Confusions, classes: Sequence[str]) -> list[Row]:
    """Tabulate how networks trained on real images recognise held-out ones and renders, by class."""
    real_sum, render_sum = np.sum(real, axis=0), np.sum(renders, axis=0)
    rows: list[Row] = [
        {
            "class": name,
            "real recall": _share(real_sum[k], k),
            "render recall": _share(render_sum[k], k),
            "real IoU": 100 * float(iou(real_sum)[k]),
            "render IoU": 100 * float(iou(render_sum)[k]),
            "taken for": taken_for(render_sum[k], k, classes),
        }
        for k, name in enumerate(classes)
    ]
    recalls = ("real recall", "render recall")
    means = {name: float(np.nanmean([row[name] for row in rows])) for name in recalls}
    ious = {"real IoU": 100 * mean_iou(real_sum), "render IoU": 100 * mean_iou(render_sum)}
    return [*rows, {"class": "mean", **means, **ious, "taken for": ""}]


def taken_for(predicted: np.ndarray, label: int, classes: Sequence[str], most: int = 3) -> str:
    """List the classes most often predicted instead of a label, with their share of the pixels."""
    others = [int(k) for k in np.argsort(-predicted, kind="stable") if k != label][:most]
    shares = [(classes[k], _share(predicted, k)) for k in others]
    return ", ".join(f"{name} {share:.0f}" for name, share in shares if share >= 5)


def _share(row: np.ndarray, k: int) -> float:
    return 100 * float(row[k]) / float(row.sum()) if row.any() else float("nan")


def _spread(values: np.ndarray) -> float | None:
    """Compute the standard deviation over the seeds, None for a single one."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else None
