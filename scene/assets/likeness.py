"""How much two assets look alike, as one number: where their surface is, in which colours, and their size."""

from __future__ import annotations

import numpy as np

from scene.mesh.asset import Asset
from scene.mesh.mesh import twice_areas

CELLS = 8
"""Cells along each side of the box around an asset."""


def looks(asset: Asset) -> np.ndarray:
    """An asset as f64[4 CELLS^3 + 3]: share and colour of its surface in every cell, log of its size.

    Cells are as wide as the box around the asset, whatever its size. What two of them differ by, summed
    up, is 0 for copies, and 1 or 2 for another body in another paint.
    """
    corners = asset.mesh.vertices[asset.mesh.faces]
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    size = np.maximum(high - low, 1e-3)
    cell = (CELLS * (corners.mean(axis=1) - low) / size).astype(int).clip(0, CELLS - 1)
    place = cell @ (CELLS**2, CELLS, 1)
    area = twice_areas(asset.mesh.vertices, asset.mesh.faces)
    share = area / max(float(area.sum()), 1e-9)
    shades = np.sqrt(asset.color.T)  # differences as large as they look
    weights = (share, *(share * shade for shade in shades))
    cells = [np.bincount(place, weight, CELLS**3) for weight in weights]
    return np.concatenate([*cells, np.log(size)])


def closest(assets: list[np.ndarray], count: int) -> list[tuple[float, int, int]]:
    """The ``count`` pairs that look most alike, nearest first: how far apart, one, other."""
    one, other = np.triu_indices(len(assets), 1)
    stack = np.stack(assets)
    apart = np.concatenate(
        [np.abs(stack[k + 1 :] - row).sum(axis=1) for k, row in enumerate(stack)]
    )
    order = np.argsort(apart, kind="stable")[:count]
    return [(float(apart[k]), int(one[k]), int(other[k])) for k in order]
