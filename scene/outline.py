"""Draws labels as annotators do: an outline around a whole crown, with the holes through which the sky shows.

Rendered labels are exact to the pixel. An `Outline` closes those holes of a class and drops its loose twigs;
every pixel that changes gets class and instance of another pixel of the image. Holes before a house stay:
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
"""Wider kernels are made of several of this radius in pixels, in a tenth of the time."""
SMALLEST = 3
"""The smallest width of a kernel in pixels."""


def outlined(frame: Frame, outlines: Sequence[Outline]) -> Frame:
    """The frame with classes and instances as annotators draw them; image, depth and normals are kept."""
    if not outlines:
        return frame
    source = sources(frame.label, frame.depth, outlines)
    return frame._replace(label=frame.label.take(source), instance=frame.instance.take(source))


def sources(label: np.ndarray, depth: np.ndarray, outlines: Sequence[Outline]) -> np.ndarray:
    """The pixel i64[h, w] of the flat image from which every pixel takes its class.

    For each outline, the sky inside the closing of the class, by an ellipse as wide as the outline, takes
    the class of the nearest pixel that had it. Connected parts that are still smaller than `LEAST` take that
    of their deepest neighbour.

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
            surface, taken = nearness[window], source[window]
            holes = sky & (_closed(inside, width * label.shape[1]) > inside)
            twigs = _small_parts(inside | holes, LEAST * label.size)
            holes &= twigs == 0
            if holes.any():
                taken[holes] = taken.take(_nearest(inside)[holes])
            _drop(twigs * inside, (inside | holes) == 0, surface, taken)
            current = label.take(source)
    return source


def _inverse(depth: np.ndarray) -> np.ndarray:
    """1 over depth f32[h, w], which is 0 for the sky."""
    return np.divide(1, depth, out=np.zeros(depth.shape, np.float32), where=depth > 0)


def _window(inside: np.ndarray) -> tuple[slice, slice]:
    """The rows and columns of a mask that has some pixels, with a margin of one."""
    rows, columns = (np.flatnonzero(inside.any(axis=axis)) for axis in (1, 0))
    return slice(max(rows[0] - 1, 0), rows[-1] + 2), slice(max(columns[0] - 1, 0), columns[-1] + 2)


def _closed(mask: np.ndarray, size: float) -> np.ndarray:
    """A mask u8[h, w] closed by an ellipse of an odd width in pixels; holes go on beyond the image."""
    radius = max(round((size - 1) / 2), SMALLEST // 2)
    rounds = max(radius // RADIUS, 1)
    side = 2 * round(radius / rounds) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    wide = cv2.copyMakeBorder(mask, radius, radius, radius, radius, cv2.BORDER_REPLICATE)
    closed = cv2.morphologyEx(wide, cv2.MORPH_CLOSE, kernel, iterations=rounds)
    return closed[radius:-radius, radius:-radius]


def _nearest(inside: np.ndarray) -> np.ndarray:
    """The nearest pixel i64[h, w] of a mask that has some, for every pixel of the flat image."""
    _, number = cv2.distanceTransformWithLabels(
        1 - inside, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    places = np.flatnonzero(inside)
    nearest = np.empty(number.max() + 1, np.int64)
    nearest[number.take(places)] = places
    return nearest.take(number)


def _small_parts(mask: np.ndarray, least: float) -> np.ndarray:
    """The number i32[h, w] of the connected part of each pixel of a mask, 0 for parts of ``least`` pixels."""
    _, parts, statistics, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    numbers = np.arange(len(statistics), dtype=np.int32)
    return np.where(statistics[:, cv2.CC_STAT_AREA] < least, numbers, 0).take(parts)


def _drop(parts: np.ndarray, outside: np.ndarray, nearness: np.ndarray, source: np.ndarray) -> None:
    """Let each numbered part take the class of its deepest neighbour outside, in place."""
    rows, columns = np.nonzero(parts)
    if not len(rows):
        return
    height, width = parts.shape
    steps = np.array([(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dy or dx])
    y = np.clip(rows + steps[:, :1], 0, height - 1)
    x = np.clip(columns + steps[:, 1:], 0, width - 1)
    beside = outside[y, x]
    part = np.broadcast_to(parts[rows, columns], y.shape)[beside]
    neighbours = (y * width + x)[beside]
    order = np.lexsort((neighbours, nearness.take(neighbours), part))
    with_neighbours, first = np.unique(part[order], return_index=True)
    deepest = np.full(parts.max() + 1, -1)
    deepest[with_neighbours] = neighbours[order[first]]
    behind = deepest[parts[rows, columns]]
    rows, columns, behind = rows[behind >= 0], columns[behind >= 0], behind[behind >= 0]
    nearness[rows, columns] = nearness.take(behind)
    source[rows, columns] = source.take(behind)
