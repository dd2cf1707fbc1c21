"""Read real images for comparison with a dataset: CamVid, or the layout of Cityscapes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from common.errors import UserError
from common.files import check_folder, read_bytes
from common.labels.target_file import shipped
from common.pictures import MOST_BYTES, label_ids, too_large
from scene.classes import CLASS_NAMES, VOID
from scene.dataset.formats.segments import TRAIN_OF_LABEL
from scene.dataset.read import DESCRIPTION, describe, images_and_classes

CAMVID: tuple[str, ...] = shipped("camvid").class_names
"""The 11 classes of CamVid that are common in the literature."""
CAMVID_OF_TRAIN = np.full(256, VOID, np.uint8)
"""u8[256]: train id -> CamVid's class; trains are ignored there."""
CAMVID_OF_TRAIN[: len(CLASS_NAMES)] = shipped("camvid").of_engine


class ImageSet(NamedTuple):
    """Images u8[h, w, 3] with labels u8[h, w], and the class names; ``VOID`` is ignored."""

    classes: tuple[str, ...]
    pairs: Iterator[tuple[np.ndarray, np.ndarray]]
    framing: tuple[float, float] | None = None  # for a dataset, see ``Described.framing``


def open_images(folder: Path, prefixes: tuple[str, ...] = ()) -> ImageSet:
    """Open the images of an exported dataset, of CamVid (SegNet's layout) or of a folder like Cityscapes.

    Args:
        folder: the folder.
        prefixes: use only real images whose file names start with one of these; by default all.

    Raises:
        ValueError: it is none of these, or a file is damaged.
    """
    check_folder(folder, "one with images")
    if (folder / DESCRIPTION).is_file():
        if prefixes:
            raise ValueError(
                f"{folder}: --only is for real images, but these are rendered; leave it out"
            )
        dataset = describe(folder)
        return ImageSet(dataset.labels.names, images_and_classes(dataset), dataset.framing)
    if (folder / "train").is_dir() and (folder / "trainannot").is_dir():
        pattern, tail, labels, ending = "train/*.[jp][pn]g", "", "trainannot", ""
        classes, legal = CAMVID, np.arange(256, dtype=np.uint8)
        legal[len(CAMVID) :] = VOID
    elif (folder / "leftImg8bit").is_dir():
        pattern, tail = "leftImg8bit/*/*/*_leftImg8bit.png", "_leftImg8bit"
        labels, ending = "gtFine", "_gtFine_labelIds"
        classes, legal = CLASS_NAMES, TRAIN_OF_LABEL
    else:
        raise ValueError(
            f"{folder}: expected {DESCRIPTION}, train/ with trainannot/ (CamVid), or leftImg8bit/"
        )
    images = [p for p in sorted(folder.glob(pattern)) if p.name.startswith(prefixes or "")]
    if not images:
        called = f" called {', '.join(prefixes)}" if prefixes else ""
        raise ValueError(f"{folder}: no images{called}")

    def label_of(image: Path) -> Path:
        below = image.parent.relative_to(folder).parts[1:]
        return folder.joinpath(labels, *below, f"{image.stem.removesuffix(tail)}{ending}.png")

    return ImageSet(classes, (_read(image, label_of(image), legal) for image in images))


def _read(image_path: Path, label_path: Path, legal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    image = cv2.imdecode(np.frombuffer(_bytes(image_path) or b"-", np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError(f"{image_path} cannot be decoded")
    try:
        ids = label_ids(_bytes(label_path))
    except UserError as error:
        raise ValueError(f"{label_path}: {error}") from None
    if image.shape[:2] != ids.shape:
        raise ValueError(f"{label_path} and {image_path} differ in size")
    for value in (ids.min(), ids.max()):
        if not 0 <= value <= 255:
            raise ValueError(f"{label_path}: label value {value}; expected 0..255")
    return image[..., ::-1], legal[ids]


def _bytes(path: Path) -> bytes:
    data = read_bytes(path, MOST_BYTES)
    why = too_large(data)
    if why is not None:
        raise ValueError(f"{path}: {why}")
    return data
