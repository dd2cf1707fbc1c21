"""Pages of whole streets: several streets with labels and depth, and sweeps of one attribute."""

from __future__ import annotations

import numpy as np

from common.errors import hint
from scene.attributes import BY_NAME, NAMES, default_unit, street_params
from scene.dataset.render import render_street
from scene.preview.layout import Studio, captioned, grid, stack, tile
from scene.street.street import sample_street


def contact_sheet(rows: np.ndarray, seed: int, shots: int, studio: Studio) -> np.ndarray:
    """Make a page u8[h, w, 3] with a row of images, labels and depth maps for each row of unit attributes."""

    def row(k: int) -> np.ndarray:
        frames = render_street(
            rows[k], seed, k, shots, studio.settings, studio.renderer, studio.pool
        )
        return np.concatenate([tile(frame) for frame in frames], axis=1)

    return np.concatenate([row(k) for k in range(len(rows))])


def sweep(name: str, steps: int, seed: int, studio: Studio) -> np.ndarray:
    """Vary one attribute from 0 to 1 in ``steps``; all others stay at their defaults, with the same seed.

    Source: figure 2 of the paper.

    Raises:
        ValueError: unknown attribute.
    """
    if name not in BY_NAME:
        raise ValueError(f"unknown attribute {name!r}; {hint(name, BY_NAME)}")
    row, where = BY_NAME[name], list(BY_NAME).index(name)
    images = []
    for k, share in enumerate(np.linspace(0, 1, steps)):
        unit = default_unit("scenex" if name in NAMES else "extended")
        unit[where] = share
        street = sample_street(street_params(unit), seed, 1, studio.pool)
        value = f"{row.physical(share):.3g} {row.unit}"
        images.append(captioned(studio.shoot(street), f"{name}: {value}" if k == 0 else value))
    return grid(images, steps)


def all_sweeps(steps: int, seed: int, studio: Studio) -> np.ndarray:
    """A page with one row for each attribute of the extended space."""
    return stack([sweep(name, steps, seed, studio) for name in BY_NAME])
