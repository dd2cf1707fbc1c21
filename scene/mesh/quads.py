"""The ground as many four-cornered faces at once, each with its own colour."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.look.materials import material_id
from scene.mesh.asset import Asset
from scene.mesh.mesh import Mesh


class Quads(NamedTuple):
    """n four-cornered faces."""

    corners: np.ndarray  # f64[n, 4, 3] in order around the edge, metres
    color: np.ndarray  # f32[n, 3] linear RGB
    material: np.ndarray  # u8[n] index into MATERIALS


def quads(corners: np.ndarray, color: np.ndarray, material: str) -> Quads:
    """Faces [n, 4, 3] of one material; ``color`` [3] for all or [n, 3] for each."""
    n = len(corners)
    colors = np.empty((n, 3), np.float32)
    colors[:] = color
    return Quads(corners, colors, np.full(n, material_id(material), np.uint8))


def flat(outline: np.ndarray, z: float, color: np.ndarray, material: str) -> Quads:
    """Level faces from outlines [n, 4, 2] at height ``z``."""
    corners = np.empty((len(outline), 4, 3))
    corners[..., :2], corners[..., 2] = outline, z
    return quads(corners, color, material)


def rectangles(x0: np.ndarray, x1: np.ndarray, y0: np.ndarray, y1: np.ndarray) -> np.ndarray:
    """Outlines f64[n, 4, 2] of rectangles along the axes; the four bounds broadcast together."""
    outline = np.empty((max(np.size(v) for v in (x0, x1, y0, y1)), 4, 2))
    outline[:, 0, 0] = outline[:, 3, 0] = x0
    outline[:, 1, 0] = outline[:, 2, 0] = x1
    outline[:, 0, 1] = outline[:, 1, 1] = y0
    outline[:, 2, 1] = outline[:, 3, 1] = y1
    return outline


def strokes(start: np.ndarray, end: np.ndarray, width: float) -> np.ndarray:
    """Outlines f64[n, 4, 2] of straight lines ``width`` wide between points [n, 2]."""
    along = end - start
    length = np.sqrt((along**2).sum(axis=1, keepdims=True))
    side = along[:, ::-1] * np.array([-1, 1]) * (width / 2 / length)
    outline = np.empty((len(along), 4, 2))
    outline[:, 0], outline[:, 1] = start - side, end - side
    outline[:, 2], outline[:, 3] = end + side, start + side
    return outline


def grid(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Cells f64[(len(x) - 1) * (len(y) - 1), 4, 3] between lines of a grid; ``z`` [len(x), len(y)].

    Cells run along ``y`` first.
    """
    points = np.empty((len(x), len(y), 3))
    points[..., 0], points[..., 1], points[..., 2] = x[:, None], y, z
    cells = np.empty((len(x) - 1, len(y) - 1, 4, 3))
    cells[:, :, 0], cells[:, :, 1] = points[:-1, :-1], points[1:, :-1]
    cells[:, :, 2], cells[:, :, 3] = points[1:, 1:], points[:-1, 1:]
    return cells.reshape(-1, 4, 3)


def discs(centre: np.ndarray, radius: float, sides: int = 12) -> np.ndarray:
    """Outlines f64[n * sides / 2, 4, 2] that fill circles around ``centre`` [n, 2]."""
    angle = np.arange(sides + 1) * 2 * np.pi / sides
    rim = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    fan = np.stack([np.zeros((sides // 2, 2)), rim[:-2:2], rim[1:-1:2], rim[2::2]], axis=1)
    return (np.asarray(centre)[:, None, None] + fan).reshape(-1, 4, 2)


def joined(parts: list[Quads]) -> Quads:
    """Join all faces, in order."""
    return Quads(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def to_asset(parts: list[Quads]) -> Asset:
    """Convert all faces to one asset, two triangles each."""
    merged = joined(parts) if len(parts) > 1 else parts[0]
    count = len(merged.corners)
    faces = np.empty((count, 2, 3), np.int64)
    faces[:] = [[0, 1, 2], [0, 2, 3]]
    faces += 4 * np.arange(count)[:, None, None]
    return Asset(
        Mesh(merged.corners.reshape(-1, 3), faces.reshape(-1, 3)),
        np.clip(merged.color, 0, 1).astype(np.float32).repeat(2, axis=0),
        merged.material.repeat(2),
    )
