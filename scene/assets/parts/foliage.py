"""What trees, bushes and climbers share: leaves, tufts of leaves, and wood as many thin tubes."""

from __future__ import annotations

import numpy as np

from scene.mesh.asset import Asset, Color, shade, solid
from scene.mesh.solids import triangles

GREENS: tuple[Color, ...] = (
    (0.120, 0.145, 0.060), (0.165, 0.180, 0.080), (0.085, 0.110, 0.055), (0.190, 0.190, 0.095),
)  # fmt: skip
AUTUMNS: tuple[Color, ...] = (
    (0.24, 0.15, 0.035), (0.22, 0.085, 0.025), (0.17, 0.13, 0.045), (0.15, 0.095, 0.045),
)  # fmt: skip


def directions(rng: np.random.Generator, count: int) -> np.ndarray:
    """Draw unit vectors f64[count, 3], uniform over the sphere."""
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def leaf_cards(
    rng: np.random.Generator,
    centres: np.ndarray,
    size: float,
    color: Color,
    tone: np.ndarray | float = 1.0,
) -> Asset:
    """Build loose triangles around ``centres`` f64[n, 3], turned at random, each about ``tone`` light."""
    corners = rng.normal(size=(len(centres), 3, 3))
    corners -= corners.mean(axis=1, keepdims=True)
    corners *= size / np.linalg.norm(corners, axis=2, keepdims=True).clip(0.3) * 0.7
    cards = triangles(centres[:, None] + corners, color, "foliage")
    return shade(cards, tone * rng.uniform(0.55, 1.45, len(centres)))


def tufts(
    rng: np.random.Generator,
    centres: np.ndarray,
    radii: np.ndarray | float,
    count: int,
    size: float,
    color: Color,
) -> Asset:
    """Build tufts of ``count`` leaves around ``centres`` f64[n, 3].

    Each tuft has its own tone and is darker below, so that a crown looks like lit and shaded clusters
    instead of one green.
    """
    tuft_count = len(centres)
    offsets = directions(rng, tuft_count * count) * rng.random((tuft_count * count, 1)) ** 0.5
    tone = np.repeat(rng.uniform(0.5, 1.5, tuft_count), count) * (1 + 0.5 * offsets[:, 2])
    spread = np.repeat(np.broadcast_to(np.asarray(radii, float), (tuft_count,)), count)[:, None]
    return leaf_cards(rng, np.repeat(centres, count, 0) + offsets * spread, size, color, tone)


def _across(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors f64[n, 3] at right angles to ``axis`` f64[n, 3] and to each other."""
    helper = np.where(np.abs(axis[:, 2:]) > 0.9 * np.linalg.norm(axis, axis=1, keepdims=True),
                      [[1.0, 0, 0]], [[0, 0, 1.0]])  # fmt: skip
    u = np.cross(axis, helper)
    u /= np.linalg.norm(u, axis=1, keepdims=True).clip(1e-9)
    v = np.cross(axis, u)
    return u, v / np.linalg.norm(v, axis=1, keepdims=True).clip(1e-9)


def tubes(
    lines: np.ndarray, radius: np.ndarray, sides: int, color: Color, material: str = "bark"
) -> Asset:
    """Build bent tubes around many lines at once, open at the ends.

    Args:
        lines: points f64[tubes, points, 3], metres.
        radius: at every point f64[tubes, points], metres.
        sides: of a section; 2 for flat ribbons, which are enough for twigs.
        color: of the bark.
        material: of the bark.
    """
    count, points = lines.shape[:2]
    u, v = _across(lines[:, -1] - lines[:, 0])
    turn = np.arange(sides) * 2 * np.pi / sides
    ring = np.cos(turn)[:, None] * u[:, None] + np.sin(turn)[:, None] * v[:, None]
    vertices = lines[:, :, None] + radius[:, :, None, None] * ring[:, None]  # [t, p, sides, 3]
    start = np.arange(count)[:, None, None] * points * sides
    step = np.arange(points - 1)[:, None] * sides
    i = np.arange(sides if sides > 2 else 1)
    a, b = start + step + i, start + step + (i + 1) % sides
    faces = np.stack([a, b, b + sides, a, b + sides, a + sides], -1)
    return solid(vertices.reshape(-1, 3), faces.reshape(-1, 3), color, material)


def slivers(
    rng: np.random.Generator, start: np.ndarray, end: np.ndarray, width: float, color: Color
) -> Asset:
    """Build thin twigs: one triangle from each ``start`` f64[n, 3] to its ``end`` f64[n, 3]."""
    side = np.cross(end - start, directions(rng, len(start)))
    side *= width / 2 / np.linalg.norm(side, axis=1, keepdims=True).clip(1e-9)
    return triangles(np.stack([start - side, start + side, end], 1), color, "bark")
