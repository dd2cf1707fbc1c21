"""Ultralytics' format of segmentation: one polygon for the outline of each thing.

A line of ``labels/<split>/<stem>.txt`` is a class and the corners of an outline, x and y as shares of width
and height. The outline follows pixel edges, so that it encloses the area of the pixels. It is inset by
`INSET`, so that programs that truncate corners to whole pixels and fill the polygon with its edges get the
mask. Lines of no width join pieces and holes of one object, as in Ultralytics' converter. Source:
docs.ultralytics.com/datasets/segment.
"""

from __future__ import annotations

import json
from collections.abc import Iterator

import cv2
import numpy as np
from scipy.spatial import cKDTree

from scene.dataset.formats.about import About
from scene.dataset.formats.labels import Labels
from scene.dataset.formats.segments import PER_CLASS, TRAIN_OF_LABEL, segments

INSET = 0.004
"""Inset in pixels, by which a single pixel loses 1.6 % of its area."""
DIGITS = 7
"""Digits of the shares: a thousandth of a pixel at all sizes."""


def object_lines(ids: np.ndarray, labels: Labels) -> str:
    """The file of one image from its segment ids i32[h, w]."""
    number = {class_id: k for k, class_id in enumerate(labels.things)}
    size = np.array(ids.shape[::-1], float)
    lines = []
    for segment in segments(ids):
        class_id = int(labels.of_engine[TRAIN_OF_LABEL[segment.label_id]])
        if segment.id < PER_CLASS or class_id not in number:
            continue
        x, y, width, height = segment.box
        corners = outline(ids[y : y + height, x : x + width] == segment.id) + (x, y)
        shares = " ".join(f"{share:.{DIGITS}f}" for share in (corners / size).ravel())
        lines.append(f"{number[class_id]} {shares}\n")
    return "".join(lines)


def outline(mask: np.ndarray) -> np.ndarray:
    """One closed polygon f64[corners, 2] around all of bool[h, w], in pixels from its upper left corner."""
    # At twice the size, each corner of a pixel is a pixel of its own, which shows its side.
    double = mask.astype(np.uint8).repeat(2, axis=0).repeat(2, axis=1)
    contours, _ = cv2.findContours(double, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    rings = [ring[:, 0] // 2 + np.where(ring[:, 0] % 2, 1 - INSET, INSET) for ring in contours]
    rings.sort(key=lambda ring: abs(area(ring)))
    corners = np.concatenate(rings)
    ring_of = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    added = np.flatnonzero(ring_of == len(rings) - 1)
    polygon = added.tolist()
    left = np.flatnonzero(ring_of < len(rings) - 1)
    gaps, joints = np.full(len(corners), np.inf), np.zeros(len(corners), int)
    while len(left):
        # The nearest ring first, since its line is the shortest.
        distances, nearest = cKDTree(corners[added]).query(corners[left])
        nearer = distances < gaps[left]
        gaps[left[nearer]], joints[left[nearer]] = distances[nearer], added[nearest[nearer]]
        start = left[np.argmin(gaps[left])]
        ring = np.flatnonzero(ring_of == ring_of[start])
        added = np.roll(ring, ring[0] - start)
        joint = polygon.index(joints[start])
        polygon[joint + 1 : joint + 1] = [*added, start, joints[start]]
        left = left[ring_of[left] != ring_of[start]]
    return corners[polygon]


def area(corners: np.ndarray) -> float:
    """Area of a polygon [corners, 2] in square pixels; negative for the other orientation."""
    x, y = corners.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def names(about: About) -> Iterator[str]:
    """Yield ``data.yaml``: the folders of images, and the names of the classes."""
    things = [about.labels.names[k] for k in about.labels.things]
    # Both keys are required; there is one split.
    yield f"train: images/{about.split}\nval: images/{about.split}\nnc: {len(things)}\nnames:\n"
    for k, name in enumerate(things):
        yield f"  {k}: {json.dumps(name, ensure_ascii=False)}\n"
