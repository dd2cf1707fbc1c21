"""Photographs without labels, for a reward from feature distances."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from common.files import IMAGES, files_below
from seg.data.images import read_image
from seg.data.labelled import cut, resize_image
from seg.errors import DataError


def list_unlabelled(root: str | Path) -> tuple[Path, ...]:
    """List the image files in a folder and its sub-folders, sorted by path, without reading them.

    Raises:
        DataError: there is no such folder, or it has no images.
    """
    root = Path(root)
    if not root.is_dir():
        raise DataError(f"{root}: no such folder; expected one with images")
    paths = tuple(p for p in files_below(root) if p.suffix.lower() in IMAGES)
    if not paths:
        raise DataError(f"{root}: no images; expected {', '.join(IMAGES)}")
    return paths


def load_unlabelled(
    paths: Sequence[Path], size: tuple[int, int]
) -> UInt8[np.ndarray, "n height width 3"]:
    """Read images as RGB, cropped around the centre to the aspect ratio of (height, width) and resized.

    Raises:
        DataError: a file is missing, broken or not an image.
    """
    aspect = size[1] / size[0]
    return np.stack([resize_image(cut(read_image(path), aspect), size) for path in paths])
