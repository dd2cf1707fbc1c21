"""What road and rail vehicles share: wheels, hulls, and glass and lamps laid on their walls."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scene.assets.parts.glazing import NARROW, Glazing, dimmed, interior, on_panes
from scene.assets.parts.palette import BLACK, GLASS, STEEL, TRIM, TYRE
from scene.assets.parts.skin import sheet
from scene.assets.parts.wheel import Wheel, wheels
from scene.mesh.asset import Asset, Color, Point
from scene.mesh.mesh import cross
from scene.mesh.solids import loft, polygon, quads, tube

Span = tuple[float, float]
Corners = np.ndarray
"""f64[4, 3]: a wall seen from outside, anticlockwise from its lower left corner."""


def circle(centre: Point, radius: float, sides: int) -> np.ndarray:
    """Points [sides, 3] of a circle that stands in the x-z plane, the first one lowest."""
    angle = (np.arange(sides) / sides - 0.25) * 2 * np.pi
    ring = np.column_stack([np.cos(angle), np.zeros(sides), np.sin(angle)])
    return np.asarray(centre) + radius * ring


def rod(start: Point, end: Point, radius: float, color: Color, material: str = "metal") -> Asset:
    """A thin bar of six sides without ends; 12 faces."""
    return tube(start, end, radius, color, material, sides=6, caps=False)


def card(
    centre: Point, width: float, height: float, color: Color, material: str = "plain"
) -> Asset:
    """An upright rectangle across the way of travel (plate, lamp, mirror)."""
    corners = [(0, y * width / 2, z * height / 2) for y, z in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return polygon(np.array(corners) + centre, color, material)


def mudguard(
    hub: Point, radius: float, width: float, angles: tuple[float, ...], color: Color
) -> Asset:
    """A strip around a wheel through ``angles``, radians from straight ahead up and back."""
    edges = [
        [
            (hub[0] + radius * np.cos(a), hub[1] + side * width / 2, hub[2] + radius * np.sin(a))
            for side in (1, -1)
        ]
        for a in angles
    ]
    return loft(np.array(edges), color, "paint", closed=False, caps=False)


SHALLOW = 0.03
"""Depth of the rims of lorries and buses, as a share of their width."""


def axle(
    x: float,
    half_width: float,
    radius: float,
    width: float,
    rim: Color | None = STEEL,
    *,
    rim_share: float = 0.6,
    sides: int = 14,
) -> Asset:
    """A wheel on either side, outer faces at ``half_width``; without ``rim`` a dark disc (rails).

    Rims are shallow, or the side of the body, which has no opening for a wheel, would stand before them.
    """
    style = "cap" if rim is None else "steel"
    one = Wheel(radius, width, style, 8, rim_share, TYRE if rim is None else rim, SHALLOW)
    return wheels(one, (x,), half_width, sides=sides)


def arch(x: float, y: float, height: float, radius: float, sides: int = 6) -> Asset:
    """The dark half disc of a wheel arch on a side at ``y``, its centre ``height`` m up."""
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
    """The upright faces of a box of ``length`` centred on ``x``, from ``low`` to ``high``."""
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
    """A rectangle laid on ``wall``: shares ``u`` along and ``v`` up it, ``lift`` m outside."""
    return panels(wall, [u], [v], color, material, lift=lift)


def panels(
    wall: Corners, u: Sequence[Span], v: Sequence[Span], color: Color, material: str = "plain",
    *, lift: float = 0.012,
) -> Asset:  # fmt: skip
    """A ``panel`` wherever one of the columns ``u`` meets one of the rows ``v``, row by row."""
    columns, rows = list(u) * len(v), [row for row in v for _ in u]
    count = len(rows)
    return quads(_laid(wall, columns, rows, lift), [color] * count, [material] * count)


def strips(places: Iterable[float], half: float) -> list[Span]:
    """Spans that reach ``half`` to either side of ``places``."""
    return [(at - half, at + half) for at in places]


def _laid(
    wall: Corners, u: Sequence[Span], v: Sequence[Span], lift: float | np.ndarray
) -> np.ndarray:
    """Corners f64[n, 4, 3] of ``panel``s."""
    low_left, low_right, high_right, high_left = wall
    normal = cross(low_right - low_left, high_left - low_left)
    outside = lift * normal / math.sqrt(normal.dot(normal))
    s, t = np.array(u)[:, (0, 1, 1, 0), None], np.array(v)[:, (0, 0, 1, 1), None]
    low, high = low_left * (1 - s) + low_right * s, high_left * (1 - s) + high_right * s
    return low * (1 - t) + high * t + outside


_TONES = (1.0, 0.4, 0.8, 0.1, 0.6, 1.0, 0.2)
"""Share of the light from behind that each pane of a row passes: through some the other side is seen."""


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
) -> list[Asset]:
    """Windows on ``wall``, light from behind in them, and what ``interior`` tells of ``g`` in each."""
    count, tall = len(u), v[1] - v[0]
    sill, head = v[0] + 0.16 * tall, v[1] - 0.05 * tall
    bright = [(a + 0.06 * (b - a), b - 0.06 * (b - a)) for a, b in u]
    whole = _laid(wall, u, [v], lift)
    light = _laid(wall, bright, [(sill, head)], lift + 0.006)
    tones = [dimmed(g, _TONES[k % len(_TONES)]) for k in range(count)]
    corners = np.concatenate([whole, light])
    return [
        quads(corners, [GLASS] * count + tones, ["glass"] * len(corners)),
        *interior(partial(on_panes, whole), g, seats, driver, narrow=narrow),
    ]


def window_row(
    wall: Corners, count: int, u: Span, v: Span, g: Glazing, pillar: float = 0.12
) -> list[Asset]:
    """``count`` panes side by side in the rectangle ``u``, ``v``; ``pillar`` of a bay apart.

    Behind each are two seats, behind every third somebody, and near its top is a vent's bar.
    """
    edges = np.linspace(*u, count + 1)
    gap = (edges[1] - edges[0]) * pillar / 2
    spans = [(a + gap, b - gap) for a, b in pairwise(edges)]
    vent = v[0] + 0.74 * (v[1] - v[0])
    bars = _laid(wall, spans, [(vent, vent + 0.008)], 0.036)
    return [
        *panes(wall, spans, v, g, (-0.35, 0.35), narrow=NARROW),
        *interior(
            partial(on_panes, _laid(wall, spans[::3], [v], 0.012)), g, (), 0.25, narrow=NARROW
        ),
        quads(bars, [TRIM] * count, ["plain"] * count),
    ]


class Hull(NamedTuple):
    """A box body with rounded corners; metres."""

    length: float
    width: float
    low: float
    high: float
    x: float = 0.0  # of its middle
    round: float = 0.16  # radius of the upright corners
    chamfer: float = 0.16  # radius of the roof's edges
    nose: float = 0.0  # that the top of the front is set back
    tail: float = 0.0  # that the top of the rear is set back


def faces(h: Hull) -> Walls:
    """The walls of ``h`` as if its corners were square; front and rear lean as it does."""
    side = walls(h.length, h.width, h.low, h.high, x=h.x)
    side.front[2:, 0] -= h.nose
    side.rear[2:, 0] += h.tail
    return side


_ARC = np.linspace(0, np.pi / 2, 4)


def _corner(h: Hull) -> np.ndarray:
    """(x set back, y set in) of the points round an upright corner, from the side to the front, m."""
    return h.round * np.column_stack([1 - np.sin(_ARC), 1 - np.cos(_ARC)])


def hull(h: Hull, color: Color, material: str = "paint") -> Asset:
    """The body of ``h``, closed all round."""
    half = h.width / 2
    arc = h.chamfer * np.column_stack([1 - np.cos(_ARC), np.sin(_ARC) - 1])
    rings = []
    for end, lean in ((-1, h.tail), (1, h.nose)):
        corner = _corner(h)
        for back, inset in corner if end > 0 else corner[::-1]:
            side = half - inset
            right = [(side, h.low), *((side - a, h.high + b - 0.3 * inset) for a, b in arc)]
            section = np.array(right + [(-y, z) for y, z in right[::-1]])
            up = (section[:, 1] - h.low) / (h.high - h.low)
            along = h.x + end * (h.length / 2 - back - lean * up)
            rings.append(np.column_stack([along, section]))
    return loft(rings, color, material)


def wrap(
    h: Hull,
    end: int,
    v: tuple[float, float],
    back: float,
    color: Color,
    material: str = "plain",
    *,
    lift: float = 0.012,
) -> Asset:
    """A band round the front (``end`` 1) or rear (-1): ``v`` up it, ``back`` m along either side."""
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
    """A tank of section ``loop`` f64[n, 2] around (x, z), rounded by ``ends``.

    These are shares of ``length`` from the middle and of the section's size, the outermost first.
    """
    places = [*((-share, size) for share, size in ends), *ends[::-1]]
    rings = [
        np.column_stack([np.full(len(loop), x + share * length), size * loop + [0, z]])
        for share, size in places
    ]
    return loft(rings, color, "metal")


def hoop(loop: np.ndarray, x: Span, z: float, size: float, color: Color) -> Asset:
    """A band around a tank from one place along it to another."""
    wide = np.concatenate([loop, loop[:1]]) * size + [0, z]
    rings = [np.column_stack([np.full(len(wide), at), wide]) for at in x]
    return loft(rings, color, "metal", closed=False, caps=False)


def lettering(
    wall: Corners, u: tuple[float, float], v: tuple[float, float], color: Color, seed: int
) -> Asset:
    """Two lines of block letters on ``wall``, a large one over a small one; legible as text, not as words."""
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
    return quads(_laid(wall, along, up, 0.02), [color] * len(up), ["plain"] * len(up))


def lamps(
    wall: Corners, u: tuple[float, float], v: tuple[float, float], color: Color, lift: float = 0.015
) -> Asset:
    """A pair of lamps on ``wall``, mirrored about its middle."""
    return panels(wall, [u, (1 - u[1], 1 - u[0])], [v], color, "lamp", lift=lift)
