"""Print statistics of a dataset, next to those of the images that it should resemble.

    sdr-jax stats streets
    sdr-jax stats streets --against CamVid --only 0016E5 --only 0001TP --json stats.json

For each class: its share of the labelled pixels, its mean row (0 at the top, 1 at the bottom) and the share
of images that show it. For renders also: the shares of shots that were retaken further along the road, and
that still show no street. A comparison with CamVid uses its 11 classes.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from common.command import Arguments, exit_code
from common.files import check_file, write_json
from scene import parsers
from scene.classes import CLASS_NAMES
from scene.dataset.real import CAMVID, CAMVID_OF_TRAIN, open_images


class Statistics(NamedTuple):
    """The statistics of a set of labelled images."""

    images: int
    frequency: np.ndarray  # f64[classes], share of all labelled pixels
    mean_row: np.ndarray  # f64[classes] in [0, 1] from the top, NaN for absent classes
    containing: np.ndarray  # i64[classes], number of images with a class
    void: float  # share of ignored pixels
    mean_rgb: np.ndarray  # f64[3] in 0..255
    framing: tuple[float, float] | None = None  # for renders, see ``Described.framing``


def count(pairs: Iterable[tuple[np.ndarray, np.ndarray]], classes: int) -> Statistics:
    """Count images u8[h, w, 3] with labels u8[h, w]; values from ``classes`` on are ignored."""
    pixels, rows = np.zeros(classes, np.int64), np.zeros(classes)
    containing, rgb, images, total = np.zeros(classes, np.int64), np.zeros(3), 0, 0
    for image, label in pairs:
        height = label.shape[0]
        by_row = np.zeros((height, 256), np.int64)
        np.add.at(by_row, (np.arange(height)[:, None], label), 1)
        class_counts = by_row[:, :classes]
        pixels += class_counts.sum(axis=0)
        rows += ((np.arange(height) + 0.5) / height) @ class_counts
        containing += class_counts.any(axis=0)
        rgb += image.reshape(-1, 3).sum(axis=0, dtype=np.int64)
        images += 1
        total += label.size
    labelled = int(pixels.sum())
    return Statistics(
        images,
        pixels / max(labelled, 1),
        np.where(pixels > 0, rows / np.maximum(pixels, 1), np.nan),
        containing,
        1 - labelled / max(total, 1),
        rgb / max(total, 1),
    )


def compare(
    dataset: Path, against: Path | None, prefixes: tuple[str, ...]
) -> tuple[tuple[str, ...], dict[str, Statistics]]:
    """Names of the classes, and the statistics of ``dataset`` and of the images to compare with, if any.

    Raises:
        ValueError, OSError: a folder holds no images, or a file is damaged; the message names it.
    """
    dataset_images = open_images(dataset)
    target_images = None if against is None else open_images(against, prefixes)
    classes, pairs = dataset_images.classes, dataset_images.pairs
    if target_images is not None and target_images.classes not in (
        classes,
        classes[: len(CLASS_NAMES)],
    ):
        if classes[: len(CLASS_NAMES)] != CLASS_NAMES or target_images.classes != CAMVID:
            raise ValueError(f"{dataset} and {against} have different classes")
        classes = CAMVID
        pairs = ((image, CAMVID_OF_TRAIN[label]) for image, label in dataset_images.pairs)
    statistics = {"dataset": count(pairs, len(classes))._replace(framing=dataset_images.framing)}
    if target_images is not None:
        statistics["target"] = count(target_images.pairs, len(classes))._replace(
            framing=target_images.framing
        )
    return classes, statistics


def report(classes: tuple[str, ...], statistics: Statistics) -> dict[str, Any]:
    """Statistics as JSON values; None for the mean row of an absent class."""
    rows = zip(
        classes,
        statistics.frequency.tolist(),
        statistics.mean_row.tolist(),
        statistics.containing.tolist(),
        strict=True,
    )
    framing = dict(zip(("shots_retaken", "shots_refused"), statistics.framing or (), strict=False))
    return {
        "images": statistics.images,
        **framing,
        "mean_rgb": np.round(statistics.mean_rgb, 2).tolist(),
        "void": round(statistics.void, 6),
        "classes": {
            name: {
                "frequency": round(frequency, 8),
                "mean_row": None if np.isnan(row) else round(row, 4),
                "images": images,
            }
            for name, frequency, row, images in rows
        },
    }


def table(classes: tuple[str, ...], statistics: dict[str, Statistics]) -> str:
    """The statistics side by side, as text."""
    names = list(statistics)
    lines = [
        " " * 14
        + "".join(
            f"{title:^{10 * len(names)}}" for title in ("pixels %", "mean row", "in images %")
        ),
        f"{'class':14s}" + "".join(f"{name:>10s}" for _ in range(3) for name in names),
    ]
    for k, name in enumerate(classes):
        sets = statistics.values()
        cells = [f"{100 * s.frequency[k]:10.3f}" for s in sets]
        cells += [
            " " * 9 + "-" if np.isnan(s.mean_row[k]) else f"{s.mean_row[k]:10.2f}" for s in sets
        ]
        cells += [f"{100 * s.containing[k] / max(s.images, 1):10.0f}" for s in sets]
        lines.append(f"{name:14s}" + "".join(cells))
    for name, s in statistics.items():
        red, green, blue = s.mean_rgb
        lines.append(
            f"{name}: {s.images} images, mean RGB {red:.0f}/{green:.0f}/{blue:.0f}, "
            f"{100 * s.void:.1f} % of pixels ignored"
        )
        if s.framing is not None:
            retaken, refused = (100 * share for share in s.framing)
            lines.append(
                f"{name}: {retaken:.1f} % of shots retaken further along the road, "
                f"{refused:.1f} % still without a street"
            )
    return "\n".join(lines)


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    options = parsers.stats().parse_args(arguments)

    def work() -> None:
        if options.json is not None:
            check_file("--json", options.json)
        classes, statistics = compare(options.dataset, options.against, tuple(options.only))
        print(table(classes, statistics))
        if options.json is not None:
            write_json(options.json, {name: report(classes, s) for name, s in statistics.items()})

    return exit_code(work, users=(ValueError,), debug=options.debug, resumes=False)


if __name__ == "__main__":
    sys.exit(main())
