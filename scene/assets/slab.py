"""Tiles of parking places (class road; those of pavers have none), laid side by side on the ground."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.family import FOOTWAY, Family, Size
from scene.assets.parts.draw import between, near, sample_fields
from scene.assets.parts.palette import SLAB_WHITE, darker
from scene.classes import TrainId
from scene.look.surfaces import ROAD_TONE
from scene.mesh.asset import Asset, Color, ignore, merge
from scene.mesh.solids import box, polygon

BAY: tuple[float, float] = (2.5, 5.2)
"""Size of a tile along x and y (metres): a place for one car parked along y."""
THICK, PAINT = 0.012, 0.016
"""Heights of the surface and of paint on it (metres)."""
LINE = 0.1
"""Width of painted lines (metres)."""


class SlabParams(NamedTuple):
    """One tile."""

    color: Color
    material: str = "fresh asphalt"
    lines: str = ""  # "", "sides", "ticks" or "box"
    paint: Color = SLAB_WHITE
    stain: tuple[float, float, float] = (0.0, 0.0, 0.2)  # of oil: x, y and radius, m


_KINDS: dict[str, SlabParams] = {
    "bare asphalt": SlabParams((0.10, 0.10, 0.103)),
    "asphalt bay": SlabParams((0.09, 0.09, 0.093), lines="sides"),
    "paved bay": SlabParams((0.17, 0.16, 0.145), "pavers"),
    "ticked bay": SlabParams((0.12, 0.12, 0.122), lines="ticks"),
    "boxed bay": SlabParams((0.075, 0.076, 0.08), lines="box"),
}


def sample_slab(rng: np.random.Generator, kind: str) -> SlabParams:
    """Draw a tile of one kind."""
    stain = (between(-0.35, 0.35), between(-1.6, 1.6), float(rng.uniform(0.2, 0.8)))
    return sample_fields(rng, _KINDS[kind], stain=stain, color=near(0.45), paint=near(0.2))


def slab(p: SlabParams) -> Asset:
    """Build the tile, centred on the origin."""
    (x, y) = (BAY[0] / 2, BAY[1] / 2)
    rows: list[tuple[float, float, float, float]] = []  # x from, x to, y from, y to
    if p.lines in ("sides", "box"):
        rows.append((-x, -x + LINE, -y, y))
    if p.lines == "box":
        rows.append((-x, x, y - LINE, y))
    if p.lines == "ticks":
        rows += [(-x, -x + LINE, s * y - 0.4, s * y + 0.4) for s in (-0.8, 0.8)]
    marks = [
        polygon([(a, c, PAINT), (b, c, PAINT), (b, d, PAINT), (a, d, PAINT)], p.paint, "marking")
        for a, b, c, d in rows
    ]
    stain_x, stain_y, spread = p.stain
    turn = np.arange(9) * 2 * np.pi / 9
    rim = spread * (1 + 0.25 * np.cos(2 * turn + stain_y))
    outline = np.column_stack([stain_x + rim * np.cos(turn), stain_y + 1.3 * rim * np.sin(turn)])
    flat = np.column_stack([outline, np.full(9, (THICK + PAINT) / 2)])
    marks.append(polygon(flat, darker(p.color, 0.7), p.material))
    tile = merge(box((*BAY, THICK), (0, 0, 0), p.color, p.material), *marks)
    return ignore(tile) if p.material == "pavers" else tile  # paved parking has no class


FAMILY = Family(
    "slab", TrainId.ROAD, tuple(_KINDS), sample_slab, slab,
    count=10, size=Size((1, 30), (0.001, 0.3)), tone=ROAD_TONE, line=None, stage=FOOTWAY,
)  # fmt: skip
