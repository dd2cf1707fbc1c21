"""Bus shelters, kiosks and market stalls on sidewalks (class building), their front in the plane y = 0."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np

from scene.assets.family import FRONTAGE, Family, Size
from scene.assets.parts.palette import (
    ANTHRACITE,
    BRICK,
    GALVANISED,
    GLASS,
    SHELTER_TIMBER,
    SHELTER_WHITE,
    darker,
    pick,
)
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Parts, Point, merge, rotate, translate, vary
from scene.mesh.solids import box, extrude, loft, polygon

CLOTHS: tuple[Color, ...] = (
    (0.38, 0.03, 0.03), (0.03, 0.10, 0.35), (0.04, 0.20, 0.09), (0.50, 0.32, 0.03), (0.30, 0.05, 0.16),
)  # fmt: skip
GOODS: tuple[Color, ...] = (
    (0.50, 0.22, 0.02), (0.35, 0.03, 0.03), (0.10, 0.26, 0.04), (0.55, 0.45, 0.05), (0.20, 0.05, 0.16),
)  # fmt: skip
POSTERS: tuple[Color, ...] = (
    (0.05, 0.20, 0.45), (0.50, 0.08, 0.10), (0.55, 0.50, 0.42), (0.10, 0.32, 0.16), (0.45, 0.28, 0.04),
)  # fmt: skip


class ShelterParams(NamedTuple):
    """One shelter, stall or kiosk."""

    kind: str
    size: tuple[float, float, float]  # along x, y and z, m
    frame: Color
    cover: Color
    second_color: Color  # of posters, benches or the awning
    seed: int


def sample_shelter(rng: np.random.Generator, kind: str) -> ShelterParams:
    """Draw a shelter of one kind."""
    is_stall = kind in STALLS
    length = float(rng.uniform(2.2, 3.4) if is_stall else rng.uniform(2.8, 5.2))
    size = (length, float(rng.uniform(1.3, 1.9)), float(rng.uniform(2.3, 2.7)))
    choices: dict[Any, Color] = {
        k: colors[rng.integers(len(colors))] for k, colors in _COLOR_SETS.items()
    }
    frame, cover, second_color = (choices.get(color, color) for color in _KINDS[kind].colors)
    return ShelterParams(
        kind, size, vary(rng, frame, 0.3), vary(rng, cover, 0.25), vary(rng, second_color, 0.25),
        int(rng.integers(2**31)),
    )  # fmt: skip


def _posts(p: ShelterParams, inset: float = 0.06, gauge: float = 0.07) -> Parts:
    x, (_, y, z) = p.size[0] / 2 - inset, p.size
    for post_x, post_y in product((-x, x), (inset, y - inset)):
        yield box((gauge, gauge, z), (post_x, post_y, 0), p.frame, "metal")


def _glazed(p: ShelterParams, ends: tuple[int, ...] = (1,)) -> Parts:
    """Build posts, a glazed back, a bench and a flat roof, with posters at ``ends``."""
    x, y, z = p.size
    yield from _posts(p)
    yield box((x + 0.3, y + 0.35, 0.09), (0, y / 2, z), darker(p.frame, 0.8), "metal")
    for level in (0.25, 0.95, 1.9):
        yield box((x, 0.04, 0.05), (0, y - 0.06, level), p.frame, "metal")
    panes = max(2, round(x / 1.2))
    for k in range(panes):
        middle = (k + 0.5) * x / panes - x / 2
        yield box((0.62 * x / panes, 0.012, 0.6), (middle, y - 0.06, 0.32), GLASS, "glass")
        edge = middle + 0.5 * x / panes - 0.04
        yield box((0.045, 0.05, z), (edge, y - 0.06, 0), p.frame, "metal")
    yield box((0.7 * x, 0.3, 0.05), (0, y - 0.35, 0.48), p.frame, "metal")
    for s in ends:
        end_x = s * (x / 2 - 0.06)
        yield box((0.16, 0.8 * y, 1.75), (end_x, y / 2, 0.3), ANTHRACITE, "paint")
        for poster_x in (end_x - 0.085, end_x + 0.085):
            yield box((0.008, 0.66 * y, 1.5), (poster_x, y / 2, 0.42), p.second_color, "lamp")
            yield box((0.01, 0.4 * y, 0.35), (poster_x, y / 2, 1.2), SHELTER_WHITE, "paint")


def _cantilever(p: ShelterParams) -> Parts:
    """Build a curved roof on two posts at the back."""
    x, y, z = p.size
    section = ((-x / 2, 0.0), (x / 2, 0.0), (x / 2, 0.05), (-x / 2, 0.05))
    rings = [
        [(side, y - (y + 0.25) * rise / np.sin(1.2), z - 0.55 + 0.6 * rise + lift) for side, lift in section]
        for rise in np.sin(np.linspace(0.0, 1.2, 7)).tolist()
    ]  # fmt: skip
    yield loft(np.array(rings), darker(p.cover, 0.7), "paint")
    yield box((0.8 * x, 0.12, 0.08), (0, y - 0.25, 0.7), p.frame, "metal")
    yield box((0.9, 0.06, 1.2), (0, y - 0.1, 0.8), p.second_color, "lamp")
    for s in (-1, 1):
        yield box((0.1, 0.1, z - 0.5), (s * 0.32 * x, y - 0.08, 0), p.frame, "metal")


def _walled(p: ShelterParams, material: str) -> Parts:
    """Build walls on three sides and a pitched roof."""
    x, y, z = p.size
    low = z - 0.3
    yield box((x, 0.14, low), (0, y - 0.07, 0), p.frame, material)
    for s in (-1, 1):
        yield box((0.14, y - 0.14, low), (s * (x / 2 - 0.07), (y - 0.14) / 2, 0), p.frame, material)
    half = y / 2 + 0.2
    roof = [
        [(at, y / 2 - half, low), (at, y / 2 + half, low), (at, y / 2, low + 0.65)]
        for at in (-x / 2 - 0.2, x / 2 + 0.2)
    ]
    yield loft(np.array(roof), p.cover, "roof")
    yield box((x - 0.4, 0.35, 0.06), (0, y - 0.35, 0.45), p.second_color, "wood")
    yield box((0.4 * x, 0.02, 0.6), (0, y - 0.15, 1.2), GLASS, "glass")
    yield box((x, 0.12, 0.16), (0, 0.1, low - 0.16), p.second_color, "wood")


def _stall(p: ShelterParams, *, produce: bool = False) -> Parts:
    """Build a table with goods under a striped cloth, or for ``produce`` a wooden one under a plain cloth."""
    x, y, z = p.size
    rng = np.random.default_rng(p.seed)
    yield from _posts(p, 0.05, 0.05)
    table, high = (0.72, 0.5) if produce else (0.85, 0.62)
    finish = (SHELTER_TIMBER, "wood") if produce else (darker(p.cover, 0.7), "cloth")
    yield box((x, high * y, table), (0, 0.1 + high * y / 2, 0), *finish)
    across = max(3, round(x / 0.45))
    for k, row in product(range(across), range(2)):
        color = pick(rng, GOODS, 0.35)
        size: Point = (0.8 * x / across, 0.22 * y, float(rng.uniform(0.08, 0.3)))
        base = (k + 0.5) * x / across - x / 2, 0.28 + 0.25 * y * row, table
        yield box(size, base, color, "cloth")
    stripes = 2 * max(3, round(x / 0.7))
    for k in range(stripes):
        a, b = (-x / 2 - 0.15 + (x + 0.3) * (k + d) / stripes for d in (0, 1))
        color = p.cover if k % 2 == 0 or produce else SHELTER_WHITE
        edge = [(-0.35, z - 0.32), (-0.35, z - 0.1), (y / 2, z + 0.45), (y + 0.2, z)]
        for (y0, z0), (y1, z1) in pairwise(edge):
            corners: list[Point] = [(a, y0, z0), (b, y0, z0), (b, y1, z1), (a, y1, z1)]
            yield polygon(corners, color, "cloth")


def _kiosk(p: ShelterParams) -> Parts:
    """Build a closed hut with a hatch, papers below the hatch and an awning above it."""
    x, y, z = p.size
    rng = np.random.default_rng(p.seed)
    yield box((x, y, z), (0, y / 2, 0), p.frame, "paint")
    yield box((x + 0.25, y + 0.25, 0.18), (0, y / 2, z), p.cover, "metal")
    yield box((0.72 * x, 0.06, 0.85), (0, -0.01, 1.05), GLASS, "glass")
    yield box((0.8 * x, 0.3, 0.05), (0, -0.12, 0.98), GALVANISED, "metal")
    for k in range(5):
        color = pick(rng, POSTERS, 0.3)
        yield box((0.13 * x, 0.03, 0.5), ((k - 2) * 0.17 * x, -0.02, 0.35), color, "paint")
    awning = extrude(
        [(0.0, 0.0), (0.9, -0.35), (0.9, -0.3), (0.0, 0.06)], 0.9 * x, p.second_color, "cloth"
    )
    yield translate(rotate(awning, -np.pi / 2, (0, 0, 1)), (0, 0, z - 0.1))


class _Kind(NamedTuple):
    """How a kind is built, and its colours of frame, cover and the rest (``second_color``)."""

    build: Callable[[ShelterParams], Parts]
    colors: tuple[Any, Any, Any] = ("metal", "cloth", "poster")  # or names of ``_COLOR_SETS``


_COLOR_SETS: dict[str, tuple[Color, ...]] = {
    "hut": CLOTHS, "awning": CLOTHS, "metal": (GALVANISED, ANTHRACITE), "cloth": CLOTHS,
    "poster": POSTERS,
}  # fmt: skip
"""Named sets of colours; one of each is drawn."""
_KINDS: dict[str, _Kind] = {
    "glass shelter": _Kind(_glazed),
    "market stall": _Kind(_stall),
    "advert shelter": _Kind(partial(_glazed, ends=(-1, 1))),
    "produce stall": _Kind(partial(_stall, produce=True)),
    "cantilever shelter": _Kind(_cantilever),
    "kiosk": _Kind(_kiosk, ("hut", ANTHRACITE, "awning")),
    "brick shelter": _Kind(partial(_walled, material="brick"),
                          (BRICK, (0.10, 0.05, 0.035), SHELTER_TIMBER)),
    "timber shelter": _Kind(partial(_walled, material="wood"),
                           (SHELTER_TIMBER, (0.06, 0.055, 0.05), SHELTER_TIMBER)),
}  # fmt: skip
SHELTERS: tuple[str, ...] = tuple(name for name in _KINDS if "shelter" in name)
STALLS: tuple[str, ...] = tuple(name for name in _KINDS if name not in SHELTERS)


def shelter(params: ShelterParams) -> Asset:
    """Build the shelter, stall or kiosk."""
    return merge(*_KINDS[params.kind].build(params))


FAMILY = Family(
    "shelter", TrainId.BUILDING, tuple(_KINDS), sample_shelter, shelter,
    count=24, size=Size((1, 15), (1.5, 6)), tone=0.8, line=None, facing="road", front="right",
    stage=FRONTAGE,
)  # fmt: skip
