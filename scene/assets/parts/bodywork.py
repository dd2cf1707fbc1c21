"""The shell of a car, one curved surface with flanks, wheel arches, cabin, bonnet, nose and tail.

A point on it has two coordinates: ``s``, the share of the length from the nose, and its row in the section,
which runs from the sill over the shoulder and the windows to the middle of the roof.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from scene.assets.parts.palette import BLACK
from scene.assets.parts.skin import mirrored, paint_cells, weld
from scene.mesh.asset import Asset, Color
from scene.mesh.mesh import frozen

FLANK = np.array([0.0, 0.2, 0.45, 0.78, 1.0])
"""Heights of the rows below the shoulder, as shares of the way up from the sill."""
CABIN = np.array([0.1, 0.5, 0.86, 1.0])
"""Heights of the rows above it, as shares of the way up from the shoulder to the edge of the roof."""
ROOF = np.array([0.84, 0.45, 0.0])
"""Positions of the rows over the roof, as shares of the way from its middle to its edge."""
_GLASS_ROWS = slice(len(FLANK), len(FLANK) + 2)
_SCREEN_ROWS = slice(len(FLANK) + len(CABIN), len(FLANK) + len(CABIN) + 2)
_POWER = 2.4
"""Exponent of the outline of nose, screen and tail in plan; 2 is a parabola, more is squarer."""


class Body(NamedTuple):
    """The shape of one car; metres, and shares of the length measured from the nose."""

    length: float
    width: float
    height: float
    wheelbase: float
    front: float  # m from the nose to the front axle
    wheel_radius: float
    sill: float  # m from the ground to the underside
    hood: float  # m, height of the bonnet's leading edge
    cowl_height: float  # m, height of the bonnet at the windscreen
    belt: float  # m, height of the lower edge of the windows
    deck: float  # m, height of the body at the tail
    cowl: float  # share: foot of the windscreen
    roof_front: float  # share: top of the windscreen
    roof_rear: float  # share: top of the rear window
    tail: float  # share: foot of the rear window
    glass: tuple[float, float]  # shares: where the side windows begin and end
    pillars: tuple[float, ...]  # shares: posts between the side windows
    tumblehome: float  # by how much the roof is narrower than the body, as a share of it
    nose: float = 0.22  # m that the nose is rounded in plan
    stern: float = 0.12  # m that the tail is rounded in plan
    rake: float = 0.07  # m that the top of the nose is set back behind the bumper
    crown: float = 0.06  # m that the middle of the roof is above its edge
    bed: tuple[float, float] | None = None  # shares: an open load bed (pickup) or cabin


def flank_x(b: Body, s: np.ndarray | float) -> np.ndarray:
    """Return x of the flank at share ``s`` of the length, m."""
    return b.length / 2 - b.nose - np.asarray(s) * (b.length - b.nose - b.stern)


def share_at_x(b: Body, x: np.ndarray | float) -> np.ndarray:
    """Return the share of the length at ``x``, the inverse of ``flank_x``."""
    return (b.length / 2 - b.nose - np.asarray(x)) / (b.length - b.nose - b.stern)


def axles(b: Body) -> tuple[float, float]:
    """Return x of the front and the rear axle, m."""
    front = b.length / 2 - b.front
    return front, front - b.wheelbase


def middle_height(b: Body, s: np.ndarray) -> np.ndarray:
    """Return the height of the body's middle line, m."""
    return np.interp(s, *_top_knots(b))


@lru_cache(maxsize=8)
def _top_knots(b: Body) -> np.ndarray:
    """Return the shares of the length and the heights f64[2, n] of the middle line's corners."""
    span = b.roof_rear - b.roof_front
    knots = [
        (-0.01, b.hood - 0.03), (0.0, b.hood - 0.025), (0.03, b.hood),
        (0.6 * b.cowl, 0.3 * b.hood + 0.7 * b.cowl_height),
        (b.cowl, b.cowl_height), (b.roof_front - 0.03, b.height - 0.09), (b.roof_front, b.height - 0.045),
        (b.roof_front + 0.12 * span, b.height - 0.012), (b.roof_front + 0.35 * span, b.height),
        (b.roof_rear - 0.3 * span, b.height - 0.01), (b.roof_rear, b.height - 0.06),
        (b.tail, b.deck), (max(b.tail + 0.004, 0.97), b.deck), (1.01, b.deck - 0.03),
    ]  # fmt: skip
    knots = [k for i, k in enumerate(knots) if i == 0 or k[0] > knots[i - 1][0]]
    return frozen(np.array(knots).T.copy())


def shoulder(b: Body, s: np.ndarray) -> np.ndarray:
    """Return the height at which the flank meets bonnet, window or deck, m."""
    line = np.interp(
        s, [0, b.cowl - 0.02, b.cowl + 0.03, b.tail], [b.hood, b.belt - 0.03, b.belt, b.belt + 0.02]
    )
    return np.minimum(line, middle_height(b, s) - 0.035)


_HALF_WIDTHS = np.array(
    [[0, 0.06, 0.16, 0.3, 0.75, 0.9, 1], [0.90, 0.955, 0.99, 1, 1, 0.975, 0.93]]
)
# Below the waist the flank faces the road and is dark, above it faces the sky and is light.
_SIDE_PROFILE = np.array([[0, 0.2, 0.45, 0.78, 1], [0.945, 0.975, 0.984, 1.0, 0.95]])
SHELF = 0.03
"""Metres from the flank in to the windows above it; the shelf between them reflects the sky."""


def half_width(b: Body, s: np.ndarray) -> np.ndarray:
    """Return half the width of the body, m."""
    return b.width / 2 * np.interp(s, *_HALF_WIDTHS)


def lower_edge(b: Body, s: np.ndarray) -> np.ndarray:
    """Return the height of the flank's lower edge, a circle over each wheel, m."""
    edge = np.interp(s, [0, 0.08, 0.9, 1], [b.sill + 0.04, b.sill, b.sill, b.sill + 0.09])
    reach = b.wheel_radius + ARCH_GAP
    for x in axles(b):
        distance = np.abs(flank_x(b, s) - x)
        inside = distance < reach
        circle = b.wheel_radius + np.sqrt(np.maximum(reach**2 - distance**2, 0))
        edge = np.where(inside, circle, edge)
    return edge


ARCH_GAP = 0.05
"""Gap between a tyre and its wheel arch, m."""


def side_y(b: Body, half: np.ndarray, crest: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return half the width at height ``z`` of a flank with half width ``half`` that ends at ``crest``, m."""
    up = (z - b.sill) / np.maximum(crest - b.sill, 1e-3)
    return half * np.interp(up, *_SIDE_PROFILE)


def _end_setback(b: Body, s: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return how far nose and tail recede at row height ``v`` (0 sill, 1 shoulder), m, < 0 at the nose."""
    if s.min() > 0.08 and s.max() < 0.95:
        return np.zeros(1)
    fade = (1 - s / 0.08).clip(0, 1), (1 - (1 - s) / 0.05).clip(0, 1)
    return -fade[0] * _setback(b, 0, v) + fade[1] * _setback(b, 1, v)


def _setback(b: Body, end: int, v: np.ndarray) -> np.ndarray:
    """Return how far the end of the nose (0) or tail (1) recedes at row height ``v``, m."""
    nose, stern = (0.05, 0.008, 0.0, 0.5 * b.rake, b.rake), (0.06, 0.008, 0.0, 0.03, 0.05)
    return np.interp(v, FLANK, stern if end else nose)


def _bulge(b: Body, s: np.ndarray) -> np.ndarray:
    """Return how far the middle of a section is ahead of its flanks, m."""
    knots = [0, 0.7 * b.cowl, b.cowl, b.roof_front, b.roof_front + 0.1, b.roof_rear, 1.0]
    return np.interp(s, knots, [b.nose, 0.14, 0.11, 0.07, 0, -0.03, -b.stern])


def fascia(b: Body, end: int, c: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return points of nose (``end`` 0) or tail (1): ``c`` -1 right .. 1 left, ``v`` 0 sill .. 1 shoulder."""
    foot, crest, half, flank_x, bulge = _rim(b, end)
    z = foot + v * (crest - foot)
    back = _setback(b, end, v)
    x = flank_x + bulge * (1 - np.abs(c) ** _POWER) + (back if end else -back)
    return _points(x, c * side_y(b, half, crest, z), z)


@lru_cache(maxsize=16)  # every lamp and plate of a car asks for it
def _rim(b: Body, end: int) -> tuple[np.ndarray, ...]:
    """Return foot, shoulder, half width, x and bulge of nose (0) or tail (1), m."""
    s = np.array([float(end)])
    return lower_edge(b, s), shoulder(b, s), half_width(b, s), flank_x(b, s), _bulge(b, s)


def _points(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Stack points f64[..., 3] from coordinates that broadcast to the shape of y."""
    points = np.empty((*y.shape, 3))
    points[..., 0], points[..., 1], points[..., 2] = x, y, z
    return points


def flank(b: Body, s: np.ndarray, v: np.ndarray, *, arches: bool = True) -> np.ndarray:
    """Return points of the left flank: ``s`` along, ``v`` 0 at the sill (or arch) .. 1 at the shoulder."""
    foot, crest = lower_edge(b, s) if arches else b.sill, shoulder(b, s)
    z = foot + v * (crest - foot)
    return _points(flank_x(b, s) + _end_setback(b, s, v), side_y(b, half_width(b, s), crest, z), z)


def doorway(b: Body) -> tuple[float, float]:
    """Return the shares of the length between which there are no wheel arches."""
    front, rear = axles(b)
    reach = b.wheel_radius + 1.2 * ARCH_GAP
    return float(share_at_x(b, front - reach)), float(share_at_x(b, rear + reach))


def cabin(b: Body, s: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return points of the left window band: ``w`` 0 at the shoulder .. 1 at the edge of the roof."""
    foot, ridge, half = shoulder(b, s), middle_height(b, s), half_width(b, s)
    edge = np.maximum(ridge - b.crown, foot + 0.6 * (ridge - foot))
    y = side_y(b, half, foot, foot)
    grown = ((edge - foot) / (b.height - b.crown - b.belt)).clip(0, 1)
    inset = half * (0.12 * (1 - grown) + b.tumblehome * grown)
    x = flank_x(b, s) + _end_setback(b, s, np.ones_like(s))
    inset = inset * w**1.2 + SHELF * grown * np.minimum(w / CABIN[0], 1)
    lateral = 1 - inset / y
    x = x + _bulge(b, s) * (1 - lateral**_POWER)
    return _points(x, y - inset, foot + w * (edge - foot))


def roof(b: Body, s: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return points of bonnet, screens and roof: ``c`` 1 at the left edge .. 0 in the middle."""
    edge = cabin(b, s, np.ones_like(s))
    y = c * edge[..., 1]
    crest = shoulder(b, s)
    lateral = y / side_y(b, half_width(b, s), crest, crest)
    x = flank_x(b, s) + _end_setback(b, s, np.ones_like(s)) + _bulge(b, s) * (1 - lateral**_POWER)
    z = edge[..., 2] + (middle_height(b, s) - edge[..., 2]) * (1 - c**2.2)
    return _points(x, y, z)


def stations(b: Body) -> np.ndarray:
    """Return the shares of the length at which the shell has a section."""
    span, fall = b.roof_rear - b.roof_front, b.tail - b.roof_rear
    marks = [0, 0.03, 0.08, 0.97, 1.0, *b.glass, *(b.bed or ())]
    marks += [0.6 * b.cowl, b.cowl, b.cowl + 0.012, 0.5 * (b.cowl + b.roof_front)]
    marks += [b.roof_front + d for d in (-0.012, 0, 0.12 * span, 0.35 * span)]
    marks += [b.roof_rear + d for d in (-0.3 * span, 0, 0.12 * fall, 0.4 * fall, 0.7 * fall)]
    marks += [b.tail - 0.08 * fall, b.tail]
    marks += [p + d for p in b.pillars for d in (-_POST, _POST)]
    marks = np.sort(np.clip(np.concatenate([marks, _arch_marks(b)]), 0, 1)).tolist()
    sections = marks[:1]
    for mark in marks[1:]:
        if mark - sections[-1] > _MIN_SPACING:
            sections.append(mark)
    return np.array(sections)


def _arch_marks(b: Body) -> np.ndarray:
    """Return the shares of the length at which the wheel arches have a corner."""
    reach = b.wheel_radius + ARCH_GAP
    return np.concatenate([share_at_x(b, x + reach * _ARCH_CORNERS) for x in axles(b)])


_ARCH_CORNERS = np.array([-1.03, -0.99, -0.9, -0.63, -0.22, 0.22, 0.63, 0.9, 0.99, 1.03])
_MIN_SPACING = 3.5e-3
"""Smallest distance of two sections, as a share of the length."""
_POST = 0.009
"""Half the width of a window post, as a share of the length."""


class Paint(NamedTuple):
    """Colours and materials of the shell."""

    body: Color
    lower: Color  # of the lowest rows: second colour or plastic
    roof: Color
    glass: Color
    screen: Color
    windows: tuple[bool, bool] = (True, True)  # whether it has side windows, and a rear window
    lower_rows: int = 0  # number of rows of the flank in ``lower``
    roof_material: str = "paint"
    trim: bool = True  # whether the foot of the side windows is black


def shell(b: Body, paint: Paint) -> Asset:
    """Build the painted and glazed body, open below."""
    s = stations(b)
    along = s[:, None]
    sections = flank(b, along, FLANK), cabin(b, along, CABIN), roof(b, along, ROOF)
    points = np.concatenate(sections, axis=1)
    paints = [(paint.body, "paint"), (paint.lower, "plain"), (paint.roof, paint.roof_material)]
    paints += [(paint.glass, "glass"), (paint.screen, "glass"), (BLACK, "plain")]
    sides = paint_cells(points, paints, _cells(b, paint, s))
    ends = []
    for end in (0, 1):
        rim = points[0 if end == 0 else -1]
        c = rim[len(FLANK) - 1 :, 1] / rim[len(FLANK) - 1, 1]
        rows = fascia(b, end, c, FLANK[:-1, None])
        grid = np.concatenate([rows, rim[None, len(FLANK) - 1 :]])
        cells = np.zeros((len(FLANK) - 1, len(c) - 1), int)
        cells[: paint.lower_rows] = 1
        order = slice(None, None, -1 if end else 1)
        ends.append(paint_cells(grid[order], paints, cells[order]))
    half_shell = weld(sides, *ends)
    return weld(half_shell, mirrored(half_shell))


def _cells(b: Body, paint: Paint, s: np.ndarray) -> np.ndarray:
    """Return the index of the paint of each cell of the left half of the shell."""
    middle = (s[1:] + s[:-1]) / 2
    cells = np.zeros((len(middle), len(FLANK) + len(CABIN) + len(ROOF) - 1), int)
    cells[:, : paint.lower_rows] = 1
    over = (middle > b.roof_front) & (middle < b.roof_rear)
    cells[over, _SCREEN_ROWS.start - 1 :] = 2
    post = np.zeros(len(middle), bool)
    for p in b.pillars:
        post |= np.abs(middle - p) < _POST
    panes = (middle > b.glass[0]) & (middle < b.glass[1])
    if paint.windows[0]:
        cells[panes & ~post, _GLASS_ROWS] = 3
        cells[panes & post, _GLASS_ROWS] = 5
        if paint.trim:
            cells[panes, _GLASS_ROWS.start - 1] = 5
    screen = (middle > b.cowl + 0.011) & (middle < b.roof_front - 0.011)
    cells[screen, _SCREEN_ROWS] = 4
    cells[(middle > b.cowl) & (middle < b.cowl + 0.011), _SCREEN_ROWS] = 5
    if paint.windows[1]:
        fall = b.tail - b.roof_rear
        rear = (middle > b.roof_rear + 0.1 * fall) & (middle < b.tail - 0.07 * fall)
        cells[rear, _SCREEN_ROWS] = 3
    if b.bed:
        inside = (middle > b.bed[0]) & (middle < b.bed[1])
        cells[inside, _SCREEN_ROWS.start :] = 5
    return cells


def underside(b: Body) -> Asset:
    """Build dark wheel wells and floor, closed in the middle so that no light passes below the body."""
    s = np.sort(np.clip(np.concatenate([_arch_marks(b), [0, 0.08, 0.9, 1]]), 0, 1))
    edge = flank(b, s, np.zeros_like(s))
    inner = edge * [1, 0.62, 1]
    down = inner.copy()
    down[:, 2] = np.minimum(b.sill + 0.02, inner[:, 2])
    middle = down * [1, 0, 1]
    half_floor = paint_cells(
        np.stack([middle, down, inner, edge], 1), [(BLACK, "plain")], np.zeros((len(s) - 1, 3), int)
    )
    return weld(half_floor, mirrored(half_floor))
