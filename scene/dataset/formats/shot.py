"""One shot as files, and the record of it that the summaries of a dataset are made from."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from scene.classes import CLASS_NAMES, VOID
from scene.dataset.formats import png
from scene.dataset.formats.layout import Layout
from scene.dataset.formats.planes import PLANES, camera_entry
from scene.dataset.formats.rle import Runs, encode
from scene.dataset.formats.segments import PER_CLASS, panoptic_ids, segments
from scene.render.protocol import Frame, RenderSettings, seen_through
from scene.street.camera import Camera


def shot_files(
    frame: Frame, camera: Camera, settings: RenderSettings, layout: Layout
) -> tuple[dict[str, bytes], dict[str, Any]]:
    """All files of one shot, and its record.

    Args:
        frame: what was rendered.
        camera: where from.
        settings: size and field of view.
        layout: which files there are.

    Returns:
        Kind -> content of the file; and what is known of the image, as plain values: pixels of each
        class, sums of red, green and blue, and the segments.
    """
    settings = seen_through(camera, settings)
    ids = panoptic_ids(frame.label, frame.instance)
    files = {
        kind: json.dumps(camera_entry(camera, settings), indent=1).encode()
        if kind == "camera"
        else png.encode(PLANES[kind](frame, ids, settings))
        for kind in layout.files
    }
    return files, image_record(frame.image, frame.label, ids)


def image_record(image: np.ndarray, label: np.ndarray, ids: np.ndarray) -> dict[str, Any]:
    """What is known of one image u8[h, w, 3] with train ids u8[h, w] and segment ids i32[h, w]."""
    runs = Runs(ids)
    found = []
    for segment in segments(ids):
        entry: dict[str, Any] = {
            "id": segment.id,
            "category_id": segment.label_id,
            "area": segment.area,
            "bbox": list(segment.box),
        }
        if segment.id >= PER_CLASS:
            entry["rle"] = encode(runs.counts(segment.id))
        found.append(entry)
    return {
        "pixels": np.bincount(label.ravel(), minlength=VOID + 1)[: len(CLASS_NAMES)].tolist(),
        "rgb": [int(image[..., channel].sum(dtype=np.int64)) for channel in range(3)],
        "segments": found,
    }
