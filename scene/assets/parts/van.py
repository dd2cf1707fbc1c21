"""Details on the closed sides and doors of vans: panels, the rail of a sliding door, seams, lettering."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.parts.bodywork import Body
from scene.assets.parts.fittings import on_cabin, on_flank, on_nose
from scene.assets.parts.glazing import on_screen
from scene.assets.parts.palette import BLACK, darker
from scene.assets.parts.skin import Span
from scene.mesh.asset import Asset, Color, Parts

_LINE = 0.012
"""Width of a seam (metres)."""


class VanSides(NamedTuple):
    """The sides of one van."""

    body: Color
    letters: Color | None  # a company's name; None for none
    seed: int  # of the lettering
    sealed: bool  # no windows in the rear doors


def van_sides(b: Body, v: VanSides) -> Parts:
    """Build the details on the shell ``b`` of a van, behind the doors of its cab."""
    front, rear = b.glass[1] + 0.035, 0.955
    middle, line = (front + rear) / 2, _LINE / b.length
    shade = darker(v.body, 0.35)
    yield on_flank(b, (front, rear), (0.955, 0.98), BLACK, lift=0.02, steps=6)
    for low, high in ((front, middle - 0.012), (middle + 0.012, rear)):
        for s in ((low, low + line), (high - line, high)):
            yield _on_sides(b, s, (0.12, 0.8), shade)
        for w in ((0.12, 0.125), (0.79, 0.8)):
            yield _on_sides(b, (low, high), w, shade)
    yield on_nose(b, 1, (-0.006, 0.006), (0.1, 1.0), BLACK, lift=0.014)
    if v.sealed:
        up = np.array([[0.05], [0.5], [0.9]])
        for y in (0.0, -0.6, 0.6):
            seam = np.array([[y - _LINE, y + _LINE]])
            yield on_screen(b, 1, up, seam, shade, 0.014, "plain")
    if v.letters is not None:
        yield from _letters(b, (front + 0.04, rear - 0.06), v.letters, v.seed)


def _on_sides(b: Body, s: Span, w: Span, color: Color, lift: float = 0.008) -> Asset:
    """Lay a patch on both sides between shares ``s`` of the length and ``w`` of the height."""
    return on_cabin(b, np.linspace(*s, 3)[:, None], np.linspace(*w, 2)[None], color, lift=lift)


def _letters(b: Body, s: Span, color: Color, seed: int) -> Parts:
    """Build a line of large letters over one of small ones; they look like text."""
    rng = np.random.default_rng(seed)
    for low, high, letters in ((0.42, 0.68, 7), (0.25, 0.34, 13)):
        edges = np.linspace(*s, letters + 1)
        for a in edges[:-1][rng.random(letters) < 0.85]:
            width = (edges[1] - edges[0]) * rng.uniform(0.45, 0.75)
            top = high - 0.05 * float(rng.integers(2))
            yield _on_sides(b, (a, a + width), (low, top), color, 0.013)
