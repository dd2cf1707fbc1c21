"""What is seen in a car's windows: seats and a driver, dark before the light that comes through from behind.

Windows are opaque to renderers, so that what stands behind a car is not labelled in its place. Their inside
is laid on them as thin sheets of glass of other tones, which mirror the sky as the panes do.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scene.assets.parts.bodywork import ROOF, Body, roof, stations
from scene.assets.parts.fittings import on_cabin
from scene.assets.parts.skin import sheet
from scene.mesh.asset import Asset, Color

SEAT = ((0.1, 0.30), (0.40, 0.27), (0.47, 0.11), (0.52, 0.15), (0.68, 0.13), (0.72, 0.08))
"""Outline of a seat from behind or ahead: heights as shares of the window, half widths in metres."""
PERSON = ((0.1, 0.27), (0.38, 0.23), (0.46, 0.07), (0.54, 0.09), (0.68, 0.10), (0.78, 0.06))
"""That of somebody at the wheel; the head begins in the third row."""
NARROW = 0.42
"""Share of these widths that is seen from the side."""
LEAN = 0.10
"""Metres that the top of a seat lies behind its foot."""
UPRIGHT = 0.025
"""Share of the length below which a rear window is the door of a van, with nothing to see behind it."""
_LIFTS = (0.009, 0.015, 0.02)
"""Metres by which light, seats and people stand before the pane."""
_ACROSS = np.array([*-ROOF[:-1], *ROOF[::-1]])


class Glazing(NamedTuple):
    """What the windows of one car show."""

    behind: Color  # light from the other side
    dim: float  # share of it that passes the rear windows
    seats: Color
    skin: Color | None  # of the driver; None: nobody is there
    clothes: Color
    side: float  # of the driver, 1 left or -1 right, as a share of half the seats' distance


def glazing(b: Body, g: Glazing, windows: tuple[bool, bool]) -> list[Asset]:
    """What is laid on the panes of the car ``b``; ``windows`` as in ``Paint``."""
    parts = _screen(b, g, 0)
    if windows[1] and b.tail - b.roof_rear > UPRIGHT:
        parts += _screen(b, g, 1)
    return parts + (_sides(b, g) if windows[0] else [])


def _driver(g: Glazing) -> list[tuple[tuple[tuple[float, float], ...], Color]]:
    """Outlines and colours of whoever drives, body and head."""
    return [] if g.skin is None else [(PERSON[:3], g.clothes), (PERSON[2:], g.skin)]


def _dimmed(g: Glazing, share: float) -> Color:
    a, b, c = (share * x + (1 - share) * y for x, y in zip(g.behind, g.seats, strict=True))
    return a, b, c


def _sides(b: Body, g: Glazing) -> list[Asset]:
    """Light and seats in the side windows, and the driver's profile."""
    ends = (max(b.glass[0] + 0.02, b.roof_front - 0.045), *b.pillars, min(b.glass[1], b.roof_rear))
    marks, parts = stations(b), []
    panes = [(low + 0.016, high - _LIFTS[2]) for low, high in pairwise(ends) if high - low > 0.05]
    for k, (low, high) in enumerate(panes):
        inside = marks[(marks > low + 0.004) & (marks < high - 0.004)]
        s = np.array([low, *inside, high])
        tone = _dimmed(g, g.dim if k else 1.0)
        rows = np.array([[0.24, 0.5, 0.8]])
        parts.append(on_cabin(b, s[:, None], rows, tone, "glass", lift=_LIFTS[0]))
        if k > 1:
            continue
        middle = high - 0.28 / b.length
        parts.append(_outline(b, middle, SEAT, g.seats, _LIFTS[1]))
        if k == 0:
            for outline, color in _driver(g):
                parts.append(_outline(b, middle - 0.14 / b.length, outline, color, _LIFTS[2]))
    return parts


def _outline(
    b: Body, s: float, rows: tuple[tuple[float, float], ...], color: Color, lift: float
) -> Asset:
    up, half = np.array(rows).T[:, :, None]
    along = s + (LEAN * (up - 0.1) + NARROW * half * [-1, 1]) / b.length
    return on_cabin(b, along, up, color, "glass", lift=lift)


def _screen(b: Body, g: Glazing, end: int) -> list[Asset]:
    """Light, seats, driver and mirror behind the windscreen (``end`` 0) or rear window (1)."""
    dim = 1.0 if end == 0 else g.dim
    across = np.array([-0.66, *_ACROSS[np.abs(_ACROSS) < 0.6], 0.66])
    rows = np.array([[0.3], [0.6 if end else 0.5], [0.84]])
    parts = [_on_screen(b, end, rows, across, _dimmed(g, dim), _LIFTS[0])]
    wide = b.width / 2 * (1 - b.tumblehome)
    at = 0.37 / wide
    for c in (-at, at):
        parts.append(_facing(b, end, c, SEAT, g.seats, _LIFTS[1]))
    for outline, color in _driver(g):
        parts.append(_facing(b, end, g.side * at, outline, color, _LIFTS[2]))
    if end == 0:
        mirror = np.array([-0.09, 0.09]) / wide
        parts.append(_on_screen(b, 0, np.array([[0.72], [0.83]]), mirror, g.seats, _LIFTS[2]))
    return parts


def _facing(
    b: Body, end: int, c: float, rows: tuple[tuple[float, float], ...], color: Color, lift: float
) -> Asset:
    up, half = np.array(rows).T[:, :, None]
    return _on_screen(b, end, up, c + half * [-1, 1] / (0.45 * b.width), color, lift)


def _on_screen(
    b: Body, end: int, up: np.ndarray, c: np.ndarray, color: Color, lift: float
) -> Asset:
    """A sheet on windscreen or rear window: ``up`` from its foot, ``c`` -1 right .. 1 left."""
    foot, ridge = (b.cowl, b.roof_front) if end == 0 else (b.tail, b.roof_rear)
    up, c = np.broadcast_arrays(up, c)
    points = roof(b, foot + up * (ridge - foot), np.abs(c)) * np.stack(
        [np.ones_like(c), np.sign(c), np.ones_like(c)], -1
    )
    points += np.array([lift if end == 0 else -lift, 0, lift])
    return sheet(points, color, "glass")
