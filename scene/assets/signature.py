"""What an asset looks like, as numbers: small pictures of it, and how far two assets are apart.

Used to see that the catalogue holds no look-alikes. Every asset is drawn without light from four sides
by a z-buffer, filling the picture whatever its size; size counts on its own. So neither shaken vertices
nor a slightly larger copy make a new asset, while another outline, other paint or another size do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit

from scene.mesh.asset import Asset

SIDE = 48
"""Pixels along each side of a silhouette."""
OVERSAMPLING = 3
"""Samples per silhouette pixel along each axis."""
CELLS = 16
"""Colour cells along each side of a picture."""
MARGIN = 0.04
"""Share of the picture left free on each side, for the blur."""
BLUR = 1.4
"""Standard deviation of the silhouettes' blur, pixels: edges may move that far and stay close."""
THIN = 0.08
"""A side shorter than this share of the longest one counts as that long: plates have no thickness."""
LAYER = 0.004
"""Of faces no further apart than this share of the picture the later one is seen: paint on a plate."""
SIZE_WEIGHT = 0.5
"""Distance of two copies, one e (2.7) times as large as the other."""
FAINT = 0.02
"""Share of the picture that is added to every area: stray pixels of an edge-on plate weigh little."""
LOOK_ALIKE = 0.06
"""Two assets nearer than this look the same.

Measured: copies 2 % larger are 0.01 away from every asset, and those whose vertices are shaken by 0.05 %
of the size 0.01 to 0.04 away from solid ones (thin rails and painted plates break up sooner); another
body type is 0.06 to 1 away, and one car in other paint 0.1 and more.
"""


class Signature(NamedTuple):
    """Pictures of one asset from four sides."""

    mask: np.ndarray  # f32[views, 48, 48] share of each pixel that is covered, blurred
    color: np.ndarray  # f32[views, 16, 16, 3] mean colour of what is covered, sRGB-like in [0, 1]
    cover: np.ndarray  # f32[views, 16, 16] share of each cell that is covered
    size: np.ndarray  # f32[3] metres along x, y, z


def _view(azimuth: float, elevation: float) -> np.ndarray:
    """Rows right, up and towards the viewer, who stands at these angles (degrees) from +x."""
    a, e = math.radians(azimuth), math.radians(elevation)
    towards = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
    right = np.array([-math.sin(a), math.cos(a), 0.0])
    return np.stack([right, np.cross(towards, right), towards])


VIEWS = np.stack([_view(-20, 0), _view(-70, 0), _view(160, 0), _view(-45, 30)])
"""f64[views, 3, 3]: front, right side, back, and half right from above."""


def signature(asset: Asset) -> Signature:
    """Draw an asset from four sides; pure, about a millisecond."""
    vertices = np.asarray(asset.mesh.vertices, np.float64)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    # The half view shows the diagonal of the box: the same scale for all views must hold it.
    scale = (0.5 - MARGIN) / max(0.5 * float(np.linalg.norm(high - low)), 1e-9)
    placed = (vertices - (low + high) / 2) @ VIEWS.transpose(0, 2, 1) * scale  # [views, v, 3]
    faces = np.ascontiguousarray(asset.mesh.faces, np.int64)
    display = np.power(np.clip(asset.color, 0, 1), 1 / 2.2).astype(np.float32)
    mask = np.zeros((len(VIEWS), SIDE, SIDE), np.float32)
    color = np.zeros((len(VIEWS), CELLS, CELLS, 3), np.float32)
    cover = np.zeros((len(VIEWS), CELLS, CELLS), np.float32)
    for points, *pictures in zip(placed, mask, color, cover, strict=True):
        _draw(points.astype(np.float32), faces, display, *pictures)
        pictures[0][:] = cv2.GaussianBlur(pictures[0], (0, 0), BLUR)
    return Signature(mask, color, cover, (high - low).astype(np.float32))


def distance(one: Signature, other: Signature) -> float:
    """How different two assets look; 0 for the same, see ``LOOK_ALIKE``.

    The greatest over the views of (1 - IoU of the silhouettes) + (root mean square difference of colour
    where both are), plus half the greatest ratio of their sizes as a logarithm.
    """
    return float(distances([one], [other])[0, 0])


def distances(ones: Sequence[Signature], others: Sequence[Signature]) -> np.ndarray:
    """The ``distance``s f32[ones, others] of each of some assets to each of others."""
    out = np.zeros((len(ones), len(others)), np.float32)
    if out.size:
        _compare(*_stacked(ones), *_stacked(others), out)
    return out


def _stacked(signatures: Sequence[Signature]) -> tuple[np.ndarray, ...]:
    """Masks, colours, covers and logarithms of sizes as arrays, one row for each asset."""
    mask, color, cover, size = (np.stack(part) for part in zip(*signatures, strict=True))
    floor = THIN * size.max(axis=1, keepdims=True)
    logs = np.log(np.maximum(size, floor) + 1e-9)
    pictures = (part.reshape(*part.shape[:2], -1) for part in (mask, color, cover))
    return *pictures, logs


def closest(signatures: Sequence[Signature], count: int) -> list[tuple[float, int, int]]:
    """The ``count`` pairs that look most alike: (distance, one, other), nearest first."""
    between = distances(signatures, signatures)
    one, other = np.triu_indices(len(between), 1)
    apart = between[one, other]
    order = np.argsort(apart, kind="stable")[:count]
    return [(float(apart[k]), int(one[k]), int(other[k])) for k in order]


@njit(cache=True)
def _draw(
    points: np.ndarray,
    faces: np.ndarray,
    display: np.ndarray,
    mask: np.ndarray,
    color: np.ndarray,
    cover: np.ndarray,
) -> None:
    """Add one view's ``points`` (right, up, towards the viewer; within +-0.5) to its pictures."""
    n = SIDE * OVERSAMPLING
    found = np.full((n, n), -1, np.int32)
    depth = np.full((n, n), np.float32(-1e9))
    x, y, z = (0.5 + points[:, 0]) * n, (0.5 - points[:, 1]) * n, points[:, 2]
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        area = (x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a])
        if abs(area) < 1e-6:
            continue
        left, right = min(x[a], x[b], x[c]), max(x[a], x[b], x[c])
        top, bottom = min(y[a], y[b], y[c]), max(y[a], y[b], y[c])
        for row in range(max(0, math.floor(top)), min(n - 1, math.floor(bottom)) + 1):
            for column in range(max(0, math.floor(left)), min(n - 1, math.floor(right)) + 1):
                # Samples stand in no straight rows, so that upright poles keep their thickness.
                sx, sy = column + (0.618 * row) % 1, row + (0.618 * column) % 1
                u = ((x[b] - sx) * (y[c] - sy) - (y[b] - sy) * (x[c] - sx)) / area
                v = ((x[c] - sx) * (y[a] - sy) - (y[c] - sy) * (x[a] - sx)) / area
                if u < 0 or v < 0 or u + v > 1:
                    continue
                near = u * z[a] + v * z[b] + (1 - u - v) * z[c]
                if near > depth[row, column] - LAYER:
                    depth[row, column] = max(near, depth[row, column])
                    found[row, column] = f
    cell = n // CELLS
    for row in range(n):
        for column in range(n):
            if found[row, column] >= 0:
                mask[row // OVERSAMPLING, column // OVERSAMPLING] += 1 / OVERSAMPLING**2
                cover[row // cell, column // cell] += 1 / cell**2
                for k in range(3):
                    color[row // cell, column // cell, k] += display[found[row, column], k]
    for row in range(CELLS):
        for column in range(CELLS):
            for k in range(3):
                color[row, column, k] /= max(cover[row, column] * cell**2, np.float32(1))


@njit(cache=True)
def _compare(
    mask: np.ndarray, color: np.ndarray, cover: np.ndarray, logs: np.ndarray,
    other_mask: np.ndarray, other_color: np.ndarray, other_cover: np.ndarray,
    other_logs: np.ndarray, out: np.ndarray,
) -> None:  # fmt: skip
    """Fill ``out`` with the distances of each asset to each other one."""
    _, views, pixels = mask.shape
    cells = cover.shape[2]
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            size = np.max(np.abs(logs[i] - other_logs[j]))
            worst = 0.0
            for view in range(views):
                both, either = 0.0, 0.0
                for p in range(pixels):
                    s, t = mask[i, view, p], other_mask[j, view, p]
                    both += min(s, t)
                    either += max(s, t)
                shape = (either - both) / (either + FAINT * pixels)
                square, weight = 0.0, 0.0
                for p in range(cells):
                    shared = min(cover[i, view, p], other_cover[j, view, p])
                    for k in range(3 * p, 3 * p + 3):
                        square += shared * (color[i, view, k] - other_color[j, view, k]) ** 2
                    weight += shared
                paint = math.sqrt(square / 3 / (weight + FAINT * cells))
                worst = max(worst, shape + paint)
            out[i, j] = worst + SIZE_WEIGHT * size
