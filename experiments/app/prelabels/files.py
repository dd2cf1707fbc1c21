"""The files of `sdr-jax predict --rank` beside label pictures: the order, and files for annotation tools."""

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
    """An image of the order."""

    name: str  # of its results, without suffix
    file: str  # its path below the parent of the images' folder
    uncertainty: float  # in [0, 1], 0 for certainty in all pixels
    labels: Path  # its PNG of ids


def write_files(out: Path, ranked: Sequence[Ranked], first: int, model: Model) -> None:
    """Write the order of all images, and pre-labels of the first ones.

    Args:
        out: the folder.
        ranked: the images in the order of labelling.
        first: number of images with pre-labels in the tools' files.
        model: the model that made the labels.

    Raises:
        UserError: a label picture is damaged.
        OSError: a file cannot be written; the error names it.
    """
    classes, some = model.classes, ranked[:first]
    rows = ((k, printable(own.file), f"{own.uncertainty:.6f}") for k, own in enumerate(ranked, 1))
    table = io.StringIO()
    csv.writer(table, lineterminator="\n").writerows([("rank", "image", "uncertainty"), *rows])
    write(out / CVAT, cvat.archive(_labelled(some, classes), classes))
    write(out / CVAT_LABELS, cvat.constructor(classes))
    tasks = (
        label_studio.Task(own.file, labels, 1 - own.uncertainty)
        for own, (_, labels) in zip(some, _labelled(some, classes), strict=True)
    )
    write(out / STUDIO, label_studio.tasks(tasks, classes, f"sdr-jax {model.digest[:8]}"))
    write(out / STUDIO_LABELS, label_studio.interface(classes))
    write(out / RANKING, table.getvalue())  # last, since it marks the others as done


def _labelled(
    ranked: Sequence[Ranked], classes: Sequence[LabelClass]
) -> Iterator[tuple[str, np.ndarray]]:
    """Names, and indices of classes u8[h, w] from the pictures of ids."""
    place = np.full(2**16, IGNORE_LABEL, np.uint8)
    place[[own.id for own in classes]] = np.arange(len(classes))
    for own in ranked:
        data = np.frombuffer(read_bytes(own.labels), np.uint8)
        ids = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
        if ids is None or ids.ndim != 2:
            raise UserError(
                f"{own.labels} is damaged; remove it, and the same command makes it again"
            )
        yield own.name, place[ids]
