"""Files of `sdr-jax predict --rank` besides label images: the ranking, and files for annotation tools."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from common.errors import UserError, printable
from common.files import read_bytes, write
from experiments.app.prelabels import cvat, label_studio
from seg.classes import IGNORE_LABEL
from seg.model import LabelClass, Model

RANKING, CVAT, CVAT_LABELS = "ranking.csv", "cvat.zip", "cvat_labels.json"
STUDIO, STUDIO_LABELS = "label_studio.json", "label_studio.xml"


class Ranked(NamedTuple):
    """An image of the ranking."""

    name: str  # of its results, without suffix
    file: str  # its path below the parent of the images' folder
    uncertainty: float  # in [0, 1], 0 if certain in all pixels
    labels: Path  # its PNG of ids


def write_files(out: Path, ranked: Sequence[Ranked], first: int, model: Model) -> None:
    """Write the ranking of all images, and pre-labels of the first ones.

    Args:
        out: the folder.
        ranked: the images, the first to label first.
        first: number of images with pre-labels in the tools' files.
        model: the model that made the labels.

    Raises:
        UserError: a label image is damaged.
        OSError: a file cannot be written; the error names it.
    """
    classes, chosen = model.classes, ranked[:first]
    rows = ((k, printable(row.file), f"{row.uncertainty:.6f}") for k, row in enumerate(ranked, 1))
    table = io.StringIO()
    csv.writer(table, lineterminator="\n").writerows([("rank", "image", "uncertainty"), *rows])
    write(out / CVAT, cvat.archive(_labelled(chosen, classes), classes))
    write(out / CVAT_LABELS, cvat.constructor(classes))
    tasks = (
        label_studio.Task(row.file, labels, 1 - row.uncertainty)
        for row, (_, labels) in zip(chosen, _labelled(chosen, classes), strict=True)
    )
    write(out / STUDIO, label_studio.tasks(tasks, classes, f"sdr-jax {model.digest[:8]}"))
    write(out / STUDIO_LABELS, label_studio.interface(classes))
    write(out / RANKING, table.getvalue())  # last, since it marks the others as done


def _labelled(
    ranked: Sequence[Ranked], classes: Sequence[LabelClass]
) -> Iterator[tuple[str, np.ndarray]]:
    """Names, and indices of classes u8[h, w] from the label images of ids."""
    class_of = np.full(2**16, IGNORE_LABEL, np.uint8)
    class_of[[row.id for row in classes]] = np.arange(len(classes))
    for image in ranked:
        data = np.frombuffer(read_bytes(image.labels), np.uint8)
        ids = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
        if ids is None or ids.ndim != 2:
            raise UserError(f"{image.labels} is damaged; remove it, and run the same command again")
        yield image.name, class_of[ids]
