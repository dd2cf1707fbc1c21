"""Triangles as arrays, and the geometry functions for solids."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np


@dataclass(eq=False, slots=True)
class Mesh:
    """Triangles as arrays; plain and fast, since a vehicle has hundreds of parts that are meshes."""

    vertices: np.ndarray  # f64[v, 3]
    faces: np.ndarray  # i64[f, 3]

    @property
    def bounds(self) -> np.ndarray:
        """Low and high corner f64[2, 3] of the triangles."""
        corners = self.vertices[self.faces.ravel()]
        return np.stack([corners.min(axis=0), corners.max(axis=0)])


def frozen(array: np.ndarray) -> np.ndarray:
    """Make an array read-only, since cached arrays are shared."""
    array.setflags(write=False)
    return array


def unit(vector: np.ndarray) -> np.ndarray:
    """Normalise a vector f64[3]; faster than with ``np.linalg.norm``."""
    return vector / math.sqrt(vector.dot(vector))


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The cross products of vectors f64[3] or f64[n, 3]; ``np.cross`` takes ten times as long."""
    (x, y, z), (u, v, w) = a.T, b.T
    return np.array((y * w - z * v, z * u - x * w, x * v - y * u)).T.copy()


def twice_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Twice the area f64[f] of each face."""
    p, q, r = vertices.T[:, faces.T].transpose(1, 0, 2)
    (x, y, z), (u, v, w) = q - p, r - p
    return np.sqrt((y * w - z * v) ** 2 + ((z * u - x * w) ** 2 + (x * v - y * u) ** 2))


@lru_cache
def circle(sides: int) -> np.ndarray:
    """Cosines and sines f64[2, sides] of the angles around a circle (read-only)."""
    angle = np.arange(sides) * 2 * np.pi / sides
    return frozen(np.stack([np.cos(angle), np.sin(angle)]))


@lru_cache
def icosphere(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a unit sphere: an icosahedron whose faces were split into four (read-only)."""
    if subdivisions == 0:
        a, b = 0.5257311121191336, 0.85065080835204
        plane = np.array([(-a, b), (a, b), (-a, -b), (a, -b)])
        vertices = np.concatenate([np.insert(plane, 2, 0, axis=1)[:, k] for k in _TURNS])
        return frozen(_on_sphere(vertices)), _ICOSAHEDRON
    vertices, faces = icosphere(subdivisions - 1)
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, first, which = np.unique(
        edges[:, 0] + (edges[:, 1] << 32), return_index=True, return_inverse=True
    )
    middle = vertices[edges[first]].mean(axis=1)
    a, b, c = faces.T
    d, e, f = (which.reshape(-1, 3) + len(vertices)).T
    split = np.stack([a, d, f, d, b, e, f, e, c, d, e, f], axis=1).reshape(-1, 3)
    return frozen(_on_sphere(np.concatenate([vertices, middle]))), frozen(split)


def _on_sphere(points: np.ndarray) -> np.ndarray:
    length = np.sqrt(points**2 @ [1, 1, 1])[:, None]
    return points + points / length * (1 - length)


_TURNS = ((0, 1, 2), (2, 0, 1), (1, 2, 0))
_ICOSAHEDRON = np.array([
    [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2],
    [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5],
    [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1],
])  # fmt: skip
