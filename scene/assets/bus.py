"""Buses: a rounded hull with windows, doors, a destination board, a livery and adverts."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from scene.assets.family import ROAD, Family, Size
from scene.assets.parts.draw import (
    SEED,
    Rule,
    between,
    integer,
    keep,
    near,
    one_of,
    perhaps,
    plus,
    resolve,
    sample_fields,
    times,
)
from scene.assets.parts.glazing import EMPTY, Glazing, glazed
from scene.assets.parts.palette import (
    AMBER,
    BLACK,
    GLASS,
    HEADLAMP,
    OFF_WHITE,
    PLATE,
    PLATE_YELLOW,
    STEEL,
    TAILLAMP,
    TRIM,
    WHITE,
    pick,
)
from scene.assets.parts.skin import Span, cuboid
from scene.assets.parts.vehicle import (
    Hull,
    Walls,
    arch,
    axle,
    hull,
    hull_walls,
    lamps,
    lettering,
    panel,
    panes,
    window_row,
    wrap,
)
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Parts, merge
from scene.mesh.solids import polygon, tube


class BusParams(NamedTuple):
    """One bus; metres, and shares of the height from the body's lower edge to the roof."""

    length: float
    width: float
    height: float
    decks: int
    bays: int  # windows along each side
    glass: Span  # shares: lower and upper edge of a deck's windows
    wheel_radius: float
    rear_axles: int
    doors: int
    first_door: float  # m from the nose to the front door
    rake: float  # m that the top of the front is set back
    board: bool  # destination board
    joint: bool = False  # articulated in the middle
    open_top: bool = False  # the upper deck has no roof
    bonnet: float = 0.0  # m of engine ahead of the windscreen
    round: float = 0.2  # radius of the corners
    color: Color = (0.3, 0.02, 0.02)
    second_color: Color = (0.05, 0.05, 0.05)  # of the livery
    livery: str = "plain"
    advert: Color | None = None
    pods: int = 0  # boxes on the roof (cooling, gas)
    rim: Color = STEEL
    seed: int = 0  # of the lettering and the boxes
    glazing: Glazing = EMPTY


_KINDS: dict[str, BusParams] = {
    "single decker": BusParams(11.8, 2.55, 3.05, 1, 7, (0.36, 0.86), 0.48, 1, 2, 0.45, 0.10, True),
    "double decker": BusParams(10.8, 2.52, 4.30, 2, 6, (0.34, 0.84), 0.48, 1, 1, 0.5, 0.18, True),
    "coach": BusParams(12.2, 2.55, 3.55, 1, 6, (0.50, 0.90), 0.50, 2, 1, 0.6, 0.40, False),
    "minibus": BusParams(7.2, 2.15, 2.75, 1, 4, (0.42, 0.86), 0.36, 1, 1, 2.1, 0.45, True),
    "midibus": BusParams(9.3, 2.40, 2.90, 1, 5, (0.34, 0.88), 0.42, 1, 1, 0.4, 0.15, True),
    "articulated": BusParams(17.6, 2.55, 3.05, 1, 10, (0.36, 0.86), 0.48, 1, 3, 0.45, 0.12, True,
                             joint=True),
    "open-top": BusParams(10.4, 2.50, 4.05, 2, 6, (0.34, 0.84), 0.48, 1, 1, 0.5, 0.12, True,
                          open_top=True),
    "school bus": BusParams(9.6, 2.40, 3.05, 1, 8, (0.48, 0.84), 0.46, 1, 1, 1.75, 0.08, True,
                            bonnet=1.4),
}  # fmt: skip

_LIVERIES: tuple[Color, ...] = (
    (0.38, 0.016, 0.018), WHITE, (0.50, 0.45, 0.33), (0.52, 0.31, 0.025), (0.025, 0.07, 0.22),
    (0.03, 0.16, 0.08), (0.34, 0.35, 0.36), (0.10, 0.30, 0.42), (0.16, 0.03, 0.14), (0.48, 0.15, 0.015),
)  # fmt: skip
"""Red, white, cream, yellow, blue, green, silver, turquoise, purple and orange."""
_PAINTS: dict[str, Rule] = {
    "school bus": near(0.15, (0.55, 0.30, 0.015)),
    "double decker": perhaps(0.4, near(0.15, _LIVERIES[0]), keep),
}
"""Kinds with a colour of their own."""
_PATTERNS = ("plain", "skirt", "band", "two-tone", "swoop", "rear")
_FLOOR = 0.32
"""Height of the lower edge of the body, m."""
WHEEL_OUTSET = 0.04
"""Metres by which wheels stand out from the body."""


def sample_bus(rng: np.random.Generator, kind: str) -> BusParams:
    """Draw a bus of one body type: size within 8 %, livery, adverts, boxes on the roof."""
    model = _KINDS[kind]
    first_color, second_color = rng.choice(len(_LIVERIES), 2, replace=False)
    color = resolve(rng, _PAINTS.get(kind, keep), pick(rng, (_LIVERIES[first_color],)))
    return sample_fields(
        rng, model, length=times(0.92, 1.07), height=times(0.965, 1.035), bays=plus(-1, 3),
        rake=times(0.5, 1.8), round=between(0.12, 0.3), color=color,
        second_color=perhaps(0.75, near(0.15, _LIVERIES[second_color]), near(0.15, BLACK, TRIM)),
        livery=one_of(*_PATTERNS), advert=perhaps(0.55, near(0.15, *_LIVERIES)),
        pods=integer(0, 4) if model.decks == 1 else 0,
        rim=near(0.15, STEEL, OFF_WHITE, (0.12, 0.12, 0.12), color), seed=SEED,
        glazing=glazed(0.8),
    )  # fmt: skip


def bus(p: BusParams) -> Asset:
    """Build the bus, driving towards +x, its doors on the right.

    It is mirrored in streets where traffic keeps left, see ``street/instances.py``.
    """
    shape = _shape(p)
    side = hull_walls(shape)
    parts = [
        hull(shape, p.color),
        *_livery(p, shape, side),
        *_running_gear(p),
        *_ends(p, shape, side),
        *_doors(p, shape, side),
        *_on_roof(p, shape),
    ]
    for deck in range(p.decks - p.open_top):
        low, high = _glass(p, deck)
        start, end = 0.03, 0.98 - 1.2 * p.rake / p.length
        parts += window_row(side.left, p.bays, (1 - end, 1 - start), (low, high), p.glazing, 0.09)
        if deck:
            parts += window_row(side.right, p.bays, (start, end), (low, high), p.glazing, 0.09)
    if p.joint:
        x = -0.06 * p.length
        for k in range(7):  # folds of the bellows
            bulge = 0.02 + 0.02 * (k % 2)
            half = p.width / 2 + bulge
            back, front = x + 0.16 * k, x + 0.16 * k + 0.17
            parts.append(cuboid((back, front), half, (_FLOOR, p.height + bulge), BLACK, "cloth"))
    if p.bonnet:
        parts += _bonnet(p)
    return merge(*parts)


def _shape(p: BusParams) -> Hull:
    high = p.height - (1.0 if p.open_top else 0.0)
    length = p.length - p.bonnet
    return Hull(
        length, p.width, _FLOOR, high, -p.bonnet / 2, p.round, 0.75 * p.round, p.rake, 0.25 * p.rake
    )


def _glass(p: BusParams, deck: int) -> Span:
    """Return the lower and upper edge of a deck's windows as shares of the hull's height."""
    full = (p.height - _FLOOR) / (_shape(p).high - _FLOOR)
    return full * (deck + p.glass[0]) / p.decks, full * (deck + p.glass[1]) / p.decks


def _livery(p: BusParams, shape: Hull, side: Walls) -> Parts:
    """Build the second colour, and an advert with its lettering."""
    foot, head = _glass(p, 0)
    edge = 1.2 * p.round / shape.length
    bands = {
        "plain": [(0.0, 0.06)],
        "skirt": [(0.0, 0.5 * foot)],
        "band": [(foot - 0.09, foot - 0.02)],
        "two-tone": [(head + 0.015, head + 0.1), (foot, head)],
    }.get(p.livery, [])
    for mirror, wall in ((False, side.right), (True, side.left)):
        a, b = edge, 1 - edge
        u = (1 - b, 1 - a) if mirror else (a, b)
        yield from (panel(wall, u, v, p.second_color, "paint", lift=0.005) for v in bands)
        if p.livery in ("swoop", "rear"):
            slant = 0.16 if p.livery == "swoop" else 0.0
            a, b, top = (0.25, 0.5, 0.96) if slant else (edge, 0.28, 0.94)
            shares = [(a, 0.0), (b, 0.0), (b - slant, top), (a - slant, top)]
            if mirror:
                shares = [(1 - u, v) for u, v in shares[::-1]]
            foot_left, along, up = wall[0], wall[1] - wall[0], wall[3] - wall[0]
            corners = [foot_left + along * u + up * v for u, v in shares]
            outside = [0, np.sign(wall[0, 1]) * 0.006, 0]
            yield polygon(np.array(corners) + outside, p.second_color, "paint")
        if p.advert is not None:
            a, b = (head + 0.025, _glass(p, 1)[0] - 0.02) if p.decks == 2 else (0.16, foot - 0.03)
            if b - a > 0.08 and p.livery != "two-tone":
                ink = WHITE if max(p.advert) < 0.45 else (0.03, 0.03, 0.05)
                yield panel(wall, (0.3, 0.72), (a, b), p.advert, "paint", lift=0.01)
                middle = (a + 0.2 * (b - a), b - 0.2 * (b - a))
                yield lettering(wall, (0.36, 0.66), middle, ink, p.seed)
    if p.livery == "skirt":
        for end in (1, -1):
            yield wrap(shape, end, (0, 0.5 * foot), 0.05, p.second_color, "paint", lift=0.006)


def _axles(p: BusParams) -> list[float]:
    front = p.length / 2 - (2.6 if p.length > 8 and not p.bonnet else 1.3)
    rear = -p.length / 2 + 0.27 * p.length * (0.6 if p.joint else 1)
    middle = [0.06 * p.length] if p.joint else []
    return [front, *middle, rear] + ([rear - 1.3] if p.rear_axles == 2 else [])


def _running_gear(p: BusParams) -> Parts:
    half, radius = p.width / 2, p.wheel_radius
    for x in _axles(p):
        yield axle(x, half + WHEEL_OUTSET, radius, 0.3, p.rim)
        yield from (arch(x, y, radius, radius + 0.09, 10) for y in (half + 0.02, -half - 0.02))


def _doors(p: BusParams, shape: Hull, side: Walls) -> Parts:
    """Build glass doors down to the floor on the right, and the windows between them."""
    low, high = _glass(p, 0)
    width = 1.25 / shape.length
    starts = [1 - (p.first_door - 0.4 * p.bonnet) / shape.length - width, 0.48, 0.2][: p.doors]
    for start in starts:
        leaf = (start, start + width / 2 - 0.03 / p.length), (start + width / 2, start + width)
        yield panel(side.right, (start - 0.004, start + width + 0.004), (0.03, high), TRIM)
        yield from panes(side.right, leaf, (0.07, high - 0.02), p.glazing, lift=0.02)
    edges = [0.98 - 1.2 * p.rake / p.length, *(e for s in starts for e in (s + width, s)), 0.03]
    for end, start in zip(edges[::2], edges[1::2], strict=True):
        if end - start > 0.05:
            count = max(1, round((end - start) * p.bays))
            yield from window_row(side.right, count, (start, end), (low, high), p.glazing, 0.09)


def _ends(p: BusParams, shape: Hull, side: Walls) -> Parts:
    """Build windscreens round the corners, rear windows, boards, lamps, plates and bumpers."""
    front, rear = side.front, side.rear
    for deck in range(p.decks - p.open_top):
        low, high = _glass(p, deck)
        yield wrap(shape, 1, (low - 0.07 / p.decks, high), 0.1, GLASS, "glass")
        yield panel(front, (0.495, 0.505), (low - 0.06 / p.decks, high), BLACK, lift=0.02)
        screen = [(0.12, 0.49), (0.51, 0.88)]
        yield from panes(front, screen, (low, high), p.glazing, (-0.2, 0.2))
        if not deck:
            yield from panes(front, screen[1:], (low, high), p.glazing, (), 0.15)
        rear_seats = (-0.7, -0.25, 0.25, 0.7)
        yield from panes(rear, [(0.13, 0.87)], (low + 0.03, high), p.glazing, rear_seats)
    low, high = _glass(p, 0)
    if p.board:
        height = min(0.13, 0.97 - high) if p.decks == 1 else 0.09
        yield panel(front, (0.14, 0.86), (high, high + height), BLACK, lift=0.02)
        text = (high + 0.2 * height, high + 0.8 * height)
        yield lettering(front, (0.2, 0.8), text, AMBER, p.seed)
    d = p.decks
    yield wrap(shape, 1, (0.0, 0.07 / d + 0.02), 0.3, TRIM)
    yield wrap(shape, -1, (0.0, 0.07 / d + 0.02), 0.3, TRIM)
    yield panel(front, (0.3, 0.7), (0.24 / d, 0.29 / d), BLACK, lift=0.02)
    yield panel(front, (0.4, 0.6), (0.05, 0.09), PLATE, lift=0.03)
    yield panel(rear, (0.4, 0.6), (0.11, 0.15), PLATE_YELLOW, lift=0.03)
    yield panel(rear, (0.2, 0.8), (0.2 / d, 0.32 / d), TRIM, "metal")
    yield lamps(front, (0.1, 0.24), (0.12 / d + 0.02, 0.2 / d + 0.02), HEADLAMP, lift=0.02)
    yield lamps(front, (0.25, 0.28), (0.12 / d + 0.02, 0.2 / d + 0.02), AMBER, lift=0.02)
    yield lamps(rear, (0.1, 0.17), (0.14 / d, 0.36 / d), TAILLAMP)
    x, z = p.length / 2 - p.bonnet + 0.1, min(2.3, 0.75 * p.height)
    for y in (p.width / 2 + 0.12, -p.width / 2 - 0.12):
        yield cuboid((x - 0.12, x), 0.09, (z - 0.35, z), TRIM, at=y)
        yield tube((x - 0.05, y, z), (x - 0.3, y - np.sign(y) * 0.2, z + 0.15), 0.02, TRIM, sides=4)
    for y in (0.3, -0.5):  # wipers at rest
        x = front[0, 0] - shape.nose * low + 0.04
        z = _FLOOR + low * (shape.high - _FLOOR)
        yield tube((x, y, z - 0.05), (x - 0.05, y + 0.5, z + 0.12), 0.012, BLACK, sides=4)


def _on_roof(p: BusParams, shape: Hull) -> Parts:
    """Build boxes on the roof, and on an open top a parapet with a rail and rows of seats."""
    for k in range(p.pods):
        x = shape.x + (0.28 - 0.26 * k) * shape.length
        half_length, half_width = 0.5 + 0.35 * ((p.seed >> k) % 3), 0.35 * p.width
        z_span = (shape.high - 0.02, shape.high + 0.16 + 0.05 * k)
        yield cuboid((x - half_length, x + half_length), half_width, z_span, p.color)
    if p.open_top:
        low, inner, end = shape.high, p.width / 2 - 0.12, shape.length / 2
        for x, y in product(np.arange(-end + 0.8, end - 1, 0.85).tolist(), (-0.55, 0.55)):
            yield cuboid((x, x + 0.1), 0.4, (low, low + 0.75), p.second_color, "cloth", at=y)
        for y in (-inner, inner):
            parapet = (-end + 0.2, end - 0.4), 0.03, (low - 0.05, low + 0.4)
            yield cuboid(*parapet, p.color, at=y)
        yield cuboid((end - 0.5, end - 0.42), inner, (low - 0.05, low + 0.95), GLASS, "glass")


def _bonnet(p: BusParams) -> Parts:
    """Build the engine's box ahead of the windscreen, with grille and lamps."""
    x = p.length / 2 - p.bonnet / 2 - 0.25
    h = Hull(p.bonnet + 0.5, 0.86 * p.width, 0.5, 1.6, x, round=0.25, chamfer=0.2, nose=0.12)
    front = hull_walls(h).front
    yield hull(h, p.color)
    yield wrap(h, 1, (0.0, 0.2), 0.4, TRIM, lift=0.05)
    yield panel(front, (0.3, 0.7), (0.25, 0.75), BLACK)
    yield lamps(front, (0.12, 0.26), (0.4, 0.65), HEADLAMP, lift=0.02)
    yield panel(front, (0.42, 0.58), (0.06, 0.16), PLATE, lift=0.08)


FAMILY = Family(
    "bus", TrainId.BUS, tuple(_KINDS), sample_bus, bus,
    count=28, size=Size((4.5, 26), (2, 5)), tone=0.85, line=("car", 0.05),
    facing="lane", stage=ROAD,
)  # fmt: skip
