"""Real images to compare the street with."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from common.errors import UserError

WIDEST = 960
"""Pixels of width; wider photographs are reduced before they are sent to the page."""


def listed(folder: Path | None) -> tuple[Path, ...]:
    """The images in a folder and its subfolders, sorted; none without a folder.

    Raises:
        UserError: there is no such folder, or no image or video in it.
    """
    if folder is None:
        return ()
    if not folder.is_dir():
        raise UserError(f"--real {folder} is not a folder; pass a folder of images")
    from seg.data.frames import list_sources  # imports JAX

    return tuple(source.path for source in list_sources(folder) if not source.video)


def photograph(path: Path) -> bytes:
    """One image as JPEG, at most ``WIDEST`` pixels wide.

    Raises:
        DataError: the file is missing or broken.
    """
    from seg.data.images import read_image
    from seg.data.labelled import resize_image

    image = read_image(path)
    height, width = image.shape[:2]
    if width > WIDEST:
        image = resize_image(image, (max(height * WIDEST // width, 1), WIDEST))
    data: np.ndarray = cv2.imencode(".jpg", image[..., ::-1])[1]
    return data.tobytes()
