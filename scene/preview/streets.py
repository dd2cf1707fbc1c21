"""Pages of whole streets: several streets with labels and depth, and sweeps of one attribute."""

from __future__ import annotations

import numpy as np

from scene.assets.catalogue import AssetPool
from scene.attributes import ATTRIBUTES, NAMES, default_unit, street_params
from scene.dataset.render import render_street
from scene.preview.layout import captioned, grid, stack, tile
from scene.render import RenderSettings, renderer
from scene.street.street import sample_street


def contact_sheet(
    rows: np.ndarray,
    seed: int,
    shots: int,
    settings: RenderSettings,
    renderer_name: str,
    pool: AssetPool,
) -> np.ndarray:
    """One row of pictures, labels and depths for each street of unit attributes, u8[h, w, 3] RGB."""
    streets = [
        render_street(unit, seed, k, shots, settings, renderer_name, pool)
        for k, unit in enumerate(rows)
    ]
    return np.concatenate(
        [np.concatenate([tile(frame) for frame in frames], axis=1) for frames in streets]
    )


def sweep(
    name: str, steps: int, seed: int, settings: RenderSettings, renderer_name: str, pool: AssetPool
) -> np.ndarray:
    """One attribute from 0 to 1 in ``steps``, all else at its default and left to the same seed.

    Source: figure 2 of the paper.

    Raises:
        ValueError: unknown attribute.
    """
    if name not in NAMES:
        raise ValueError(f"unknown attribute {name!r}; known: {', '.join(NAMES)}")
    row = ATTRIBUTES[NAMES.index(name)]
    engine = renderer(renderer_name)
    pictures = []
    for k, share in enumerate(np.linspace(0, 1, steps)):
        unit = default_unit().copy()
        unit[NAMES.index(name)] = share
        street = sample_street(street_params(unit), seed, 1, pool)
        (frame,) = engine.render(street, settings)
        value = f"{row.physical(share):.3g} {row.unit}"
        pictures.append(captioned(frame.image, f"{name}: {value}" if k == 0 else value))
    return grid(pictures, steps)


def all_sweeps(
    steps: int, seed: int, settings: RenderSettings, renderer_name: str, pool: AssetPool
) -> np.ndarray:
    """A page with one row for each of the 23 attributes."""
    return stack([sweep(name, steps, seed, settings, renderer_name, pool) for name in NAMES])
