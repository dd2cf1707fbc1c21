"""What is visible through a vehicle's windows: seats and people, dark against the light behind them.

Windows are opaque to the renderers, so that objects behind a car are not labelled where the car is. The
interior is laid on them as thin sheets of glass in other tones, which reflect the sky as the panes do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scene.assets.parts.bodywork import ROOF, Body, roof, stations
from scene.assets.parts.draw import Rule
from scene.assets.parts.fittings import on_cabin
from scene.assets.parts.palette import blend, darker
from scene.assets.parts.skin import sheet
from scene.mesh.asset import Asset, Color, Parts, solid, vary
from scene.mesh.mesh import cross, twice_areas
from scene.mesh.solids import quads

SEAT = ((0.1, 0.30), (0.40, 0.27), (0.47, 0.11), (0.52, 0.15), (0.68, 0.13), (0.72, 0.08))
"""Outline of a seat from behind or ahead: heights as shares of a car's window, half widths in metres."""
PERSON = (
    (0.1, 0.27), (0.36, 0.23), (0.44, 0.055), (0.50, 0.075), (0.58, 0.088), (0.70, 0.086),
    (0.78, 0.064), (0.83, 0.03),
)  # fmt: skip
"""Outline of a person at the wheel, in the same units; the head, as deep as wide, starts in the third row."""
NARROW = 0.42
"""Width of seats and shoulders seen from the side, as a share of that from ahead."""
HAIR = 0.2
"""Brightness of hair, which covers a head seen from behind, as a share of the skin's."""
LEAN = 0.10
"""Metres from the foot of a seat back to its top."""
UPRIGHT = 0.025
"""A rear window that spans less of the length than this is in the door of a van; nothing is behind it."""
MIN_TWICE_AREA = 1e-8
"""Twice the area (square metres) below which a face cut off at the edge of a pane is dropped."""
_SEAT_Y = 0.4
"""Metres from the middle of a car to the middle of a seat."""
TALL = 0.55
"""Height of a car's window (metres)."""
_LIFTS = (0.009, 0.015, 0.02)
"""Metres from the pane to the sheets of light, seats and people in front of it."""
_ACROSS = np.array([*-ROOF[:-1], *ROOF[::-1]])


LaySheet = Callable[[np.ndarray, np.ndarray, Color, float], Asset]
"""Lays a sheet on glass: shares of a window's height f64[n, 1], metres across f64[n, m], colour, lift."""


class Glazing(NamedTuple):
    """What the windows of one vehicle show."""

    behind: Color  # light from the other side
    dim: float  # share of it that passes the rear windows
    seats: Color
    skin: Color | None  # of the driver; None for an empty seat
    clothes: Color
    side: float  # of the driver, 1 left or -1 right, as a share of half the seats' distance


EMPTY = Glazing((0.05, 0.055, 0.06), 0.6, (0.01, 0.01, 0.01), None, (0.05, 0.05, 0.05), 1.0)
"""The default of parameters before they are drawn."""


def sample_glazing(rng: np.random.Generator, dims: Sequence[float], driven: float) -> Glazing:
    """Draw light, seats and, with probability ``driven``, a driver; ``dim`` is one of ``dims``."""
    light = float(rng.uniform(0.02, 0.16))
    seat = float(rng.choice([0.006, 0.006, 0.012, 0.05]))
    return Glazing(
        behind=vary(rng, (0.92 * light, light, 1.05 * light), 0.1),
        dim=float(rng.choice(dims)),
        seats=vary(rng, (seat, seat, seat), 0.2),
        skin=vary(rng, (0.2, 0.12, 0.085), 0.5) if rng.random() < driven else None,
        clothes=vary(rng, (0.1, 0.1, 0.11), 0.9),
        side=float(rng.choice([-1.0, 1.0])),
    )


def glazed(driven: float) -> Rule:
    """Return the rule for a bus, lorry or train; it has a driver with probability ``driven``."""
    return lambda rng, value: sample_glazing(rng, (0.6,), driven)


def glazing(b: Body, g: Glazing, windows: tuple[bool, bool]) -> Parts:
    """Build what is laid on the panes of the car ``b``; ``windows`` as in ``Paint``."""
    yield from _screen(b, g, 0)
    if windows[1] and b.tail - b.roof_rear > UPRIGHT:
        yield from _screen(b, g, 1)
    yield from _sides(b, g) if windows[0] else []


def interior(
    lay: LaySheet,
    g: Glazing,
    seats: Sequence[float],
    driver: float | None = None,
    *,
    narrow: float = 1.0,
    lean: float = 0.0,
    from_behind: bool = False,
) -> Parts:
    """Lay seats at ``seats`` metres across a window, and the driver at ``driver``, by ``lay``."""
    low, high = _LIFTS[1:]
    if from_behind:
        low, high = high, low  # seats hide the people in them
    shapes: list[tuple[tuple[tuple[float, float], ...], float, Color, float, float]] = [
        (SEAT, middle, g.seats, low, narrow) for middle in seats
    ]
    if driver is not None and g.skin is not None:
        shapes += [
            (PERSON[:3], driver, g.clothes, high, narrow),
            (PERSON[2:], driver, darker(g.skin, HAIR) if from_behind else g.skin, high, 1.0),
        ]
    for rows, middle, color, lift, share in shapes:
        up, half = np.array(rows).T[:, :, None]
        yield lay(up, middle + lean * (up - 0.1) + share * half * [-1, 1], color, lift)


def dimmed(g: Glazing, share: float) -> Color:
    """Return the tone of glass that lets ``share`` of the light behind it through."""
    return blend(g.seats, g.behind, share)


def _sides(b: Body, g: Glazing) -> Parts:
    """Build light and seats in the side windows, and the driver's profile."""
    ends = (max(b.glass[0] + 0.02, b.roof_front - 0.045), *b.pillars, min(b.glass[1], b.roof_rear))
    marks = stations(b)
    panes = [(low + 0.016, high - _LIFTS[2]) for low, high in pairwise(ends) if high - low > 0.05]
    for k, (low, high) in enumerate(panes):
        cuts = marks[(marks > low + 0.004) & (marks < high - 0.004)]
        s = np.array([low, *cuts, high])
        tone = dimmed(g, g.dim if k else 1.0)
        rows = np.array([[0.24, 0.5, 0.8]])
        yield on_cabin(b, s[:, None], rows, tone, "glass", lift=_LIFTS[0])
        if k < 2:
            lay = partial(_on_side, b, high - 0.28 / b.length)
            yield from interior(lay, g, (0.0,), None if k else -0.14, narrow=NARROW, lean=LEAN)


def _on_side(
    b: Body, s: float, up: np.ndarray, across: np.ndarray, color: Color, lift: float
) -> Asset:
    """Lay a sheet on the side windows, ``across`` from the share ``s`` of the length."""
    return on_cabin(b, s + across / b.length, up, color, "glass", lift=lift)


def _screen(b: Body, g: Glazing, end: int) -> Parts:
    """Build light, seats, driver and mirror behind the windscreen (``end`` 0) or rear window (1)."""
    half_width = 0.45 * b.width
    lay = partial(on_screen, b, end)
    light = np.array([-0.66, *_ACROSS[np.abs(_ACROSS) < 0.6], 0.66])[None] * half_width
    rows = np.array([[0.3], [0.6 if end else 0.5], [0.84]])
    yield lay(rows, light, dimmed(g, g.dim if end else 1.0), _LIFTS[0])
    yield from interior(
        partial(_upright, b, end), g, (-_SEAT_Y, _SEAT_Y), g.side * _SEAT_Y, from_behind=end == 1
    )
    if end == 0:
        yield lay(np.array([[0.72], [0.83]]), np.array([[-0.1, 0.1]]), g.seats, _LIFTS[2])


def _upright(
    b: Body, end: int, up: np.ndarray, across: np.ndarray, color: Color, lift: float
) -> Asset:
    """Lay a sheet on a screen with upright sides, although the screen narrows upwards."""
    foot, ridge = (b.cowl, b.roof_front) if end == 0 else (b.tail, b.roof_rear)
    edge = roof(b, foot + up * (ridge - foot), np.ones_like(up))[..., 1]
    return on_screen(b, end, up, across * edge.min() / edge, color, lift)


def on_screen(
    b: Body,
    end: int,
    up: np.ndarray,
    across: np.ndarray,
    color: Color,
    lift: float,
    material: str = "glass",
) -> Asset:
    """Lay a sheet on windscreen (``end`` 0) or rear window (1): ``up`` from the foot, ``across`` left."""
    foot, ridge = (b.cowl, b.roof_front) if end == 0 else (b.tail, b.roof_rear)
    up, c = np.broadcast_arrays(up, across / (0.45 * b.width))
    points = roof(b, foot + up * (ridge - foot), np.abs(c))
    points[..., 1] *= np.sign(c)
    points += np.array([lift if end == 0 else -lift, 0, lift])
    return sheet(points, color, material)


def on_panes(
    panes: np.ndarray, up: np.ndarray, across: np.ndarray, color: Color, lift: float
) -> Asset:
    """Lay a sheet on each of the flat panes f64[k, 4, 3], ``across`` from its middle, cut off at its edges.

    ``up`` is a share of a car's window, ``TALL`` metres: a bus has larger windows, not larger people.
    """
    foot, right, _, left = np.moveaxis(panes, 1, 0)[:, :, None, None]
    width, height = (
        np.linalg.norm(side, axis=-1, keepdims=True) for side in (right - foot, left - foot)
    )
    up, across = np.broadcast_arrays(up, across)
    u = (0.5 + across[..., None] / width).clip(0.02, 0.98)
    v = (up[..., None] * TALL / height).clip(0, 0.98)
    points = foot + u * (right - foot) + v * (left - foot)
    normal = cross(right - foot, left - foot)
    points = points + lift * normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    corners = np.stack(
        [points[:, :-1, :-1], points[:, :-1, 1:], points[:, 1:, 1:], points[:, 1:, :-1]], axis=3
    ).reshape(-1, 4, 3)
    mesh = quads(corners, [color] * len(corners), ["glass"] * len(corners)).mesh
    faces = mesh.faces[twice_areas(mesh.vertices, mesh.faces) > MIN_TWICE_AREA]
    return solid(mesh.vertices, faces, color, "glass")
