"""The files of one shot, and its record, from which summary files are made."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from scene.classes import OWN, VOID
from scene.dataset.formats import png
from scene.dataset.formats.labels import Labels
from scene.dataset.formats.layout import Layout
from scene.dataset.formats.planes import (
    BASELINE,
    PLANES,
    focal_length,
    label_planes,
    principal_point,
)
from scene.dataset.formats.rle import Runs, encode
from scene.dataset.formats.segments import PER_CLASS, Segment, panoptic_ids, segments
from scene.dataset.formats.yolo import object_lines
from scene.ground.path import Path, height_at, nearest, road_axes
from scene.render.protocol import Frame, RenderSettings, seen_through
from scene.street.camera import Camera, camera_axes


def shot_files(
    frame: Frame,
    path: Path,
    settings: RenderSettings,
    layout: Layout,
    labels: Labels,
) -> tuple[dict[str, bytes], dict[str, Any]]:
    """Make all files of one shot, and its record.

    Args:
        frame: the rendered frame.
        path: path of the road.
        settings: size and field of view.
        layout: the layout of the files.
        labels: the classes of label images.

    Returns:
        Kind -> content of the file; and the record of the image as JSON values: pixels of each class, sums of
        red, green and blue, the segments, and whether the shot was retaken.
    """
    camera = frame.camera
    settings = seen_through(camera, settings)
    ids = panoptic_ids(frame.label, frame.instance)
    of_classes = label_planes(frame.label, labels)
    files: dict[str, bytes] = {}
    for kind in layout.files:
        if kind == "camera":
            files[kind] = json.dumps(camera_entry(camera, path, settings), indent=1).encode()
        elif kind == "objects":
            files[kind] = object_lines(ids, labels).encode()
        elif kind in of_classes:
            files[kind] = png.encode(of_classes[kind])
        else:
            files[kind] = png.encode(PLANES[kind](frame, ids, settings))
    record = image_record(frame.image, frame.label, ids)
    record |= {"retaken": camera.retaken, "refused": camera.refused}
    if "semantic" in layout.summaries:
        record["classes"] = class_masks(of_classes["train_ids"], labels)
    return files, record


def image_record(image: np.ndarray, label: np.ndarray, ids: np.ndarray) -> dict[str, Any]:
    """The record of one image u8[h, w, 3] with train ids u8[h, w] and segment ids i32[h, w]."""
    runs = Runs(ids)
    entries = []
    for segment in segments(ids):
        entry = _entry(segment, segment.label_id)
        if segment.id >= PER_CLASS:
            entry["rle"] = encode(runs.counts(segment.id))
        entries.append(entry)
    return {
        "pixels": np.bincount(label.ravel(), minlength=VOID + 1)[: OWN + 1].tolist(),
        "rgb": [int(image[..., channel].sum(dtype=np.int64)) for channel in range(3)],
        "segments": entries,
    }


def class_masks(classes: np.ndarray, labels: Labels) -> list[dict[str, Any]]:
    """Category, area, box and mask of each class in u8[h, w]."""
    ids = np.where(classes == VOID, 0, classes.astype(np.int32) + 1)
    runs, categories = Runs(ids), labels.category_ids
    return [
        {**_entry(segment, categories[segment.id - 1]), "rle": encode(runs.counts(segment.id))}
        for segment in segments(ids)
    ]


def _entry(segment: Segment, category: int) -> dict[str, Any]:
    return {
        "id": segment.id,
        "category_id": category,
        "area": segment.area,
        "bbox": list(segment.box),
    }


def camera_entry(camera: Camera, path: Path, settings: RenderSettings) -> dict[str, Any]:
    """The entry of a camera as in Cityscapes: pixels, metres and radians; pixel centres are integers.

    The extrinsics give the camera's position on its car: x ahead, y left, z up from the road. Its axes in the
    car's frame are the columns of Rz(yaw) Ry(pitch) Rx(roll): yaw is left positive, pitch down positive, roll
    clockwise. The car itself is not modelled: its frame follows the direction and slope of the road, with its
    origin on the road below the camera, so x and y are 0 (in Cityscapes it is below the rear axle).

    Args:
        camera: camera of the shot.
        path: path of the road.
        settings: size and field of view.

    Source: ``docs/csCalibration.pdf`` and ``helpers/box3dImageTransform.py`` of cityscapesScripts; the
    vehicle's frame is that of ISO 8855.
    """
    at, _ = nearest(path, np.array([camera.position[:2]]))
    height = camera.position[2] - height_at(path, at[0])
    car = road_axes(path, at[0])
    right, up, forward = camera_axes(camera)
    u0, v0 = principal_point(camera, settings)
    turn = car @ np.stack([forward, -right, up], axis=1)
    return {
        "extrinsic": {
            "baseline": BASELINE,
            "pitch": -math.asin(turn[2, 0]),
            "roll": math.atan2(turn[2, 1], turn[2, 2]),
            "x": 0.0,
            "y": 0.0,
            "yaw": math.atan2(turn[1, 0], turn[0, 0]),
            "z": float(height * car[2, 2]),  # perpendicular to the slope
        },
        "intrinsic": {
            "fx": focal_length(settings),
            "fy": focal_length(settings),
            "u0": u0,
            "v0": v0,
        },
    }
