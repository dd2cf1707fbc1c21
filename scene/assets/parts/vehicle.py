"""Parts shared by road and rail vehicles: wheels, hulls, and windows, lamps and lettering on their walls."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scene.assets.parts.glazing import NARROW, Glazing, dimmed, interior, on_panes
from scene.assets.parts.palette import BLACK, GLASS, TRIM, TYRE
from scene.assets.parts.skin import Span, in_plane, sheet
from scene.assets.parts.wheel import Wheel, wheels
from scene.mesh.asset import Asset, Color, Parts, Point
from scene.mesh.mesh import cross
from scene.mesh.solids import loft, polygon, quads, tube

Corners = np.ndarray
"""A wall f64[4, 3]: corners seen from outside, anticlockwise from the lower left."""


def rod(start: Point, end: Point, radius: float, color: Color, material: str = "metal") -> Asset:
    """Build a thin bar of six sides without ends; 12 faces."""
    return tube(start, end, radius, color, material, sides=6, caps=False)


def card(
    centre: Point, width: float, height: float, color: Color, material: str = "plain"
) -> Asset:
    """Build an upright rectangle across the direction of travel (plate, lamp, mirror)."""
    corners = [(0, y * width / 2, z * height / 2) for y, z in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return polygon(np.array(corners) + centre, color, material)


def mudguard(
    hub: Point, radius: float, width: float, angles: tuple[float, ...], color: Color
) -> Asset:
    """Build a strip around a wheel through ``angles``, radians from straight ahead up and back."""
    x, y, z = hub
    rim = [(x + radius * np.cos(a), z + radius * np.sin(a)) for a in angles]
    edges = [[(a, side, b) for side in (y + width / 2, y - width / 2)] for a, b in rim]
    return loft(np.array(edges), color, "paint", closed=False, caps=False)


SHALLOW = 0.03
"""Depth of the rims of lorries and buses, as a share of their width."""


def axle(
    x: float,
    half_width: float,
    radius: float,
    width: float,
    rim: Color | None,
    *,
    sides: int = 14,
) -> Asset:
    """Build a wheel on either side, outer faces at ``half_width``; without ``rim`` a dark disc (rails).

    Rims are shallow, since the side of the body has no opening for a wheel and would hide a deeper one.
    """
    style = "cap" if rim is None else "steel"
    spec = Wheel(radius, width, style, 8, 0.6, TYRE if rim is None else rim, SHALLOW)
    return wheels(spec, (x,), half_width, sides=sides)


def arch(x: float, y: float, height: float, radius: float, sides: int = 6) -> Asset:
    """Build the dark half disc of a wheel arch on a side at ``y``, its centre ``height`` m up."""
    angle = np.linspace(0, np.pi, sides + 1)
    rim = [x + radius * np.cos(angle), np.full(sides + 1, y), height + radius * np.sin(angle)]
    return polygon(np.column_stack(rim), BLACK)


class Walls(NamedTuple):
    """The four upright faces of a body, each as ``Corners``."""

    left: Corners
    right: Corners
    front: Corners
    rear: Corners


def walls(length: float, width: float, low: float, high: float, *, x: float = 0) -> Walls:
    """Return the upright faces of a box of ``length`` centred on ``x``, from ``low`` to ``high``."""
    plan = [
        (x + sx * length / 2, sy * width / 2) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]

    def wall(start: int, end: int) -> Corners:
        (x0, y0), (x1, y1) = plan[start], plan[end]
        return np.array([[x0, y0, low], [x1, y1, low], [x1, y1, high], [x0, y0, high]])

    return Walls(left=wall(2, 3), right=wall(0, 1), front=wall(1, 2), rear=wall(3, 0))


def panel(
    wall: Corners, u: Span, v: Span, color: Color, material: str = "plain", *, lift: float = 0.012
) -> Asset:
    """Lay a rectangle on ``wall``: shares ``u`` along and ``v`` up it, ``lift`` m outside."""
    return panels(wall, [u], [v], color, material, lift=lift)


def panels(
    wall: Corners, u: Sequence[Span], v: Sequence[Span], color: Color, material: str = "plain",
    *, lift: float = 0.012,
) -> Asset:  # fmt: skip
    """Lay a ``panel`` wherever one of the columns ``u`` meets one of the rows ``v``, row by row."""
    columns, rows = list(u) * len(v), [row for row in v for _ in u]
    count = len(rows)
    return quads(_rectangles(wall, columns, rows, lift), [color] * count, [material] * count)


def strips(places: Iterable[float], half: float) -> list[Span]:
    """Return spans that reach ``half`` to either side of ``places``."""
    return [(middle - half, middle + half) for middle in places]


def _rectangles(
    wall: Corners, u: Sequence[Span], v: Sequence[Span], lift: float | np.ndarray
) -> np.ndarray:
    """Return the corners f64[n, 4, 3] of ``panel``s."""
    low_left, low_right, high_right, high_left = wall
    normal = cross(low_right - low_left, high_left - low_left)
    outside = lift * normal / math.sqrt(normal.dot(normal))
    s, t = np.array(u)[:, (0, 1, 1, 0), None], np.array(v)[:, (0, 0, 1, 1), None]
    low, high = low_left * (1 - s) + low_right * s, high_left * (1 - s) + high_right * s
    return low * (1 - t) + high * t + outside


_TONES = (1.0, 0.4, 0.8, 0.1, 0.6, 1.0, 0.2)
"""Share of the light behind that passes each pane of a row: some show the other side of the vehicle."""


def panes(
    wall: Corners,
    u: Sequence[Span],
    v: Span,
    g: Glazing,
    seats: Sequence[float] = (),
    driver: float | None = None,
    *,
    narrow: float = 1.0,
    lift: float = 0.012,
) -> Parts:
    """Build windows on ``wall`` with the light behind them, and the ``interior`` of ``g`` in each."""
    count, height = len(u), v[1] - v[0]
    sill, head = v[0] + 0.16 * height, v[1] - 0.05 * height
    bright = [(a + 0.06 * (b - a), b - 0.06 * (b - a)) for a, b in u]
    glass = _rectangles(wall, u, [v], lift)
    light = _rectangles(wall, bright, [(sill, head)], lift + 0.006)
    tones = [dimmed(g, _TONES[k % len(_TONES)]) for k in range(count)]
    corners = np.concatenate([glass, light])
    yield quads(corners, [GLASS] * count + tones, ["glass"] * len(corners))
    yield from interior(partial(on_panes, glass), g, seats, driver, narrow=narrow)


def window_row(
    wall: Corners, count: int, u: Span, v: Span, g: Glazing, pillar: float = 0.12
) -> Parts:
    """Build ``count`` panes side by side in the rectangle ``u``, ``v``, ``pillar`` of a bay apart.

    Each has two seats and the bar of a vent near its top, and every third a passenger.
    """
    edges = np.linspace(*u, count + 1)
    gap = (edges[1] - edges[0]) * pillar / 2
    spans = [(a + gap, b - gap) for a, b in pairwise(edges)]
    vent = v[0] + 0.74 * (v[1] - v[0])
    bars = _rectangles(wall, spans, [(vent, vent + 0.008)], 0.036)
    yield from panes(wall, spans, v, g, (-0.35, 0.35), narrow=NARROW)
    yield from interior(
        partial(on_panes, _rectangles(wall, spans[::3], [v], 0.012)), g, (), 0.25, narrow=NARROW
    )
    yield quads(bars, [TRIM] * count, ["plain"] * count)


class Hull(NamedTuple):
    """A box body with rounded corners; metres."""

    length: float
    width: float
    low: float
    high: float
    x: float = 0.0  # of its middle
    round: float = 0.16  # radius of the upright corners
    chamfer: float = 0.16  # radius of the roof's edges
    nose: float = 0.0  # m that the top of the front is set back
    tail: float = 0.0  # m that the top of the rear is set back


def hull_walls(h: Hull) -> Walls:
    """Return the walls of ``h`` as if its corners were square; front and rear lean as it does."""
    side = walls(h.length, h.width, h.low, h.high, x=h.x)
    side.front[2:, 0] -= h.nose
    side.rear[2:, 0] += h.tail
    return side


_ARC = np.linspace(0, np.pi / 2, 4)


def _corner(h: Hull) -> np.ndarray:
    """Return (x back, y in) of points round an upright corner, from the side to the front, m."""
    return h.round * np.column_stack([1 - np.sin(_ARC), 1 - np.cos(_ARC)])


def hull(h: Hull, color: Color) -> Asset:
    """Build the body of ``h``, closed all round."""
    half = h.width / 2
    arc = h.chamfer * np.column_stack([1 - np.cos(_ARC), np.sin(_ARC) - 1])
    rings = []
    for end, lean in ((-1, h.tail), (1, h.nose)):
        corner = _corner(h)
        for back, inset in corner if end > 0 else corner[::-1]:
            side = half - inset
            half_section = [(side, h.low), *((side - a, h.high + b - 0.3 * inset) for a, b in arc)]
            section = np.array(half_section + [(-y, z) for y, z in half_section[::-1]])
            up = (section[:, 1] - h.low) / (h.high - h.low)
            along = h.x + end * (h.length / 2 - back - lean * up)
            rings.append(np.column_stack([along, section]))
    return loft(rings, color, "paint")


def wrap(
    h: Hull,
    end: int,
    v: Span,
    back: float,
    color: Color,
    material: str = "plain",
    *,
    lift: float = 0.012,
) -> Asset:
    """Build a band round the front (``end`` 1) or rear (-1): ``v`` up it, ``back`` m along either side."""
    corner = _corner(h)
    side = np.concatenate([[(h.round + back, 0.0)], corner]) - [lift, 0]
    plan = np.column_stack([side[:, 0], h.width / 2 - side[:, 1] + lift])
    plan = np.concatenate([plan, plan[::-1] * [1, -1]])
    lean = h.nose if end > 0 else h.tail
    rows = []
    for up in v:
        x = h.x + end * (h.length / 2 - plan[:, 0] - lean * up)
        z = np.full(len(plan), h.low + up * (h.high - h.low))
        rows.append(np.column_stack([x, plan[:, 1], z]))
    grid = np.array(rows[::-1] if end > 0 else rows)
    return sheet(grid, color, material)


def tank(
    loop: np.ndarray, x: float, z: float, length: float, ends: Sequence[Span], color: Color
) -> Asset:
    """Build a tank of section ``loop`` f64[n, 2] around (x, z), rounded by ``ends``.

    ``ends`` are pairs, the outermost first: share of ``length`` from the middle, share of the section's size.
    """
    places = [*((-share, size) for share, size in ends), *ends[::-1]]
    rings = [in_plane(x + share * length, size * loop + [0, z]) for share, size in places]
    return loft(rings, color, "metal")


def hoop(loop: np.ndarray, x: Span, z: float, size: float, color: Color) -> Asset:
    """Build a band around a tank from ``x[0]`` to ``x[1]``."""
    section = np.concatenate([loop, loop[:1]]) * size + [0, z]
    return loft([in_plane(end, section) for end in x], color, "metal", closed=False, caps=False)


def lettering(wall: Corners, u: Span, v: Span, color: Color, seed: int) -> Asset:
    """Build a large line of block letters over a small one on ``wall``; they look like text."""
    rng = np.random.default_rng(seed)
    along, up = [], []
    for low, high, letters in (
        (0.4, 1.0, int(rng.integers(5, 10))),
        (0.0, 0.26, int(rng.integers(12, 20))),
    ):
        edges = np.linspace(*u, letters + 1)
        step = edges[1] - edges[0]
        for a in edges[:-1][rng.random(letters) < 0.85]:
            head = high - (0, 0.06)[rng.integers(2)]
            up.append((v[0] + low * (v[1] - v[0]), v[0] + head * (v[1] - v[0])))
            along.append((a, a + step * rng.uniform(0.5, 0.8)))
    return quads(_rectangles(wall, along, up, 0.02), [color] * len(up), ["plain"] * len(up))


def lamps(wall: Corners, u: Span, v: Span, color: Color, lift: float = 0.015) -> Asset:
    """Build a pair of lamps on ``wall``, mirrored about its middle."""
    return panels(wall, [u, (1 - u[1], 1 - u[0])], [v], color, "lamp", lift=lift)
