"""A wall with real openings in the plane y = 0, and what fills them behind it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scene.assets.parts.palette import WINDOW, darker
from scene.mesh.asset import Asset, Color, Point, merge, solid
from scene.mesh.solids import block, polygon, quads

RECESS = 0.14
"""Depth of the frames behind the facade (metres)."""
PANE = 0.09
"""Depth of panes and doors behind the facade: they stand before the frames (metres)."""
PROUD = 0.04
"""How far what is laid on a wall stands off it (metres)."""
SILL = 0.08
"""How far sills stand off the wall (metres)."""
BAR = 0.06
"""Width of the bars between panes (metres)."""
LOOKS: tuple[tuple[str, float], ...] = (
    ("dark", 0.50), ("curtains", 0.18), ("blind", 0.12), ("sky", 0.08), ("nets", 0.12),
)  # fmt: skip
"""What one sees in a window, and how often."""
_UP_TO = np.cumsum([share for _, share in LOOKS])
_UP_TO /= _UP_TO[-1]


class Opening(NamedTuple):
    """A hole in the facade, metres."""

    left: float
    right: float
    low: float
    high: float
    glazed: bool = True


class Patch(NamedTuple):
    """A flat four-cornered face, corners in order around its edge.

    Hundreds of them are quicker to put together at once.
    """

    corners: list[Point]
    color: Color
    material: str = "plain"


Part = Asset | Patch


def assemble(parts: Sequence[Part]) -> Asset:
    """One asset of all ``parts``: the patches in one mesh, then the solids in order."""
    patches = [part for part in parts if isinstance(part, Patch)]
    corners = np.array([p.corners for p in patches])
    flat = quads(corners, [p.color for p in patches], [p.material for p in patches])
    return merge(flat, *(part for part in parts if isinstance(part, Asset)))


def relief(low: Point, high: Point, color: Color, material: str = "plain") -> Asset:
    """A block let into the wall: without the back, which nobody sees."""
    whole = block(low, high, color, material)
    seen = np.r_[0:6, 8:12]
    return solid(whole.mesh.vertices, whole.mesh.faces[seen], color, material)


def upright(left: float, right: float, low: float, high: float, y: float) -> list[Point]:
    """Corners of an upright rectangle that faces the road."""
    return [(left, y, low), (right, y, low), (right, y, high), (left, y, high)]


def bays(width: float, count: int, share: float) -> list[tuple[float, float]]:
    """Left and right edge of an opening in each of ``count`` bays, ``share`` of the bay wide."""
    pitch = width / count
    middles = (np.arange(count) + 0.5) * pitch - width / 2
    return [(float(m - share * pitch / 2), float(m + share * pitch / 2)) for m in middles]


def pierced_wall(
    width: float,
    levels: tuple[float, float],
    columns: Sequence[Sequence[Opening]],
    color: Color,
    material: str,
) -> list[Part]:
    """The wall between two ``levels`` around its openings.

    Args:
        width: of the wall, centred on x = 0 (metres).
        levels: of its foot and its top (metres).
        columns: openings above one another, equally wide; from left to right, from the foot up.
        color: of the wall.
        material: of the wall.

    Returns:
        Piers of the full height, what is below, between and above the openings of a column, and the
        reveals, which make an opening as deep as the wall.
    """
    low, high = levels
    edges = [-width / 2, *(e for c in columns for e in (c[0].left, c[0].right)), width / 2]
    areas = [(a, b, low, high) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    for column in columns:
        bounds = [low, *(z for o in column for z in (o.low, o.high)), high]
        gaps = zip(bounds[::2], bounds[1::2], strict=True)
        areas += [(column[0].left, column[0].right, a, b) for a, b in gaps]
    wall: list[Part] = [Patch(upright(*area, 0), color, material) for area in areas]
    return wall + [r for column in columns for o in column for r in _reveals(o, color, material)]


def _reveals(opening: Opening, color: Color, material: str) -> list[Part]:
    """The sides, the head and the foot of an opening."""
    left, right, low, high, _ = opening
    sides = [
        [(x, 0, low), (x, RECESS, low), (x, RECESS, high), (x, 0, high)] for x in (left, right)
    ]
    ends = [
        [(left, 0, z), (right, 0, z), (right, RECESS, z), (left, RECESS, z)] for z in (low, high)
    ]
    return [Patch(corners, color, material) for corners in sides + ends]


def arch(opening: Opening, color: Color, material: str, *, pointed: bool) -> list[Part]:
    """The spandrels that turn the head of an opening into a round or pointed arch; 5 faces each."""
    left, right, _, high, _ = opening
    middle, half = (left + right) / 2, (right - left) / 2
    rise = half * (1.6 if pointed else 1.0)
    turn = np.linspace(0, np.pi / 2, 6)
    if pointed:  # an arc about the far springing point
        turn = np.linspace(0, np.pi / 3, 6)
        across, up = 2 * np.cos(turn) - 1, np.sin(turn) / np.sin(np.pi / 3)
    else:
        across, up = np.cos(turn), np.sin(turn)
    return [
        polygon(
            [(middle + s * half, 0.0, high)]
            + [
                (middle + s * half * float(a), 0.0, high - rise + rise * float(u))
                for a, u in zip(across, up, strict=True)
            ],
            color,
            material,
        )
        for s in (-1, 1)
    ]


def window(
    rng: np.random.Generator, opening: Opening, panes: tuple[int, int], curtain: Color
) -> list[Part]:
    """Panes of glass, so many across and up; behind some of them curtains, nets or a blind.

    Rooms are more or less dark, and blinds are drawn as far as somebody cared to.
    """
    left, right, low, high, _ = opening
    look, _ = LOOKS[np.searchsorted(_UP_TO, rng.random(), side="right")]
    room, drawn_to = float(np.exp(rng.normal(0, 0.8))), float(rng.uniform(0.25, 0.95))
    glass = (0.15, 0.18, 0.21) if look == "sky" else darker(WINDOW, room)
    split = {"blind": high - drawn_to * (high - low), "nets": low + drawn_to * (high - low)}
    cut = split.get(look, high)
    across, up = np.linspace(left, right, panes[0] + 1), np.linspace(low, high, panes[1] + 1)
    half, drawn = BAR / 2, 0.22 * (right - left)
    parts: list[Part] = []
    for z0, z1 in pairwise(up):
        for column, (x0, x1) in enumerate(pairwise(across)):
            x, z = (x0 + half, x1 - half), (z0 + half, z1 - half)
            if look == "curtains":
                a, b = x[0] + drawn * (column == 0), x[1] - drawn * (column == panes[0] - 1)
                areas = [(x[0], a, *z, curtain), (a, b, *z, glass), (b, x[1], *z, curtain)]
            else:
                at = min(max(cut, z[0]), z[1])
                below, above = (curtain, glass) if look == "nets" else (glass, curtain)
                areas = [(*x, z[0], at, below), (*x, at, z[1], above)]
            parts += [
                Patch(upright(a, b, c, d, PANE), color, "glass")
                for a, b, c, d, color in areas
                if b > a + 1e-6 and d > c + 1e-6
            ]
    return parts


def door(opening: Opening, color: Color) -> list[Part]:
    """A panelled door, over it a light where there is room, before it a step."""
    left, right, low, high, _ = opening
    head = min(high, low + 2.15)
    inset, middle = 0.18 * (right - left), (low + head) / 2
    parts: list[Part] = [Patch(upright(left, right, low, head, PANE), color, "paint")]
    for z0, z1 in ((low + 0.2, middle - 0.08), (middle + 0.08, head - 0.2)):
        panel = upright(left + inset, right - inset, z0, z1, PANE - PROUD)
        parts.append(Patch(panel, darker(color), "paint"))
    if high - head > 0.2:
        light = upright(left + 0.05, right - 0.05, head + 0.06, high - 0.05, PANE)
        parts.append(Patch(light, WINDOW, "glass"))
    if low > 0.05:
        step = relief((left - 0.15, -0.35, 0), (right + 0.15, 0.05, low), (0.30, 0.28, 0.25),
                     "concrete")  # fmt: skip
        parts.append(step)
    return parts


def sill(opening: Opening, color: Color) -> list[Part]:
    """A sill below a window: its front and its top."""
    left, right, low = opening.left - 0.08, opening.right + 0.08, opening.low
    top = [(left, 0, low), (right, 0, low), (right, -SILL, low), (left, -SILL, low)]
    return [Patch(upright(left, right, low - 0.11, low, -SILL), color, "plaster"),
            Patch(top, color, "plaster")]  # fmt: skip


def lintel(opening: Opening, color: Color) -> Part:
    """A band of stone over an opening."""
    left, right, high = opening.left - 0.12, opening.right + 0.12, opening.high
    return Patch(upright(left, right, high, high + 0.2, -PROUD), color, "plaster")


def side_window(x: float, middle: float, low: float, high: float, frame: Color) -> list[Part]:
    """A framed window laid on the outside of the side wall in the plane ``x``."""
    side = 1 if x > 0 else -1
    layers = ((PROUD, 0.55, 0.0, frame, "paint"), (2 * PROUD, 0.45, 0.1, WINDOW, "glass"))
    return [
        Patch(
            [(x + side * off, middle + s * half, z) for s, z in
             ((-1, low + margin), (1, low + margin), (1, high - margin), (-1, high - margin))],
            color, material,
        )
        for off, half, margin, color, material in layers
    ]  # fmt: skip
