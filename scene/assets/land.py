"""Tiles of land along a street (class terrain): water, fields and lawn, laid side by side."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.family import FRONTAGE, Family, Size
from scene.assets.parts.draw import SEED, near, sampler, times
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, shade, solid
from scene.mesh.quads import grid

TILE = 8.0
"""Length of a side (metres)."""
CELLS = 20
"""Cells along each side."""
LIFT = 0.03
"""Mean height (metres)."""


class LandParams(NamedTuple):
    """One tile; its rows run along x."""

    color: Color
    material: str
    ridge: float  # height of rows or waves, m
    rows: int  # ridges across a tile; 0 for waves
    contrast: float  # between rows, or from cell to cell
    seed: int


_KINDS: dict[str, LandParams] = {
    "water": LandParams((0.035, 0.05, 0.055), "water", 0.008, 0, 0.05, 0),
    "green water": LandParams((0.04, 0.06, 0.035), "water", 0.005, 0, 0.08, 0),
    "ploughed": LandParams((0.11, 0.078, 0.052), "earth", 0.05, 10, 0.35, 0),
    "crop": LandParams((0.055, 0.10, 0.025), "long grass", 0.04, 10, 0.3, 0),
    "stubble": LandParams((0.21, 0.17, 0.085), "grass", 0.03, 10, 0.2, 0),
    "lawn": LandParams((0.055, 0.10, 0.024), "grass", 0.01, 0, 0.08, 0),
    "meadow": LandParams((0.11, 0.12, 0.04), "long grass", 0.025, 0, 0.15, 0),
}


def land(p: LandParams) -> Asset:
    """Build the tile, centred on the origin, with level edges that fit its neighbours."""
    rng = np.random.default_rng(p.seed)
    coordinates = np.linspace(-TILE / 2, TILE / 2, CELLS + 1)
    height = rng.uniform(0, 2 * p.ridge, (CELLS + 1, CELLS + 1))
    tone = 1 + p.contrast * rng.uniform(-1, 1, (CELLS, CELLS))
    if p.rows:
        crest = np.arange(CELLS + 1) * p.rows % CELLS == 0
        height = np.broadcast_to(2 * p.ridge * crest, height.shape).copy()
        tone *= 1 + p.contrast * np.where(crest[:-1], 1, -1)
    # The edges are level, so that tiles meet; one corner touches the ground.
    height[[0, -1]] = height[:, [0, -1]] = 0.0
    height += LIFT
    height[0, 0] = 0.0
    corners = grid(coordinates, coordinates, height)
    first_corner = 4 * np.arange(len(corners))[:, None]
    faces = np.concatenate([first_corner + [0, 1, 2], first_corner + [0, 2, 3]], axis=1).reshape(
        -1, 3
    )
    tile = solid(corners.reshape(-1, 3), faces, p.color, p.material)
    return shade(tile, tone.ravel().repeat(2))


FAMILY = Family(
    "land", TrainId.TERRAIN, tuple(_KINDS),
    sampler(_KINDS, color=near(0.35), ridge=times(0.7, 1.3), seed=SEED), land,
    count=14, size=Size((1, 60), (0.001, 1)), tone=1.0, line=None, stage=FRONTAGE,
)  # fmt: skip
