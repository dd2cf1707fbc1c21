"""Coordinates of spots on the road and on their assets, for textures and wetness."""

from __future__ import annotations

import numpy as np

from scene.compiled import njit
from scene.ground.build import GROUND_INSTANCES
from scene.ground.land import road_height
from scene.ground.path import Path
from scene.render.geometry import Geometry

LEVEL = 0.7
"""Least vertical component of the normal of a level face; of its height, only wetness depends."""


def on_road(
    geometry: Geometry,
    path: Path,
    instance: np.ndarray,
    face: np.ndarray,
    points: np.ndarray,
    flat: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Points f32[m, 3] and normals f32[m, 3] of spots for shading, see ``shade``.

    Those of the ground are in road coordinates, those of objects in the frame of their asset, so that
    textures rotate with it. However, heights of level faces are above the road, and the vertical component of
    normals is that in the world.

    Args:
        geometry: of the street.
        path: of its road.
        instance: i32[m] instance of each spot, 0 for the sky.
        face: i32[m] face of its shape.
        points: f32[m, 3] in the world.
        flat: f32[m, 3] in the world.
    """
    points, flat = points.copy(), flat.copy()
    level = np.flatnonzero((flat[:, 2] > LEVEL) & (instance > len(GROUND_INSTANCES)))
    below = road_height(path, points[level]) if path.slopes else 0.0
    _in_asset(len(GROUND_INSTANCES), geometry.pose, instance, points, flat)
    points[level, 2] -= below
    for ground, road in enumerate(geometry.road_vertices, 1):
        shape = geometry.shapes[geometry.shape[ground]]
        _lay(ground, shape.faces, shape.vertices, road, instance, face, points, flat)
    return points, flat


@njit(cache=True, error_model="numpy")
def _in_asset(
    ground: int, pose: np.ndarray, instance: np.ndarray, points: np.ndarray, flat: np.ndarray
) -> None:
    """Convert points and normals of objects, instances after ``ground``, to the frames of their assets."""
    for i in range(len(instance)):
        j = instance[i]
        if j <= ground:
            continue
        x, y, z = (
            points[i, 0] - pose[j, 0, 3],
            points[i, 1] - pose[j, 1, 3],
            points[i, 2] - pose[j, 2, 3],
        )
        a, b, c = flat[i, 0], flat[i, 1], flat[i, 2]
        points[i, 0] = x * pose[j, 0, 0] + y * pose[j, 1, 0] + z * pose[j, 2, 0]
        points[i, 1] = x * pose[j, 0, 1] + y * pose[j, 1, 1] + z * pose[j, 2, 1]
        if abs(c) <= LEVEL:
            points[i, 2] = x * pose[j, 0, 2] + y * pose[j, 1, 2] + z * pose[j, 2, 2]
        flat[i, 0] = a * pose[j, 0, 0] + b * pose[j, 1, 0] + c * pose[j, 2, 0]
        flat[i, 1] = a * pose[j, 0, 1] + b * pose[j, 1, 1] + c * pose[j, 2, 1]


@njit(cache=True, error_model="numpy")
def _lay(
    ground: int,
    faces: np.ndarray,
    vertices: np.ndarray,
    road: np.ndarray,
    instance: np.ndarray,
    face: np.ndarray,
    points: np.ndarray,
    flat: np.ndarray,
) -> None:
    """Convert points and normals of one surface to road coordinates, face by face."""
    for i in range(len(instance)):
        if instance[i] != ground:
            continue
        p, q, r = faces[face[i]]
        # Barycentric coordinates of the point, from dot products with the two edges.
        bb = bc = cc = pb = pc = 0.0
        for k in range(3):
            b, c = vertices[q, k] - vertices[p, k], vertices[r, k] - vertices[p, k]
            away = points[i, k] - vertices[p, k]
            bb += b * b
            bc += b * c
            cc += c * c
            pb += away * b
            pc += away * c
        area = bb * cc - bc * bc
        u, v = (cc * pb - bc * pc) / area, (bb * pc - bc * pb) / area
        b0, b1, b2 = road[q, 0] - road[p, 0], road[q, 1] - road[p, 1], road[q, 2] - road[p, 2]
        c0, c1, c2 = road[r, 0] - road[p, 0], road[r, 1] - road[p, 1], road[r, 2] - road[p, 2]
        points[i, 0] = road[p, 0] + u * b0 + v * c0
        points[i, 1] = road[p, 1] + u * b1 + v * c1
        points[i, 2] = road[p, 2] + u * b2 + v * c2
        x, y, z = b1 * c2 - b2 * c1, b2 * c0 - b0 * c2, b0 * c1 - b1 * c0
        shrink = (1.0 if z * flat[i, 2] >= 0 else -1.0) / np.sqrt(x * x + y * y + z * z)
        flat[i, 0], flat[i, 1], flat[i, 2] = shrink * x, shrink * y, shrink * z
