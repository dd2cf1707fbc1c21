"""Confusion matrices and predictions of tested networks.

The run folder has a file for each network, named by its evaluation; the store gives its row and seed. Stores
stay small, and a network that two rows share has one file.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np

from common.files import naming, write
from seg.metrics import mean_iou

FOLDER = "nets"
"""Folder of the files in the run folder."""
MOST = 128
"""The most images whose predictions are kept, spread evenly over all."""


class Predictions(NamedTuple):
    """The contents of a file."""

    confusion: np.ndarray  # i64[classes, classes], pixels; row: true class
    picked: np.ndarray | None = None  # i32[n], the images with predictions
    miou: np.ndarray | None = None  # f32[n], of each, in [0, 1]; NaN if all pixels are ignored
    predictions: np.ndarray | None = None  # u8[n, h, w]
    by_image: np.ndarray | None = None  # i32[images, classes, classes], of every tested image


def picked(images: int) -> np.ndarray:
    """Indices of at most ``MOST`` images, including the first and the last."""
    return np.unique(np.linspace(0, images - 1, min(MOST, images)).round().astype(np.int32))


def predictions_of(by_image: np.ndarray, predictions: np.ndarray | None = None) -> Predictions:
    """Make the contents of a network's file.

    Args:
        by_image: i64[n, classes, classes], the confusion matrix of every tested image.
        predictions: u8[n, h, w], if some of them are to be kept, too.
    """
    matrices = Predictions(by_image.sum(axis=0), by_image=by_image.astype(np.int32))
    if predictions is None:
        return matrices
    chosen = picked(len(by_image))
    miou = [mean_iou(matrix) if matrix.any() else np.nan for matrix in by_image[chosen]]
    return matrices._replace(
        picked=chosen, miou=np.array(miou, np.float32), predictions=predictions[chosen]
    )


def file_of(run: Path, key: str) -> Path:
    """The file of an evaluation in a run folder."""
    return run / FOLDER / f"{key[:16]}.npz"


def save(path: Path, contents: Predictions) -> None:
    """Write the file, whole or not at all."""
    arrays: dict[str, Any] = {k: v for k, v in contents._asdict().items() if v is not None}
    data = io.BytesIO()
    np.savez_compressed(data, **arrays)
    with naming(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
    write(path, data.getvalue())


def load(path: Path) -> Predictions | None:
    """Read the file; None if there is no readable one, such as for a network from ``--store``."""
    try:
        with np.load(io.BytesIO(path.read_bytes())) as arrays:
            return Predictions(
                **{name: arrays[name] for name in arrays.files if name in Predictions._fields}
            )
    except (OSError, ValueError, EOFError, TypeError, BadZipFile):
        return None
