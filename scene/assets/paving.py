"""Paving apart from the sidewalk (class sidewalk): traffic islands, and pieces of paths through parks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.family import ROAD, Family, Size
from scene.assets.parts.draw import keep, near, sample_fields, times
from scene.assets.parts.palette import PALE_STONE
from scene.classes import TrainId
from scene.look.surfaces import SIDEWALK_TONE
from scene.mesh.asset import Asset, Color, merge
from scene.mesh.solids import box, loft, polygon

PATH: tuple[float, float] = (2.0, 2.2)
"""Size of a piece of path along x, and its usual size along y (metres); paths run along x."""
CURB = 0.12
"""Width of kerb stones (metres)."""


class PavingParams(NamedTuple):
    """One island or piece of path."""

    size: tuple[float, float, float]  # m
    nose: float  # length of the rounded ends, m; 0 for a plain box
    color: Color
    material: str
    kerb: Color


_ISLAND = PavingParams((4.5, 1.5, 0.13), 0.7, (0.20, 0.195, 0.185), "paving", PALE_STONE)
_PATH = PavingParams((*PATH, 0.02), 0.0, (0.17, 0.165, 0.155), "paving", PALE_STONE)
_KINDS: dict[str, PavingParams] = {
    "slab island": _ISLAND,
    "asphalt path": _PATH._replace(color=(0.09, 0.09, 0.092), material="fresh asphalt"),
    "setts island": _ISLAND._replace(color=(0.13, 0.125, 0.12), material="setts"),
    "gravel path": _PATH._replace(color=(0.23, 0.21, 0.175), material="gravel"),
    "narrow island": _ISLAND._replace(
        size=(5.5, 0.9, 0.15), nose=0.45, color=(0.11, 0.11, 0.11), material="fresh asphalt"
    ),
    "slab path": _PATH,
    "block island": _ISLAND._replace(nose=0.0, size=(3.2, 1.6, 0.14), color=(0.16, 0.09, 0.065),
                                     material="pavers"),
    "brick path": _PATH._replace(color=(0.18, 0.11, 0.085), material="pavers"),
}  # fmt: skip


def sample_paving(rng: np.random.Generator, kind: str) -> PavingParams:
    """Draw a piece of one kind; paths keep their length, so that pieces meet."""
    island = (times(0.85, 1.25), times(0.9, 1.15), keep)
    size = (keep, times(0.6, 1.2), keep) if "path" in kind else island
    return sample_fields(rng, _KINDS[kind], color=near(0.35), kerb=near(0.3), size=size)


def paving(p: PavingParams) -> Asset:
    """Build the piece, centred on the origin."""
    (x, y, z) = p.size
    if z < 0.1:
        return box(p.size, (0, 0, 0), p.color, p.material)
    inner = _outline(x - 2 * CURB, y - 2 * CURB, max(p.nose - CURB, 0.0))
    outer = _outline(x, y, p.nose)
    top = [np.column_stack([ring, np.full(len(ring), z)]) for ring in (outer, inner)]
    foot = np.column_stack([outer, np.zeros(len(outer))])
    kerb = loft(np.array([foot, *top]), p.kerb, "concrete", caps=False)
    middle = np.column_stack([inner, np.full(len(inner), z)])
    return merge(kerb, polygon(middle, p.color, p.material))


def _outline(x: float, y: float, nose: float) -> np.ndarray:
    """Return a rectangle f64[n, 2] whose ends are half ellipses of length ``nose``."""
    if nose <= 0:
        return np.array([[x, y], [-x, y], [-x, -y], [x, -y]]) / 2
    turn = np.linspace(-np.pi / 2, np.pi / 2, 9)
    ahead = np.column_stack([x / 2 - nose + nose * np.cos(turn), y / 2 * np.sin(turn)])
    return np.concatenate([ahead, -ahead])


FAMILY = Family(
    "paving", TrainId.SIDEWALK, tuple(_KINDS), sample_paving, paving,
    count=16, size=Size((0.5, 30), (0.005, 0.6)), tone=SIDEWALK_TONE, line=None, stage=ROAD,
)  # fmt: skip
