"""Measures how much two assets look alike: where their surface is, its colours, and their size."""

from __future__ import annotations

import numpy as np

from scene.mesh.asset import Asset
from scene.mesh.mesh import twice_areas

CELLS = 8
"""Cells along each side of the box around an asset."""


def describe(asset: Asset) -> np.ndarray:
    """Describe an asset as f64[4 CELLS^3 + 3]: share and colour of its surface per cell, log of its size.

    The cells divide the box around the asset, whatever its size. The sum of absolute differences of two
    descriptions is 0 for copies, and 1 to 2 for another shape in other colours.
    """
    corners = asset.mesh.vertices[asset.mesh.faces]
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    size = np.maximum(high - low, 1e-3)
    cell = (CELLS * (corners.mean(axis=1) - low) / size).astype(int).clip(0, CELLS - 1)
    place = cell @ (CELLS**2, CELLS, 1)
    area = twice_areas(asset.mesh.vertices, asset.mesh.faces)
    share = area / max(float(area.sum()), 1e-9)
    shades = np.sqrt(asset.color.T)  # so that differences are as large as they look
    weights = (share, *(share * shade for shade in shades))
    cells = [np.bincount(place, weight, CELLS**3) for weight in weights]
    return np.concatenate([*cells, np.log(size)])


def closest(assets: list[np.ndarray], count: int) -> list[tuple[float, int, int]]:
    """Return the ``count`` most similar pairs, nearest first, as (distance, index, index)."""
    first, second = np.triu_indices(len(assets), 1)
    stack = np.stack(assets)
    distances = np.concatenate(
        [np.abs(stack[k + 1 :] - row).sum(axis=1) for k, row in enumerate(stack)]
    )
    order = np.argsort(distances, kind="stable")[:count]
    return [(float(distances[k]), int(first[k]), int(second[k])) for k in order]
