"""Labelled images in memory, loaded from a list of files."""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import cv2
import numpy as np
from jaxtyping import Shaped, UInt8

from common.errors import UserError
from common.labels.listing import Entry, list_split, shared_groups, split_names
from common.labels.target_file import TRAIN, Fit, TargetFile, find_target
from seg.classes import IGNORE_LABEL, ClassTable, table_of
from seg.data.images import read_image
from seg.data.labels import LabelReader
from seg.errors import DataError

if TYPE_CHECKING:  # networks load JAX
    from seg.nets.head import Maps

Item = TypeVar("Item")


class LabelledImages(NamedTuple):
    """Images of one size with their labels."""

    images: UInt8[np.ndarray, "n h w 3"]  # RGB
    labels: UInt8[np.ndarray, "n h w"]  # ids of a class table, 255 ignored
    names: tuple[str, ...] = ()  # of each image, if known
    sequences: tuple[str, ...] = ()  # of each image, if known
    features: Maps | None = None
    """Features of a frozen backbone, if known: the rows of all views, view after view (`seg.views`)."""

    def between(self, first: int, end: int) -> LabelledImages:
        """The images first .. end - 1 with the features of all their views; no copy if there is one view."""
        if self.features is not None and len(self.features[0]) > len(self.images):
            return self.take(range(first, min(end, len(self.images))))
        maps = self.features and tuple(level[first:end] for level in self.features)
        names, sequences = self.names[first:end], self.sequences[first:end]
        return LabelledImages(
            self.images[first:end], self.labels[first:end], names, sequences, maps
        )

    def take(self, indices: Sequence[int] | np.ndarray) -> LabelledImages:
        """A copy of some images, by indices or a mask as in NumPy, with the features of all their views."""
        count, chosen = len(self.images), np.asarray(indices)
        rows = np.arange(count)[chosen if chosen.size else chosen.astype(np.int64)]
        names, sequences = (
            tuple(column[k] for k in rows) if column else ()
            for column in (self.names, self.sequences)
        )
        maps = self.features
        if maps is not None:
            views = np.arange(0, len(maps[0]), count)[:, None]  # first row of each view
            maps = tuple(level[(views + rows).ravel()] for level in maps)
        return LabelledImages(self.images[rows], self.labels[rows], names, sequences, maps)


def subset(entries: Sequence[Item], limit: int | None, seed: int = 0) -> tuple[Item, ...]:
    """Choose a random subset, the same for the same seed, in the order of the list.

    Args:
        entries: the whole split, or anything in order.
        limit: the number of images to keep; None, or a number above theirs, keeps all.
        seed: seed of the choice.

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
    image: Shaped[np.ndarray, "_h _w ..."], size: tuple[int, int]
) -> Shaped[np.ndarray, "_height _width ..."]:
    """Resize an image to (height, width): by area averages if it shrinks, otherwise bilinearly."""
    height, width = size
    if image.shape[:2] == size:
        return image
    shrinks = height <= image.shape[0] and width <= image.shape[1]
    kind = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return cv2.resize(image, (width, height), interpolation=kind)


def cut(pixels: np.ndarray, aspect: float) -> np.ndarray:
    """Crop to the largest part around the centre with an aspect ratio, to the nearest pixel.

    Args:
        pixels: [h, w, ...], an image or its labels.
        aspect: width over height.
    """
    height, width = pixels.shape[:2]
    rows = min(height, max(round(width / aspect), 1))
    columns = min(width, max(round(height * aspect), 1))
    top, left = (height - rows) // 2, (width - columns) // 2
    return pixels[top : top + rows, left : left + columns]


def fitted(
    image: UInt8[np.ndarray, "_h _w 3"], size: tuple[int, int]
) -> tuple[UInt8[np.ndarray, "_height _width 3"], tuple[int, int]]:
    """Resize an image to fit a size with its aspect ratio; return also the rows and columns that it fills.

    The image touches the top and the left. Its last column or row is repeated in the margin, where networks
    make fewer errors than with a plain colour.

    Args:
        image: RGB.
        size: (height, width).
    """
    scale = min(new / old for new, old in zip(size, image.shape[:2], strict=True))
    rows, columns = (
        min(max(round(old * scale), 1), new) for old, new in zip(image.shape[:2], size, strict=True)
    )
    canvas = cv2.copyMakeBorder(
        resize_image(image, (rows, columns)),
        *(0, size[0] - rows, 0, size[1] - columns),
        cv2.BORDER_REPLICATE,
    )
    return canvas, (rows, columns)


def _fit(
    image: np.ndarray, label: np.ndarray, size: tuple[int, int], fit: Fit
) -> tuple[np.ndarray, np.ndarray]:
    """Bring an image and its label to a size (height, width) with their aspect ratio."""
    if fit == "cut":
        image, label = (cut(pixels, size[1] / size[0]) for pixels in (image, label))
        return resize_image(image, size), _resize_label(label, size)
    image, inner = fitted(image, size)
    padded = np.full(size, IGNORE_LABEL, np.uint8)
    padded[: inner[0], : inner[1]] = _resize_label(label, inner)
    return image, padded


def _resize_label(label: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    if label.shape == size:
        return label
    # The exact variant samples at pixel centres; plain nearest shifts labels against the image.
    return cv2.resize(label, (size[1], size[0]), interpolation=cv2.INTER_NEAREST_EXACT)


def read_entry(
    entry: Entry, reader: LabelReader
) -> tuple[UInt8[np.ndarray, "_h _w 3"], UInt8[np.ndarray, "_h _w"], Counter[str]]:
    """Read an image and its label; values that no class names are ignored, and their pixels are counted.

    Raises:
        DataError: a file is missing, broken or of another kind, or the sizes differ.
    """
    image = read_image(entry.image_path)
    label, unknown = reader.read(entry.label_path, entry.image_path)
    if image.shape[:2] != label.shape:
        raise DataError(
            f"{entry.label_path}: {label.shape[1]}x{label.shape[0]} pixels, but its image "
            f"{entry.image_path} has {image.shape[1]}x{image.shape[0]}; resize one of them"
        )
    return image, label, unknown


def load(
    entries: Sequence[Entry],
    target: TargetFile,
    size: tuple[int, int] | None = None,
    fit: Fit | None = None,
) -> LabelledImages:
    """Read images and labels; images are resized by area averages, labels to the nearest pixel.

    Args:
        entries: from `list_split` or `subset`, or built by the caller.
        target: describes the label files.
        size: (height, width) in pixels; None keeps the size on disk, which must be the same for all.
        fit: how images of another aspect ratio are treated; by default as the target's file says.

    Returns:
        The images, in the order of the entries.

    Raises:
        DataError: there is nothing to load, or a file is missing, broken or of another kind.
        ValueError: size is not positive.
    """
    if size is not None and (size[0] < 1 or size[1] < 1):
        raise ValueError(f"size must be a positive (height, width); got {size}")
    if not entries:
        raise DataError("no images to load; expected at least one entry")
    reader = LabelReader(target)

    def load_one(entry: Entry) -> tuple[np.ndarray, np.ndarray, Counter[str]]:
        image, label, unknown = read_entry(entry, reader)
        if size is not None:
            image, label = _fit(image, label, size, fit or target.fit)
        return image, label, unknown

    with ThreadPoolExecutor(min(8, os.cpu_count() or 1)) as pool:
        loaded = list(pool.map(load_one, entries))
    unknown = [
        (e.label_path, counts) for e, (_, _, counts) in zip(entries, loaded, strict=True) if counts
    ]
    if unknown:
        raise reader.error(unknown)
    first = loaded[0][1].shape
    for entry, (_, label, _) in zip(entries, loaded, strict=True):
        if label.shape != first:
            raise DataError(
                f"{entry.image_path}: {label.shape[1]}x{label.shape[0]} pixels where "
                f"{entries[0].image_path} has {first[1]}x{first[0]}; pass a size to resize them all"
            )
    return LabelledImages(
        np.stack([image for image, _, _ in loaded]),
        np.stack([label for _, label, _ in loaded]),
        names=tuple(entry.name for entry in entries),
        sequences=tuple(entry.sequence for entry in entries),
    )


def read_split(
    target: TargetFile | str,
    root: str | Path,
    split: str,
    size: tuple[int, int] | None = None,
    limit: int | None = None,
    seed: int = 0,
) -> LabelledImages:
    """Read a split of a target as ids of its classes: `list_split`, `subset` and `load` in one.

    Args:
        target: the target, or the name or path of its file.
        root: the data's folder.
        split: a split of the target's file or of the folder.
        size: (height, width) in pixels; None keeps the size on disk.
        limit: the number of images to keep; None keeps all.
        seed: seed of the choice.
    """
    target_file = find_target(target) if isinstance(target, str) else target
    return load(subset(list_split(target_file, root, split), limit, seed), target_file, size)


class TargetData(NamedTuple):
    """All labelled images of a target at one size."""

    splits: dict[str, LabelledImages]
    table: ClassTable
    notes: tuple[str, ...]  # warnings for a report


def read_target(
    target: TargetFile,
    root: str | Path,
    size: tuple[int, int],
    fit: Fit | None = None,
    splits: Sequence[str] = (),
) -> TargetData:
    """Read the splits of a target.

    Args:
        target: from `find_target`.
        root: the data's folder.
        size: (height, width) in pixels.
        fit: how images of another aspect ratio are treated; by default as the target's file says.
        splits: the splits to read; by default all.

    Raises:
        UserError: a file is wrong, or an image is in two splits.
    """
    names = tuple(splits) or split_names(target, Path(root)) or (TRAIN,)
    entries = {split: list_split(target, root, split) for split in names}
    images = {split: load(entries[split], target, size, fit) for split in names}
    refuse_shared(images)
    note = shared_groups(entries)
    return TargetData(images, table_of(target), (note,) if note else ())


def refuse_shared(sides: Mapping[str, LabelledImages]) -> None:
    """Raise UserError if two splits have an image with the same pixels; names may differ."""
    first_with: dict[bytes, tuple[str, str]] = {}
    shared: list[str] = []
    for side, labelled in sides.items():
        for k, image in enumerate(labelled.images):
            name = labelled.names[k] if labelled.names else f"image {k + 1}"
            key = hashlib.sha256(image.tobytes()).digest()
            first, other = first_with.setdefault(key, (side, name))
            if first != side:
                shared.append(f"{other} in {first} is {name} in {side}")
    if shared:
        raise UserError(
            f"images in two splits: {len(shared)}, such as {shared[0]}; keep each in one split"
        )
