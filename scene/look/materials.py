"""Surface materials: a tileable luminance texture, its scale in metres, and how much sky it mirrors.

The texture of a material multiplies a face's own colour: the face is red, the material is brick. Both
renderers read this table.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from common.errors import hint
from scene.look.patterns import LANE_TILE, PATTERNS
from scene.streams import table_row

TEXTURE_SIZE = 256
"""Pixels along each side of every texture."""
DARKEST, BRIGHTEST = 0.05, 2.4
"""Smallest and largest factor of a texture."""


class Material(NamedTuple):
    """One row of the table."""

    name: str
    pattern: str  # one of ``patterns.PATTERNS``
    tile: float  # metres that one texture covers
    contrast: float  # 0 none .. 1 strong, around a mean of 1
    gloss: float  # share of mirrored sky at normal incidence
    translucency: float  # share of sunlight that passes through (leaves)


MATERIALS: tuple[Material, ...] = (
    Material("plain", "flat", 1.0, 0.0, 0.0, 0.0),
    Material("paint", "cloudy", 3.0, 0.06, 0.05, 0.0),
    Material("glass", "flat", 1.0, 0.0, 0.08, 0.0),
    Material("metal", "speckle", 2.0, 0.15, 0.04, 0.0),
    Material("rubber", "flat", 1.0, 0.0, 0.0, 0.0),
    Material("cloth", "cloudy", 0.5, 0.35, 0.0, 0.0),
    Material("skin", "flat", 1.0, 0.0, 0.0, 0.0),
    Material("brick", "brick", 1.8, 0.6, 0.0, 0.0),
    Material("plaster", "plaster", 6.0, 0.22, 0.0, 0.0),
    Material("concrete", "blotchy", 4.0, 0.35, 0.0, 0.0),
    Material("wood", "planks", 1.6, 0.6, 0.0, 0.0),
    Material("bark", "bark", 1.0, 0.8, 0.0, 0.0),
    Material("foliage", "leaves", 2.0, 0.8, 0.0, 0.35),
    Material("asphalt", "asphalt", LANE_TILE, 0.3, 0.0, 0.0),
    Material("paving", "slabs", 2.4, 0.5, 0.0, 0.0),
    Material("grass", "grass", 5.0, 0.65, 0.0, 0.0),
    Material("marking", "worn", 3.0, 0.5, 0.0, 0.0),
    Material("roof", "tiles", 2.4, 0.6, 0.0, 0.0),
    Material("lamp", "flat", 1.0, 0.0, 0.10, 0.0),
    # The ground, see ``surfaces.py``; those with wheel tracks cover the width of the carriageway. None
    # is glossy: at grazing angles even a slight gloss turns the ground into a mirror.
    Material("fresh asphalt", "fresh", 6.0, 0.26, 0.0, 0.0),
    Material("patched asphalt", "patched", LANE_TILE, 0.32, 0.0, 0.0),
    Material("tarred asphalt", "seams", LANE_TILE, 0.3, 0.0, 0.0),
    Material("chippings", "chippings", LANE_TILE, 0.5, 0.0, 0.0),
    Material("concrete road", "slab_road", LANE_TILE, 0.32, 0.0, 0.0),
    Material("setts", "setts", 4.0, 0.5, 0.0, 0.0),
    Material("flagstones", "flags", 2.4, 0.5, 0.0, 0.0),
    Material("pavers", "pavers", 1.6, 0.55, 0.0, 0.0),
    Material("herringbone", "herringbone", 1.6, 0.6, 0.0, 0.0),
    Material("cobbles", "cobbles", 2.0, 0.55, 0.0, 0.0),
    Material("tactile", "tactile", 0.8, 0.5, 0.0, 0.0),
    Material("long grass", "long_grass", 4.0, 0.9, 0.0, 0.0),
    Material("earth", "earth", 6.0, 0.6, 0.0, 0.0),
    Material("gravel", "gravel", 2.0, 0.6, 0.0, 0.0),
    Material("fallen leaves", "litter", 3.0, 0.9, 0.0, 0.0),
    Material("iron", "grating", 0.5, 0.7, 0.0, 0.0),
    # The exception: water mirrors the sky at grazing angles.
    Material("water", "flat", 1.0, 0.0, 0.03, 0.0),
    Material("mended asphalt", "mended", 7.0, 0.3, 0.0, 0.0),
    Material("fine chippings", "gravel", 1.5, 0.3, 0.0, 0.0),
    Material("bare patches", "bare", 6.0, 0.75, 0.0, 0.0),
)
MATERIAL_ID: dict[str, int] = {m.name: i for i, m in enumerate(MATERIALS)}


def material_id(name: str) -> int:
    """Index of a material; raises ValueError naming the known ones."""
    if name not in MATERIAL_ID:
        raise ValueError(f"unknown material {name!r}; {hint(name, MATERIAL_ID)}")
    return MATERIAL_ID[name]


def _texture(index: int, material: Material) -> np.ndarray:
    """A multiplier f32[size, size] around 1; nearly all of it is within 1 -+ 0.8 contrast."""
    rng = table_row("textures", index)
    pattern = PATTERNS[material.pattern](rng, TEXTURE_SIZE).astype(np.float32)
    centred = pattern - pattern.mean()
    # Not the maximum: a few dark cracks must not flatten the rest.
    span = max(float(np.quantile(np.abs(centred), 0.98)), 1e-6)
    texture = (1 + 0.8 * material.contrast * centred / span).clip(DARKEST, BRIGHTEST)
    return texture / texture.mean()


@cache
def textures() -> np.ndarray:
    """Every material's texture, f32[materials, size, size], a multiplier with mean 1 (read-only)."""
    stack = np.stack([_texture(i, m) for i, m in enumerate(MATERIALS)]).astype(np.float32)
    stack.setflags(write=False)
    return stack
