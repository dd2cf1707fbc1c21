"""Convert the arrays of a shot to those of PNG files, and back.

Encodings that Cityscapes does not define:

- ``depth``, u16: centimetres along the optical axis, 0 for the sky; 65535 is 655.35 m or more.
- ``normals``, u8 RGB: ``round(127.5 (n + 1))`` of the unit normal in the camera's frame, x right, y up,
  z towards the camera; black for the sky.
- ``panoptic``, u8 RGB: segment id = R + 256 G + 256^2 B.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from scene.dataset.formats.labels import Labels

if TYPE_CHECKING:  # reading datasets does not load the engine
    from scene.render.protocol import Frame, RenderSettings
    from scene.street.camera import Camera

DEPTH_PER_METRE = 100
BASELINE = 0.209313
"""Metres between the cameras of Cityscapes, for disparity from depth."""
DISPARITY_SCALE = 256
"""Disparity of Cityscapes: pixels = (value - 1) / 256, and 0 for none."""
DEEPEST = 65535


def focal_length(settings: RenderSettings) -> float:
    """Focal length in pixels, the same in x and y."""
    return settings.width / 2 / math.tan(math.radians(settings.fov) / 2)


def principal_point(camera: Camera, settings: RenderSettings) -> tuple[float, float]:
    """Column and row of the principal point; the centre of the first pixel is (0, 0)."""
    right, below = camera.offset
    return (
        (settings.width - 1) / 2 + settings.width * right,
        (settings.height - 1) / 2 + settings.width * below,
    )


def depth_plane(depth: np.ndarray) -> np.ndarray:
    """Depth f32[h, w] in metres as u16[h, w] in centimetres; only the sky is 0."""
    values = np.clip(np.rint(depth * DEPTH_PER_METRE), 1, DEEPEST)
    return np.where(depth > 0, values, 0).astype(np.uint16)


def disparity_plane(depth: np.ndarray, settings: RenderSettings) -> np.ndarray:
    """Depth f32[h, w] in metres as disparity u16[h, w] of Cityscapes, at most 256 pixels."""
    product = BASELINE * focal_length(settings) * DISPARITY_SCALE
    pixels = product / np.where(depth > 0, depth, 1)
    return np.where(depth > 0, np.clip(np.rint(pixels) + 1, 1, DEEPEST), 0).astype(np.uint16)


def normals_plane(normal: np.ndarray) -> np.ndarray:
    """Unit normals f32[h, w, 3] as u8[h, w, 3], zero for the sky."""
    plane = np.rint(127.5 * normal + 127.5).astype(np.uint8)
    x, y, z = np.moveaxis(normal, 2, 0)
    plane[(x == 0) & (y == 0) & (z == 0)] = 0
    return plane


def normals_of(plane: np.ndarray) -> np.ndarray:
    """Normals f32[h, w, 3] from their image, of length 1 up to rounding; zero for the sky."""
    has_normal = plane.any(axis=2, keepdims=True)
    return np.where(has_normal, plane / np.float32(127.5) - 1, 0).astype(np.float32)


def panoptic_plane(ids: np.ndarray) -> np.ndarray:
    """Segment ids as u8[h, w, 3]."""
    return np.stack([ids & 255, ids >> 8 & 255, ids >> 16 & 255], axis=2).astype(np.uint8)


def ids_of(plane: np.ndarray) -> np.ndarray:
    """Segment ids i32[h, w] from their image."""
    return plane.astype(np.int32) @ np.array([1, 256, 65536], np.int32)


def label_planes(train_ids: np.ndarray, labels: Labels) -> dict[str, np.ndarray]:
    """Label images from train ids u8[h, w]: values of label files, class indices and colours."""
    classes = labels.of_engine.take(train_ids)
    return {
        "label_ids": labels.values.take(classes, axis=0),
        "train_ids": classes,
        "color": labels.colours.take(classes, axis=0),
    }


PLANES: dict[str, Callable[["Frame", np.ndarray, "RenderSettings"], np.ndarray]] = {
    "image": lambda frame, ids, settings: frame.image,
    "instance_ids": lambda frame, ids, settings: ids.astype(np.uint16),
    "panoptic": lambda frame, ids, settings: panoptic_plane(ids),
    "depth": lambda frame, ids, settings: depth_plane(frame.depth),
    "disparity": lambda frame, ids, settings: disparity_plane(frame.depth, settings),
    "normals": lambda frame, ids, settings: normals_plane(frame.normal),
}
"""Kind -> array from (frame, segment ids, settings); `label_planes` makes those of classes."""
