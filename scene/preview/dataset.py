"""The contact sheet of an exported dataset: image, label and depth of some of its images."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from scene.dataset.formats.planes import DEPTH_PER_METRE
from scene.dataset.read import Described, describe, labels
from scene.preview.layout import depth_image, grid, save

SHEET = "index.jpg"
"""The contact sheet in a dataset's folder."""
IMAGES = 8
"""The most images of a sheet, evenly spread over the dataset."""
COLUMNS = 4
WIDTH = 320
"""Width of each image in pixels; a smaller dataset keeps its own."""
HIGHEST = 8
"""Largest height of an image, as a multiple of ``WIDTH``."""


def write_sheet(folder: Path) -> Path:
    """Write the contact sheet of a dataset into its folder, and return its path.

    Raises:
        ValueError, OSError: as `describe`; a file is damaged or missing, or the sheet cannot be written.
    """
    path = folder / SHEET
    save(sheet(describe(folder)), path)
    return path


def sheet(dataset: Described, images: int = IMAGES) -> np.ndarray:
    """Make the sheet u8[h, w, 3] RGB: images in rows, with labels and depth below if the format has them."""
    count = min(images, len(dataset.stems))
    selected = np.linspace(0, len(dataset.stems) - 1, count).round().astype(int)
    columns = [_column(dataset, dataset.stems[k]) for k in selected]
    return grid(columns, min(count, COLUMNS))


def _column(dataset: Described, stem: str) -> np.ndarray:
    files = dataset.layout.files
    tiles = [_small(dataset.array("image", stem), cv2.INTER_AREA)]
    if {"panoptic", "label_ids"} & set(files):
        colours = dataset.labels.colours[labels(dataset, stem)]
        tiles.append(_small(colours, cv2.INTER_NEAREST))
    if "depth" in files:
        metres = dataset.array("depth", stem) / np.float32(DEPTH_PER_METRE)
        tiles.append(_small(depth_image(metres), cv2.INTER_AREA))
    return np.concatenate(tiles)


def _small(image: np.ndarray, interpolation: int) -> np.ndarray:
    height, width = image.shape[:2]
    scale = min(WIDTH / width, HIGHEST * WIDTH / height, 1)
    if scale == 1:
        return image
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    return np.asarray(cv2.resize(image, size, interpolation=interpolation))
