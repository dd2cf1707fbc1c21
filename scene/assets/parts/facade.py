"""A wall in the plane y = 0 with real openings, and the windows and doors in them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scene.assets.parts.palette import WINDOW, darker
from scene.assets.parts.skin import Span
from scene.mesh.asset import Asset, Color, Point, merge, solid
from scene.mesh.solids import block, polygon, quads

RECESS = 0.14
"""Distance of the frames behind the facade (metres)."""
PANE = 0.09
"""Distance of panes and doors behind the facade (metres), in front of the frames."""
PROUD = 0.04
"""Distance of flat ornaments from the wall they are on (metres)."""
SILL = 0.08
"""Depth of sills (metres)."""
BAR = 0.06
"""Width of the bars between panes (metres)."""
LOOKS: tuple[tuple[str, float], ...] = (
    ("dark", 0.50), ("curtains", 0.18), ("blind", 0.12), ("sky", 0.08), ("nets", 0.12),
)  # fmt: skip
"""What windows show, and how often."""
_UP_TO = np.cumsum([share for _, share in LOOKS])
_UP_TO /= _UP_TO[-1]


Finish = tuple[Color, str]
"""Colour and material of a wall."""


class Opening(NamedTuple):
    """A hole in the facade, metres."""

    left: float
    right: float
    low: float
    high: float
    glazed: bool = True


class Patch(NamedTuple):
    """A flat face with four corners, in order around its edge.

    ``assemble`` turns all patches of a building into one mesh at once, which is faster.
    """

    corners: list[Point]
    color: Color
    material: str = "plain"


Part = Asset | Patch


def assemble(parts: Sequence[Part]) -> Asset:
    """Merge ``parts`` into one asset: first the patches as one mesh, then the solids in order."""
    patches = [part for part in parts if isinstance(part, Patch)]
    corners = np.array([p.corners for p in patches])
    flat = quads(corners, [p.color for p in patches], [p.material for p in patches])
    return merge(flat, *(part for part in parts if isinstance(part, Asset)))


def relief(low: Point, high: Point, color: Color, material: str = "plain") -> Asset:
    """Build a block set into the wall, without its invisible back."""
    solid_block = block(low, high, color, material)
    visible = np.r_[0:6, 8:12]
    return solid(solid_block.mesh.vertices, solid_block.mesh.faces[visible], color, material)


def upright(left: float, right: float, low: float, high: float, y: float) -> list[Point]:
    """Return the corners of an upright rectangle that faces the road."""
    return [(left, y, low), (right, y, low), (right, y, high), (left, y, high)]


def bays(width: float, count: int, share: float) -> list[Span]:
    """Return the left and right edge of an opening in each of ``count`` bays, ``share`` of the bay wide."""
    pitch = width / count
    middles = (np.arange(count) + 0.5) * pitch - width / 2
    return [(float(m - share * pitch / 2), float(m + share * pitch / 2)) for m in middles]


def pierced_wall(
    width: float, levels: Span, columns: Sequence[Sequence[Opening]], finish: Finish
) -> Iterable[Part]:
    """Build the wall between two ``levels`` around its openings.

    Args:
        width: of the wall, centred on x = 0 (metres).
        levels: of its foot and its top (metres).
        columns: from left to right, equally wide openings above one another, from the foot up.
        finish: of the wall.

    Returns:
        Piers of the full height, the wall below, between and above the openings of each column, and the
        reveals, which show the thickness of the wall.
    """
    low, high = levels
    edges = [-width / 2, *(e for c in columns for e in (c[0].left, c[0].right)), width / 2]
    areas = [(a, b, low, high) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    for column in columns:
        bounds = [low, *(z for o in column for z in (o.low, o.high)), high]
        gaps = zip(bounds[::2], bounds[1::2], strict=True)
        areas += [(column[0].left, column[0].right, a, b) for a, b in gaps]
    yield from (Patch(upright(*area, 0), *finish) for area in areas)
    for column in columns:
        for opening in column:
            yield from _reveals(opening, finish)


def _reveals(opening: Opening, finish: Finish) -> Iterable[Part]:
    """Build the reveals of an opening: sides, head and foot."""
    left, right, low, high, _ = opening
    for x in (left, right):
        yield Patch([(x, 0, low), (x, RECESS, low), (x, RECESS, high), (x, 0, high)], *finish)
    for z in (low, high):
        yield Patch([(left, 0, z), (right, 0, z), (right, RECESS, z), (left, RECESS, z)], *finish)


def arch(opening: Opening, finish: Finish, *, pointed: bool) -> Iterable[Part]:
    """Build the spandrels that turn the head of an opening into a round or pointed arch; 5 faces each."""
    left, right, _, high, _ = opening
    middle, half = (left + right) / 2, (right - left) / 2
    rise = half * (1.6 if pointed else 1.0)
    if pointed:  # an arc around the opposite springing point
        turn = np.linspace(0, np.pi / 3, 6)
        across, up = 2 * np.cos(turn) - 1, np.sin(turn) / np.sin(np.pi / 3)
    else:
        turn = np.linspace(0, np.pi / 2, 6)
        across, up = np.cos(turn), np.sin(turn)
    bow = np.column_stack([across, up]).tolist()
    for reach in (-half, half):
        edge = [(middle + reach * a, 0.0, high - rise + rise * u) for a, u in bow]
        yield polygon([(middle + reach, 0.0, high), *edge], *finish)


def window(
    rng: np.random.Generator, opening: Opening, panes: tuple[int, int], curtain: Color
) -> Iterable[Part]:
    """Build ``panes`` across and up; behind some windows are curtains, nets or a blind.

    The darkness of the room and how far the blind is down are random.
    """
    left, right, low, high, _ = opening
    look, _ = LOOKS[np.searchsorted(_UP_TO, rng.random(), side="right")]
    room, blind_share = float(np.exp(rng.normal(0, 0.8))), float(rng.uniform(0.25, 0.95))
    glass = (0.15, 0.18, 0.21) if look == "sky" else darker(WINDOW, room)
    split = {"blind": high - blind_share * (high - low), "nets": low + blind_share * (high - low)}
    edge = split.get(look, high)
    across, up = np.linspace(left, right, panes[0] + 1), np.linspace(low, high, panes[1] + 1)
    half, curtain_width = BAR / 2, 0.22 * (right - left)
    for z0, z1 in pairwise(up):
        for column, (x0, x1) in enumerate(pairwise(across)):
            x, z = (x0 + half, x1 - half), (z0 + half, z1 - half)
            if look == "curtains":
                a = x[0] + curtain_width * (column == 0)
                b = x[1] - curtain_width * (column == panes[0] - 1)
                areas = [(x[0], a, *z, curtain), (a, b, *z, glass), (b, x[1], *z, curtain)]
            else:
                level = min(max(edge, z[0]), z[1])
                below, above = (curtain, glass) if look == "nets" else (glass, curtain)
                areas = [(*x, z[0], level, below), (*x, level, z[1], above)]
            for a, b, c, d, color in areas:
                if b > a + 1e-6 and d > c + 1e-6:
                    yield Patch(upright(a, b, c, d, PANE), color, "glass")


def door(opening: Opening, color: Color) -> Iterable[Part]:
    """Build a panelled door, with a window over it and a step in front of it where there is room."""
    left, right, low, high, _ = opening
    head = min(high, low + 2.15)
    inset, middle = 0.18 * (right - left), (low + head) / 2
    yield Patch(upright(left, right, low, head, PANE), color, "paint")
    for z0, z1 in ((low + 0.2, middle - 0.08), (middle + 0.08, head - 0.2)):
        panel = upright(left + inset, right - inset, z0, z1, PANE - PROUD)
        yield Patch(panel, darker(color), "paint")
    if high - head > 0.2:
        light = upright(left + 0.05, right - 0.05, head + 0.06, high - 0.05, PANE)
        yield Patch(light, WINDOW, "glass")
    if low > 0.05:
        step = (left - 0.15, -0.35, 0), (right + 0.15, 0.05, low)
        yield relief(*step, (0.30, 0.28, 0.25), "concrete")


def sill(opening: Opening, color: Color) -> Iterable[Part]:
    """Build the front and the top of a sill below a window."""
    left, right, low = opening.left - 0.08, opening.right + 0.08, opening.low
    top = [(left, 0, low), (right, 0, low), (right, -SILL, low), (left, -SILL, low)]
    yield Patch(upright(left, right, low - 0.11, low, -SILL), color, "plaster")
    yield Patch(top, color, "plaster")


def lintel(opening: Opening, color: Color) -> Part:
    """Build a band of stone over an opening."""
    left, right, high = opening.left - 0.12, opening.right + 0.12, opening.high
    return Patch(upright(left, right, high, high + 0.2, -PROUD), color, "plaster")


def side_window(x: float, middle: float, low: float, high: float, frame: Color) -> Iterable[Part]:
    """Build a framed window laid on the outside of the side wall in the plane ``x``."""
    side = 1 if x > 0 else -1
    layers = ((PROUD, 0.55, 0.0, frame, "paint"), (2 * PROUD, 0.45, 0.1, WINDOW, "glass"))
    for distance, half, margin, color, material in layers:
        plane, foot, head = x + side * distance, low + margin, high - margin
        left, right = middle - half, middle + half
        corners = [
            (plane, left, foot),
            (plane, right, foot),
            (plane, right, head),
            (plane, left, head),
        ]
        yield Patch(corners, color, material)
