"""Labelled images in memory, and the loading of them from a list of files."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8

from seg.classes import ClassTable
from seg.data.images import read_image, read_label
from seg.errors import DataError

if TYPE_CHECKING:  # the nets load JAX
    from seg.nets.lite0 import Pyramid


class Entry(NamedTuple):
    """One labelled image on disk."""

    name: str  # file name without folder and extension, unique within a split
    sequence: str  # the drive it was taken on: consecutive frames are nearly the same image
    image_path: Path
    label_path: Path


class LabelledImages(NamedTuple):
    """Images of one size with their labels."""

    images: UInt8[np.ndarray, "n h w 3"]  # RGB
    labels: UInt8[np.ndarray, "n h w"]  # ids of a class table, 255 void
    names: tuple[str, ...] = ()  # of each image, where they are known
    sequences: tuple[str, ...] = ()  # of each image, where they are known
    features: Pyramid | None = None
    """Features of a frozen trunk, if they are known: one row per image for testing, those of all views of
    the images for training, view after view."""

    def between(self, first: int, end: int) -> LabelledImages:
        """The images from the first up to the end, with one row of features each; nothing is copied."""
        maps = self.features and type(self.features)(*(own[first:end] for own in self.features))
        names, sequences = self.names[first:end], self.sequences[first:end]
        return LabelledImages(
            self.images[first:end], self.labels[first:end], names, sequences, maps
        )

    def take(self, indices: Sequence[int] | np.ndarray) -> LabelledImages:
        """A copy of some of the images, with the features of all their views."""
        picked, count = np.asarray(indices, np.int64), len(self.images)
        names, sequences = (
            tuple(column[k] for k in picked) if column else ()
            for column in (self.names, self.sequences)
        )
        maps = self.features
        if maps is not None:
            views = np.arange(0, len(maps.eighth), count)[:, None]  # rows where they begin
            maps = type(maps)(*(own[(views + picked).ravel()] for own in maps))
        return LabelledImages(self.images[picked], self.labels[picked], names, sequences, maps)


def subset(entries: Sequence[Entry], limit: int | None, seed: int = 0) -> tuple[Entry, ...]:
    """Pick a random subset, the same for the same seed, in the order of the list.

    Args:
        entries: the whole split.
        limit: how many to keep; None, or more than there are, keeps all.
        seed: of the choice.

    Raises:
        ValueError: limit is less than 1.
    """
    if limit is not None and limit < 1:
        raise ValueError(f"limit must be at least 1, or None for all images; got {limit}")
    if limit is None or limit >= len(entries):
        return tuple(entries)
    kept = np.random.default_rng(seed).choice(len(entries), limit, replace=False)
    return tuple(entries[index] for index in np.sort(kept))


def resize_image(
    image: UInt8[np.ndarray, "_h _w 3"], size: tuple[int, int]
) -> UInt8[np.ndarray, "_height _width 3"]:
    """Resize an image to (height, width): by area averages where it shrinks, else bilinearly."""
    height, width = size
    if image.shape[:2] == size:
        return image
    shrinks = height <= image.shape[0] and width <= image.shape[1]
    kind = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return cv2.resize(image, (width, height), interpolation=kind)


def cut(pixels: np.ndarray, aspect: float) -> np.ndarray:
    """The largest part around the centre that is so many times as wide as high, to the nearest pixel.

    Args:
        pixels: [h, w, ...], of an image or of its labels.
        aspect: width over height.
    """
    height, width = pixels.shape[:2]
    rows = min(height, max(round(width / aspect), 1))
    columns = min(width, max(round(height * aspect), 1))
    top, left = (height - rows) // 2, (width - columns) // 2
    return pixels[top : top + rows, left : left + columns]


LabelReader = Callable[[Path, ClassTable], np.ndarray]
"""From a label file and the table of its data set to ids u8[h, w] of the table."""


def _load_one(
    entry: Entry,
    table: ClassTable,
    size: tuple[int, int] | None,
    read: LabelReader,
    aspect: float | None,
) -> tuple[np.ndarray, np.ndarray]:
    image = read_image(entry.image_path)
    label = read(entry.label_path, table)
    if image.shape[:2] != label.shape:
        raise DataError(
            f"{entry.label_path}: {label.shape[1]}x{label.shape[0]} pixels, but its image "
            f"{entry.image_path} has {image.shape[1]}x{image.shape[0]}; both must agree"
        )
    if aspect is not None:
        image, label = cut(image, aspect), cut(label, aspect)
    if size is None or label.shape == size:
        return image, label
    height, width = size
    # The exact variant samples at pixel centres; plain nearest shifts labels against the image.
    label = cv2.resize(label, (width, height), interpolation=cv2.INTER_NEAREST_EXACT)
    return resize_image(image, size), label


def load(
    entries: Sequence[Entry],
    table: ClassTable,
    size: tuple[int, int] | None = None,
    read: LabelReader = read_label,
    aspect: float | None = None,
) -> LabelledImages:
    """Read images and labels; images are resized by area averages, labels by nearest pixel.

    Args:
        entries: from `list_camvid`, `list_cityscapes`, `subset`, or made by hand.
        table: of the data set the files belong to.
        size: (height, width) in pixels; None keeps the size on disk, which must then be one.
        read: of one label file.
        aspect: width over height to which images are cut around their centre first; None takes all of them.

    Returns:
        The images, in the order of the entries.

    Raises:
        DataError: there is nothing to load, or a file is missing, broken, or not what it should be.
        ValueError: size is not positive.
    """
    if size is not None and (size[0] < 1 or size[1] < 1):
        raise ValueError(f"size must be a positive (height, width); got {size}")
    if not entries:
        raise DataError("zero images to load; expected at least one entry")
    with ThreadPoolExecutor(min(8, os.cpu_count() or 1)) as pool:
        pairs = list(pool.map(lambda entry: _load_one(entry, table, size, read, aspect), entries))
    first = pairs[0][1].shape
    for entry, (_, label) in zip(entries, pairs, strict=True):
        if label.shape != first:
            raise DataError(
                f"{entry.image_path}: {label.shape[1]}x{label.shape[0]} pixels where "
                f"{entries[0].image_path} has {first[1]}x{first[0]}; give a size to resize them all"
            )
    return LabelledImages(
        np.stack([image for image, _ in pairs]),
        np.stack([label for _, label in pairs]),
        names=tuple(entry.name for entry in entries),
        sequences=tuple(entry.sequence for entry in entries),
    )
