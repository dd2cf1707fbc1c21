"""Draws the regions of COCO's annotations."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from common.labels.coco import Runs, Shape, read_coco_file
from common.pictures import MOST_PIXELS
from seg.errors import DataError

FARTHEST = 100_000.0
"""A corner of a polygon lies at most so many pixels outside the image."""


class _Region(NamedTuple):
    """A region to draw."""

    area: float  # in pixels
    code: int
    shape: Shape


def draw_regions(path: Path, image: Path | None) -> tuple[np.ndarray, tuple[str, ...]]:
    """Draw the regions of an image, larger ones first, so that they hide no smaller ones.

    Args:
        path: a file of COCO.
        image: the image; None for a caller that knows no image, which is an error.

    Returns:
        i32[h, w] places in the names from 1, 0 for no region, -1 for a crowd; and the names.

    Raises:
        UserError: the file is wrong, or lacks the image.
    """
    file = read_coco_file(path)
    record = None if image is None else file.image_of(image)
    if record is None:
        raise DataError(f"{path}: {image} is not among its images")
    height, width = size = record.height, record.width
    if height * width > MOST_PIXELS:
        raise DataError(f"{path}: {width}x{height} is more than {MOST_PIXELS:,} pixels")
    names: dict[str, int] = {}
    regions = []
    for name, shape, crowd, where in file.regions(record):
        if not isinstance(shape, Runs):  # one or two points, as of a stray click, have no area
            shape = [polygon for polygon in shape if len(polygon) % 2 or len(polygon) >= 6]
        try:
            code = -1 if crowd else names.setdefault(name, 1 + len(names))
            regions.append(_Region(_checked_area(shape, size), code, shape))
        except ValueError as error:
            raise DataError(f"{path}: {where}: {error}") from None
    codes = np.zeros(size, np.int32)
    for region in sorted(regions, key=lambda region: -region.area):
        if isinstance(region.shape, Runs):
            codes[_of_runs(region.shape)] = region.code
        else:
            for polygon in region.shape:
                _fill(codes, np.reshape(polygon, (-1, 2)), region.code)
    return codes, tuple(names)


def _checked_area(shape: Shape, size: tuple[int, int]) -> float:
    """The area of a region in pixels; ValueError if it does not fit an image of a size (height, width)."""
    if isinstance(shape, Runs):
        counts = shape.counts
        if shape.size != size:
            raise ValueError(f"a mask of {shape.size}, but its image has {size} (height, width)")
        if min(counts, default=0) < 0 or sum(counts) != size[0] * size[1]:
            raise ValueError(
                "its counts must be numbers from 0 that add up to the pixels of the image"
            )
        return float(sum(counts[1::2]))
    area = 0.0
    for polygon in shape:
        if len(polygon) % 2:
            raise ValueError(f"a polygon of {len(polygon)} numbers; expected x, y of each point")
        if max(map(abs, polygon)) > FARTHEST:
            raise ValueError("expected points in or near the image")
        x, y = np.reshape(polygon, (-1, 2)).T
        area += abs(x @ np.roll(y, 1) - y @ np.roll(x, 1)) / 2
    return area


def _of_runs(runs: Runs) -> np.ndarray:
    """The mask bool[h, w] of runs down its columns."""
    inside = np.arange(len(runs.counts)) % 2 == 1
    return np.repeat(inside, runs.counts).reshape(runs.size[::-1]).T


def _fill(codes: np.ndarray, points: np.ndarray, code: int) -> None:
    """Give the pixels whose centres are inside a polygon f64[n, 2] a code.

    This is COCO's rule to a pixel in a hundred at the edge. OpenCV and Pillow draw the outline, too, which
    makes regions half a pixel larger all round.
    """
    height, width = codes.shape
    left, top = np.clip(np.ceil(points.min(axis=0) - 0.5), 0, (width, height)).astype(int)
    right, bottom = np.clip(np.ceil(points.max(axis=0) - 0.5), 0, (width, height)).astype(int)
    # Whether the number of edges left of a pixel's centre is odd, as changes along its row.
    changes = np.zeros((bottom - top, right - left + 1), bool)
    for (x, y), (next_x, next_y) in zip(points, np.roll(points, -1, axis=0), strict=True):
        first, last = np.ceil(np.array(sorted((y, next_y))) - 0.5).astype(int)
        rows = np.arange(max(first, top), min(last, bottom))
        if len(rows):
            crossings = x + (rows + 0.5 - y) * (next_x - x) / (next_y - y)
            columns = np.clip(np.ceil(crossings - 0.5).astype(int), left, right)
            changes[rows - top, columns - left] ^= True
    inside = np.logical_xor.accumulate(changes[:, :-1], axis=1)
    codes[top:bottom, left:right][inside] = code
