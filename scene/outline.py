"""Draw labels as annotators do: one outline around a tree, including the gaps where the sky shows through.

Rendered labels are exact to the pixel. An `Outline` closes such gaps of a class and drops its loose twigs;
every changed pixel gets class and instance of another pixel of the image. Gaps in front of a house stay open:
annotators label the house behind a bare tree (`benchmarks.outlines`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import cv2
import numpy as np

from common.labels.classes import Outline
from scene.classes import TrainId

if TYPE_CHECKING:
    from scene.render.protocol import Frame

LEAST = 12 / (240 * 176)
"""Connected parts of an outlined class with a smaller share of the image are loose twigs."""
RADIUS = 3
"""Wider kernels are composed of several of this radius in pixels, which takes a tenth of the time."""
SMALLEST = 3
"""The smallest width of a kernel in pixels."""


def outlined(frame: Frame, outlines: Sequence[Outline]) -> Frame:
    """The frame with classes and instances as annotators draw them; image, depth and normals stay."""
    if not outlines:
        return frame
    source = sources(frame.label, frame.depth, outlines)
    return frame._replace(label=frame.label.take(source), instance=frame.instance.take(source))


def sources(label: np.ndarray, depth: np.ndarray, outlines: Sequence[Outline]) -> np.ndarray:
    """The index i64[h, w] into the flat image from which every pixel takes its class.

    For each outline, the class is closed with an ellipse as wide as the outline; sky inside takes the class
    of the nearest pixel that had it. Connected parts that are still smaller than `LEAST` take the class of
    their deepest neighbour.

    Args:
        label: train ids u8[h, w].
        depth: f32[h, w] in metres, 0 for the sky.
        outlines: those of a target's classes (`common.labels.target_file`), applied one after another.
    """
    nearness = _inverse(depth)
    current, source = label, np.arange(label.size).reshape(label.shape)
    for train_ids, width in outlines:
        members = np.zeros(256, np.uint8)
        members[list(train_ids)] = 1
        inside = members.take(current)
        if inside.any():
            window = _window(inside)
            inside, sky = inside[window], current[window] == TrainId.SKY
            surface, window_source = nearness[window], source[window]
            holes = sky & (_closed(inside, width * label.shape[1]) > inside)
            twigs = _small_parts(inside | holes, LEAST * label.size)
            holes &= twigs == 0
            if holes.any():
                window_source[holes] = window_source.take(_nearest(inside)[holes])
            _drop(twigs * inside, (inside | holes) == 0, surface, window_source)
            current = label.take(source)
    return source


def _inverse(depth: np.ndarray) -> np.ndarray:
    """1 / depth f32[h, w], 0 for the sky."""
    return np.divide(1, depth, out=np.zeros(depth.shape, np.float32), where=depth > 0)


def _window(inside: np.ndarray) -> tuple[slice, slice]:
    """The rows and columns of a non-empty mask, with a margin of one pixel."""
    rows, columns = (np.flatnonzero(inside.any(axis=axis)) for axis in (1, 0))
    return slice(max(rows[0] - 1, 0), rows[-1] + 2), slice(max(columns[0] - 1, 0), columns[-1] + 2)


def _closed(mask: np.ndarray, size: float) -> np.ndarray:
    """Close a mask u8[h, w] with an ellipse of about a width in pixels; the image is extended at its edges.

    A large ellipse is several rounds of a smaller one, so its radius may differ by a seventh.
    """
    radius = max(round((size - 1) / 2), SMALLEST // 2)
    rounds = max(radius // RADIUS, 1)
    side = 2 * round(radius / rounds) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    wide = cv2.copyMakeBorder(mask, radius, radius, radius, radius, cv2.BORDER_REPLICATE)
    closed = cv2.morphologyEx(wide, cv2.MORPH_CLOSE, kernel, iterations=rounds)
    return closed[radius:-radius, radius:-radius]


def _nearest(inside: np.ndarray) -> np.ndarray:
    """The flat index i64[h, w] of the nearest pixel of a non-empty mask."""
    _, number = cv2.distanceTransformWithLabels(
        1 - inside, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    places = np.flatnonzero(inside)
    nearest = np.empty(number.max() + 1, np.int64)
    nearest[number.take(places)] = places
    return nearest.take(number)


def _small_parts(mask: np.ndarray, least: float) -> np.ndarray:
    """The number i32[h, w] of the connected part of each pixel, 0 for parts of ``least`` pixels or more."""
    _, parts, statistics, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    numbers = np.arange(len(statistics), dtype=np.int32)
    return np.where(statistics[:, cv2.CC_STAT_AREA] < least, numbers, 0).take(parts)


def _drop(parts: np.ndarray, outside: np.ndarray, nearness: np.ndarray, source: np.ndarray) -> None:
    """Give each numbered part the class of its deepest neighbour outside, in place."""
    rows, columns = np.nonzero(parts)
    if not len(rows):
        return
    height, width = parts.shape
    steps = np.array([(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dy or dx])
    y = np.clip(rows + steps[:, :1], 0, height - 1)
    x = np.clip(columns + steps[:, 1:], 0, width - 1)
    is_outside = outside[y, x]
    part = np.broadcast_to(parts[rows, columns], y.shape)[is_outside]
    neighbours = (y * width + x)[is_outside]
    order = np.lexsort((neighbours, nearness.take(neighbours), part))
    with_neighbours, first = np.unique(part[order], return_index=True)
    deepest = np.full(parts.max() + 1, -1)
    deepest[with_neighbours] = neighbours[order[first]]
    behind = deepest[parts[rows, columns]]
    rows, columns, behind = rows[behind >= 0], columns[behind >= 0], behind[behind >= 0]
    nearness[rows, columns] = nearness.take(behind)
    source[rows, columns] = source.take(behind)
