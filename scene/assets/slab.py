"""Tiles of asphalt or paving for parking places (class road), laid side by side on the ground."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.family import FOOTWAY, Family, Size
from scene.classes import TrainId
from scene.look.surfaces import ROAD_TONE
from scene.mesh.asset import Asset, Color, merge, vary
from scene.mesh.solids import box, quad

BAY: tuple[float, float] = (2.5, 5.2)
"""Metres of one tile along x and y: a place for one car that stands across x."""
THICK, PAINT = 0.012, 0.016
"""Heights of the surface and of what is painted on it, metres."""
LINE = 0.1
"""Width of painted lines, metres."""
WHITE: Color = (0.56, 0.56, 0.53)


class SlabParams(NamedTuple):
    """One tile."""

    color: Color
    material: str
    lines: str  # "", "sides", "ticks" or "box"
    paint: Color


_KINDS: dict[str, tuple[Color, str, str]] = {
    "bare asphalt": ((0.10, 0.10, 0.103), "fresh asphalt", ""),
    "asphalt bay": ((0.09, 0.09, 0.093), "fresh asphalt", "sides"),
    "paved bay": ((0.17, 0.16, 0.145), "pavers", ""),
    "ticked bay": ((0.12, 0.12, 0.122), "fresh asphalt", "ticks"),
    "boxed bay": ((0.075, 0.076, 0.08), "fresh asphalt", "box"),
}
KINDS: tuple[str, ...] = tuple(_KINDS)


def sample_slab(rng: np.random.Generator, kind: str) -> SlabParams:
    """Draw a tile of one of ``KINDS``."""
    color, material, lines = _KINDS[kind]
    return SlabParams(vary(rng, color, 0.45), material, lines, vary(rng, WHITE, 0.2))


def slab(params: SlabParams) -> Asset:
    """Build the tile, centred on the origin."""
    p, (x, y) = params, (BAY[0] / 2, BAY[1] / 2)
    rows: list[tuple[float, float, float, float]] = []  # x from, x to, y from, y to
    if p.lines in ("sides", "box"):
        rows.append((-x, -x + LINE, -y, y))
    if p.lines == "box":
        rows.append((-x, x, y - LINE, y))
    if p.lines == "ticks":
        rows += [(-x, -x + LINE, s * y - 0.4, s * y + 0.4) for s in (-0.8, 0.8)]
    marks = [
        quad([(a, c, PAINT), (b, c, PAINT), (b, d, PAINT), (a, d, PAINT)], p.paint, "marking")
        for a, b, c, d in rows
    ]
    return merge(box((*BAY, THICK), (0, 0, 0), p.color, p.material), *marks)


FAMILY = Family(
    "slab", TrainId.ROAD, KINDS, sample_slab, slab,
    count=10, size=Size((1, 30), (0.001, 0.3)), tone=ROAD_TONE, line=None, stage=FOOTWAY,
)  # fmt: skip
