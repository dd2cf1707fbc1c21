"""Pages from images: captions, grids, and frames with their label and depth."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from common import files
from scene.assets.catalogue import AssetPool
from scene.classes import colorize
from scene.render import Frame, RenderSettings, renderer
from scene.street.street import Street

FAR = 80.0
"""Metres at which the depth image is black."""
CAPTION = 15
"""Height of a caption, pixels."""
PAPER, INK = (255, 255, 255), (20, 20, 20)
JPEG = (cv2.IMWRITE_JPEG_QUALITY, 75, cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_OPTIMIZE, 1)
"""Options that keep a page small."""
FONT, FONT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.36


class Studio(NamedTuple):
    """Settings with which the images of a page are rendered."""

    settings: RenderSettings
    renderer: str = "embree"
    pool: AssetPool = AssetPool()

    def shoot(self, street: Street) -> np.ndarray:
        """The image u8[h, w, 3] of a street's first camera."""
        return renderer(self.renderer).render(street, self.settings)[0].image


def tile(frame: Frame) -> np.ndarray:
    """Image, label and depth of one frame, one below the other, u8[3 h, w, 3] RGB."""
    return np.concatenate([frame.image, colorize(frame.label), depth_image(frame.depth)])


def depth_image(metres: np.ndarray) -> np.ndarray:
    """Depth f32[h, w] in metres as u8[h, w, 3]: near is bright; the sky, which has depth 0, is black."""
    near = np.where(metres > 0, 1 - np.clip(metres / FAR, 0, 1), 0)
    return np.repeat((255 * near[..., None]).astype(np.uint8), 3, axis=2)


def captioned(image: np.ndarray, text: str) -> np.ndarray:
    """Put a line of text above an image u8[h, w, 3]; it is cut where the image ends."""
    bar = np.full((CAPTION, image.shape[1], 3), PAPER, np.uint8)
    cv2.putText(bar, text, (3, CAPTION - 4), FONT, FONT_SCALE, INK, 1, cv2.LINE_AA)
    return np.concatenate([bar, image])


def grid(images: Sequence[np.ndarray], columns: int) -> np.ndarray:
    """Arrange images of one size in rows of ``columns``; the last row is padded with white."""
    blank = np.full_like(images[0], 255)
    rows = zip_longest(*[iter(images)] * columns, fillvalue=blank)
    return np.concatenate([np.concatenate(row, axis=1) for row in rows])


def stack(rows: Sequence[np.ndarray]) -> np.ndarray:
    """Stack images of any width, padded with white on the right."""
    width = max(row.shape[1] for row in rows)
    padded = [
        np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0)), constant_values=255)
        for row in rows
    ]
    return np.concatenate(padded)


def save(image: np.ndarray, path: Path) -> None:
    """Write an image u8[h, w, 3] RGB in the format of the file's name.

    Raises:
        ValueError: the image is too large for the format.
        OSError: it cannot be written; the error names it.
    """
    suffix = path.suffix.lower()
    try:
        done, data = cv2.imencode(suffix, image[..., ::-1], () if suffix == ".png" else JPEG)
    except cv2.error:  # OpenCV 4; version 5 returns False
        done = False
    if not done:
        height, width = image.shape[:2]
        raise ValueError(f"{path}: {width}x{height} pixels are too many for {suffix}")
    files.write(path, data.tobytes())
