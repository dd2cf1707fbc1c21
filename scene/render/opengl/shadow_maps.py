"""Shadows in OpenGL: the street drawn from the sun, once for each range of depths."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from scene.compiled import njit
from scene.render.buffers import Visible
from scene.render.geometry import World

if TYPE_CHECKING:
    from scene.render.opengl.raster import Rasterizer

CASCADES = (12.0, 45.0, 250.0)
"""Depths in metres up to which each shadow map is used, from fine to coarse; sunlit beyond."""


def pose_of(axes: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Pose f64[4, 4] of a camera at ``place`` with right, up and backward axes as rows of ``axes``."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = axes.T, place
    return pose


def cast_shadows(
    rasterizer: Rasterizer,
    merged: World,
    view: Visible,
    face_ids: np.ndarray,
    towards: np.ndarray,
    lit: np.ndarray,
) -> None:
    """Set ``lit`` f32[m] to the share of sunlight that reaches each spot.

    The street is drawn from the sun once for each range of depths, just wide enough for the visible spots
    there.
    """
    towards = towards.astype(np.float64)
    across = np.cross(np.eye(3)[np.abs(towards).argmin()], towards)
    axes = np.stack([across, np.cross(towards, across), towards])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    top = float((merged.vertices @ axes[2].astype(np.float32)).max()) + 1.0
    size = int(np.clip(2 ** math.ceil(math.log2(1.5 * view.rays.columns)), 256, 2048))
    cascade = np.empty(len(lit), np.int8)
    local = np.empty((len(lit), 3), np.float32)
    outwards = view.side[:, None] * view.flat
    depth = view.spots.distance * view.rays.along[view.spots.sample]
    bounds = _seen_by_the_sun(
        depth, view.side, view.points, axes.astype(np.float32), CASCADES, cascade, local
    )
    for k in np.unique(cascade[cascade >= 0]):
        low, high = bounds[k, 0] - 0.05, bounds[k, 1] + 0.05
        centre, half, reach = (low + high) / 2, (high - low) / 2, top - low[2] + 1.0
        place = np.array([centre[0], centre[1], top]) @ axes
        projection = np.diag([1 / half[0], 1 / half[1], -2 / reach, 1.0])
        projection[2, 3] = -1.0
        shadow_map = rasterizer.draw(pose_of(axes, place), projection, size, size)
        _compare(
            k, cascade, face_ids[view.spots.sample], local, outwards, axes.astype(np.float32),
            low, high, np.float32(top), shadow_map, lit,
        )  # fmt: skip


@njit(cache=True)
def _seen_by_the_sun(
    depth: np.ndarray,
    needed: np.ndarray,
    points: np.ndarray,
    axes: np.ndarray,
    edges: tuple[float, ...],
    cascade: np.ndarray,
    local: np.ndarray,
) -> np.ndarray:
    """The range of depths (-1: none) and position in the sun's frame of each spot; bounds f32[k, 2, 3]."""
    bounds = np.empty((len(edges), 2, 3), np.float32)
    bounds[:, 0], bounds[:, 1] = 1e9, -1e9
    for i in range(cascade.shape[0]):
        cascade[i] = -1
        if not needed[i]:
            continue
        for k in range(len(edges)):
            if depth[i] < edges[k]:
                cascade[i] = k
                break
        if cascade[i] < 0:
            continue
        for a in range(3):
            value = np.float32(0)
            for b in range(3):
                value += axes[a, b] * points[i, b]
            local[i, a] = value
            bounds[cascade[i], 0, a] = min(bounds[cascade[i], 0, a], value)
            bounds[cascade[i], 1, a] = max(bounds[cascade[i], 1, a], value)
    return bounds


@njit(cache=True)
def _compare(
    which: int,
    cascade: np.ndarray,
    faces: np.ndarray,
    local: np.ndarray,
    normals: np.ndarray,
    axes: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    top: np.float32,
    shadow_map: np.ndarray,
    lit: np.ndarray,
) -> None:
    """Compare spots with the four nearest texels of the shadow map and interpolate between them."""
    size = shadow_map.shape[0]
    texel_x, texel_y = (high[0] - low[0]) / size, (high[1] - low[1]) / size
    # Start a little above the surface, so that it does not shadow itself.
    offset = 1.5 * max(texel_x, texel_y) + 0.01
    for i in range(faces.shape[0]):
        if cascade[i] != which:
            continue
        place = np.empty(3, np.float32)
        for a in range(3):
            place[a] = local[i, a]
            for b in range(3):
                place[a] += offset * axes[a, b] * normals[i, b]
        column = (place[0] - low[0]) / texel_x - 0.5
        row = (high[1] - place[1]) / texel_y - 0.5
        depth = top - place[2] - 0.005
        c0, r0 = math.floor(column), math.floor(row)
        share = 0.0
        for r, weight_r in ((r0, 1 - (row - r0)), (r0 + 1, row - r0)):
            for c, weight_c in ((c0, 1 - (column - c0)), (c0 + 1, column - c0)):
                face, blocker = shadow_map[min(max(r, 0), size - 1), min(max(c, 0), size - 1)]
                if face < 0 or face == faces[i] or blocker >= depth:
                    share += weight_r * weight_c
        lit[i] = share
