"""Datasets on disk in the layout of Cityscapes."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np

from scene.classes import LABEL_IDS, VOID, colorize
from scene.dataset import Dataset


def write_cityscapes(dataset: Dataset, folder: Path, *, shots: int, city: str = "scenex") -> None:
    """Write images and labels as a ``train`` split of Cityscapes.

    ``leftImg8bit/train/<city>/<city>_<street>_<shot>_leftImg8bit.png`` with
    ``gtFine/train/<city>/..._gtFine_labelIds.png`` and ``..._color.png``. The folder appears whole or
    not at all, and replaces an earlier one.

    Raises:
        OSError: the disk is full or read-only, with the file's name; nothing is left behind.
    """
    part = folder.with_name(folder.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    label_ids = np.zeros(256, np.uint8)
    label_ids[: len(LABEL_IDS)] = LABEL_IDS
    label_ids[VOID] = 0
    images = part / "leftImg8bit" / "train" / city
    labels = part / "gtFine" / "train" / city
    try:
        images.mkdir(parents=True)
        labels.mkdir(parents=True)
        for k, (image, label) in enumerate(zip(dataset.images, dataset.labels, strict=True)):
            stem = f"{city}_{k // shots:06d}_{k % shots:06d}"
            _write(images / f"{stem}_leftImg8bit.png", image[..., ::-1])
            _write(labels / f"{stem}_gtFine_labelIds.png", label_ids[label])
            _write(labels / f"{stem}_gtFine_color.png", colorize(label)[..., ::-1])
        shutil.rmtree(folder, ignore_errors=True)
        part.rename(folder)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


def _write(path: Path, image: np.ndarray) -> None:
    """One PNG; OpenCV only encodes, since its own writer hides why a disk refused."""
    done, data = cv2.imencode(".png", image)
    if not done:
        raise OSError(f"cannot encode {path}")
    try:
        path.write_bytes(data.tobytes())
    except OSError as error:  # a full disk tells no name
        raise OSError(error.errno, error.strerror, str(path)) from error
