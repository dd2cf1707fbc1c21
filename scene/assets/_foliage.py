"""What trees and bushes share: leaves as lumpy blobs and as loose cards."""

from __future__ import annotations

import numpy as np
import trimesh

from scene.asset import Asset, Color, Point, shade, solid, triangles

GREENS: tuple[Color, ...] = (
    (0.045, 0.075, 0.022), (0.065, 0.09, 0.025), (0.032, 0.055, 0.025), (0.09, 0.10, 0.035),
)  # fmt: skip


def directions(rng: np.random.Generator, count: int) -> np.ndarray:
    """Unit vectors [count, 3], even over the sphere."""
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def clump(rng: np.random.Generator, centre: Point, radii: Point, color: Color) -> Asset:
    """A lumpy blob of leaves, 20 faces, darker below; its corners stick out unevenly."""
    sphere = trimesh.creation.icosphere(subdivisions=0)
    stretch = rng.uniform(0.65, 1.3, (len(sphere.vertices), 1))
    vertices = np.asarray(sphere.vertices) * stretch * np.asarray(radii) + np.asarray(centre)
    blob = solid(vertices, sphere.faces, color, "foliage")
    up = np.asarray(sphere.face_normals)[:, 2]
    return shade(blob, (0.85 + 0.3 * up) * rng.uniform(0.65, 1.35, len(up)))


def leaf_cards(rng: np.random.Generator, centres: np.ndarray, size: float, color: Color) -> Asset:
    """Loose triangles about ``centres`` [n, 3], each turned and toned at random."""
    corners = rng.normal(size=(len(centres), 3, 3))
    corners -= corners.mean(axis=1, keepdims=True)
    corners *= size / np.linalg.norm(corners, axis=2, keepdims=True).clip(0.3) * 0.7
    cards = triangles(centres[:, None] + corners, color, "foliage")
    return shade(cards, rng.uniform(0.55, 1.45, len(centres)))
