"""What lorries carry: each load as a function of the lorry's parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, block, loft, merge, polygon, tube
from scene.assets._palette import AMBER, BLACK, STEEL, TAILLAMP, TRIM, darker
from scene.assets._skin import moved, pair, revolve
from scene.assets._vehicle import Walls, lettering, panel, walls


class TruckParams(NamedTuple):
    """One lorry; metres, x measured back from the nose."""

    load: str  # which of ``LOADS``
    length: float
    width: float
    height: float  # of the load
    cab_length: float
    cab_height: float
    axles: tuple[float, ...]  # x of each
    wheel_radius: float
    gap: float  # between cab and load
    windscreen: tuple[float, float]  # share of the cab's height
    rake: float  # m that the cab's roof is set back
    cab: Color = (0.5, 0.5, 0.5)
    body: Color = (0.6, 0.6, 0.6)
    letters: Color | None = None  # on the sides
    band: Color | None = None  # along the sides
    visor: bool = False  # over the windscreen
    deflector: bool = False  # on the cab's roof
    beacons: bool = False
    round: float = 0.18  # radius of the cab's corners
    grille: tuple[float, float] = (0.2, 0.42)  # shares of the cab's height
    fill: float = 0.7  # how full a load bed is
    seed: int = 0  # of lettering and cargo


_GRAVEL: Color = (0.16, 0.13, 0.10)
_WHITE: Color = (0.62, 0.62, 0.60)


def floor(p: TruckParams) -> float:
    """Height of the load bed, m."""
    return 2 * p.wheel_radius + 0.12


def bed(p: TruckParams) -> tuple[float, float, float]:
    """Centre x, length and width of the load, m."""
    length = p.length - p.cab_length - p.gap
    return -p.length / 2 + length / 2, length, p.width


def _sign(
    p: TruckParams, side: Walls, u: tuple[float, float], v: tuple[float, float]
) -> list[Asset]:
    """Band and lettering on both sides."""
    parts = []
    if p.band is not None:
        height = 0.25 * (v[1] - v[0])
        parts += [
            panel(wall, (0, 1), (v[0] - height, v[0] - 0.1 * height), p.band, "paint")
            for wall in side[:2]
        ]
    if p.letters is not None:
        parts += [lettering(wall, u, v, p.letters, p.seed) for wall in side[:2]]
    return parts


def _doors(rear: np.ndarray) -> list[Asset]:
    """Rear doors: a seam, upright locking bars and hinges."""
    parts = [panel(rear, (0.495, 0.505), (0.03, 0.97), BLACK)]
    for u in (0.2, 0.4, 0.6, 0.8):
        parts.append(panel(rear, (u - 0.006, u + 0.006), (0.02, 0.98), STEEL, "metal", lift=0.03))
    for v in (0.12, 0.5, 0.86):
        for u in (0.0, 0.95):
            parts.append(panel(rear, (u, u + 0.05), (v, v + 0.02), TRIM, "metal", lift=0.03))
    return parts


def _edges(side: Walls, color: Color) -> list[Asset]:
    """Rails round the edges of a box body, which catch the light."""
    parts = []
    for wall in (side.left, side.right, side.rear, side.front):
        parts += [
            panel(wall, (0, 1), v, color, "metal", lift=0.02) for v in ((0, 0.035), (0.965, 1))
        ]
        parts += [
            panel(wall, u, (0, 1), color, "metal", lift=0.02) for u in ((0, 0.012), (0.988, 1))
        ]
    return parts


def _box(p: TruckParams) -> list[Asset]:
    x, length, width = bed(p)
    low = floor(p)
    side = walls(length, width, low, p.height, x=x)
    return [
        block(
            (x - length / 2, -width / 2, low),
            (x + length / 2, width / 2, p.height),
            p.body,
            "paint",
        ),
        *_doors(side.rear),
        *_edges(side, STEEL if max(p.body) > 0.3 else darker(p.body, 1.6)),
        *_sign(p, side, (0.14, 0.86), (0.38, 0.74)),
    ]


def _curtain(p: TruckParams) -> list[Asset]:
    """A box whose sides are curtains: folds, straps and buckles."""
    x, length, width = bed(p)
    low = floor(p)
    side = walls(length, width, low, p.height, x=x)
    parts = [
        block(
            (x - length / 2, -width / 2, low),
            (x + length / 2, width / 2, p.height),
            p.body,
            "plain",
        )
    ]
    parts += [*_doors(side.rear), *_edges(side, STEEL), *_sign(p, side, (0.1, 0.9), (0.3, 0.8))]
    for wall in side[:2]:
        for share in np.linspace(0.03, 0.97, max(6, round(length / 0.7))):
            parts.append(
                panel(wall, (share - 0.002, share + 0.002), (0.02, 0.95), darker(p.body, 0.5))
            )
            parts.append(panel(wall, (share - 0.004, share + 0.004), (0.0, 0.06), TRIM, lift=0.03))
    return parts


def _flatbed(p: TruckParams) -> list[Asset]:
    x, length, width = bed(p)
    low, half = floor(p), width / 2
    front, rear = x + length / 2, x - length / 2
    rng = np.random.default_rng(p.seed)
    parts = [
        block((rear, -half, low), (front, half, low + 0.14), p.body, "wood"),
        block((front - 0.08, -half, low), (front, half, p.height + 0.4), STEEL, "metal"),
    ]
    start = rear + 0.15
    while start < rear + p.fill * length:
        size = rng.uniform(0.7, 1.6)
        end = min(start + size, front - 0.2)
        tall = low + 0.14 + rng.uniform(0.35, 1.0) * (p.height - low)
        wide = rng.uniform(0.55, 0.95) * half
        kind = rng.integers(3)
        if kind == 0:  # pipes
            for y in np.arange(-wide, wide, 0.24):
                parts.append(
                    tube(
                        (start, y, low + 0.27), (end, y, low + 0.27), 0.11, STEEL, "metal", sides=8
                    )
                )
                parts.append(
                    tube(
                        (start, y + 0.1, low + 0.47),
                        (end, y + 0.1, low + 0.47),
                        0.11,
                        STEEL,
                        "metal",
                        sides=8,
                    )
                )
        else:
            color = (_WHITE, (0.16, 0.10, 0.06), p.cab, (0.25, 0.07, 0.03))[int(rng.integers(4))]
            parts.append(
                block(
                    (start, -wide, low + 0.16),
                    (end, wide, tall),
                    color,
                    "wood" if kind == 1 else "cloth",
                )
            )
            for at in (0.3, 0.7):
                strap = start + at * (end - start)
                parts.append(
                    block(
                        (strap - 0.03, -wide - 0.01, low + 0.16),
                        (strap + 0.03, wide + 0.01, tall + 0.01),
                        AMBER,
                    )
                )
        start = end + rng.uniform(0.05, 0.3)
    if p.fill < 0.75:  # drop sides
        for y in (half, -half):
            parts.append(
                block((rear, y - 0.02, low + 0.1), (front, y + 0.02, low + 0.5), p.cab, "metal")
            )
    return parts


def _tub(
    x: float, length: float, half: float, low: float, high: float, slope: float
) -> list[np.ndarray]:
    """Lower and upper edge of an open body that widens upwards."""
    plan = np.array([(-0.5, -1, 0), (0.5, -1, 0), (0.5, 1, 0), (-0.5, 1, 0)])
    lower = plan * [length * (1 - slope), half - 0.1, 0] + [x, 0, low]
    return [lower, plan * [length, half, 0] + [x, 0, high]]


def _tipper(p: TruckParams) -> list[Asset]:
    x, length, width = bed(p)
    low, half, high = floor(p), width / 2, p.height
    edge = _tub(x, length, half, low, high, 0.04)
    heap = edge[1] * [1, 0.9, 1] - [0, 0, 0.12]
    peak = (heap - [x, 0, 0]) * [0.4, 0.3, 1] + [x, 0, 0.6 * p.fill]
    parts = [
        loft(edge, p.body, "metal"),
        loft([heap, peak], _GRAVEL, "concrete"),
        block((x + length / 2, -half, high - 0.1), (x + length / 2 + 0.7, half, high), p.body),
        tube((x + length / 2 + 0.15, 0, low), (x + length / 2 + 0.1, 0, high), 0.1, STEEL, "metal"),
    ]
    for share in np.linspace(0.04, 0.96, 7):  # ribs
        post = x + (share - 0.5) * length
        rib = block(
            (post - 0.05, half - 0.16, low),
            (post + 0.05, half + 0.03, high),
            darker(p.body, 0.8),
            "metal",
        )
        parts.append(pair(rib))
    rail = block(
        (x - length / 2, half - 0.06, high - 0.08),
        (x + length / 2, half + 0.04, high),
        p.body,
        "metal",
    )
    side = walls(length, width + 0.08, low, high, x=x)
    return [*parts, pair(rail), *_sign(p._replace(band=None), side, (0.3, 0.7), (0.35, 0.7))]


def _tanker(p: TruckParams) -> list[Asset]:
    x, length, width = bed(p)
    low = floor(p)
    radius = (p.height - low) / 2
    middle = low + radius
    angle = np.arange(20) * np.pi / 10
    loop = np.column_stack([np.cos(angle) * 0.49 * width, np.sin(angle) * radius])
    rings = []
    for share, scale in (
        (-0.5, 0.55),
        (-0.49, 0.8),
        (-0.46, 0.97),
        (-0.44, 1.0),
        (0.44, 1.0),
        (0.46, 0.97),
        (0.49, 0.8),
        (0.5, 0.55),
    ):
        rings.append(np.column_stack([np.full(20, x + share * length), loop * scale + [0, middle]]))
    parts = [
        loft(rings, p.body, "metal"),
        block(
            (x - 0.4 * length, -0.3, p.height - 0.04),
            (x + 0.4 * length, 0.3, p.height + 0.05),
            TRIM,
        ),
        block((x - length / 2, -0.5, low - 0.1), (x + length / 2, 0.5, low + 0.15), TRIM),
        tube(
            (x - length / 2 - 0.02, 0.5, low),
            (x - length / 2 - 0.02, 0.5, p.height),
            0.03,
            STEEL,
            sides=4,
        ),
        tube(
            (x - length / 2 - 0.02, 0.8, low),
            (x - length / 2 - 0.02, 0.8, p.height - 0.1),
            0.03,
            STEEL,
            sides=4,
        ),
    ]
    for share in (-0.3, -0.05, 0.2):  # bands round the tank and manholes on it
        wide = np.concatenate([loop, loop[:1]]) * 1.012 + [0, middle]
        band = [
            np.column_stack([np.full(21, x + (share + d) * length), wide]) for d in (-0.008, 0.008)
        ]
        parts.append(loft(band, p.band or STEEL, "metal", closed=False, caps=False))
        at = x + (share + 0.1) * length
        parts.append(
            tube((at, 0, p.height - 0.1), (at, 0, p.height + 0.16), 0.25, STEEL, "metal", sides=10)
        )
    side = walls(0.8 * length, width + 0.01, low + 0.6 * radius, low + 1.4 * radius, x=x)
    if p.letters is not None:
        parts += [lettering(wall, (0.2, 0.8), (0.2, 0.75), p.letters, p.seed) for wall in side[:2]]
    rear = walls(length + 0.02, width, low + 0.5 * radius, low + 1.5 * radius, x=x).rear
    return [*parts, panel(rear, (0.4, 0.6), (0.4, 0.6), AMBER)]


def _refuse(p: TruckParams) -> list[Asset]:
    """A hopper body whose rear loader hangs lower than its floor and leans out."""
    x, length, width = bed(p)
    low, half = floor(p), width / 2
    tail, split = x - length / 2, x - length / 2 + 1.5
    side = walls(x + length / 2 - split, width, low, p.height, x=(x + length / 2 + split) / 2)
    outline = np.array(
        [(split, 0.55), (split, p.height), (tail + 0.7, p.height), (tail, 1.6), (tail + 0.15, 0.55)]
    )
    rings = [np.column_stack([outline[:, 0], np.full(5, y), outline[:, 1]]) for y in (half, -half)]
    slope = np.array(
        [
            (tail, half, 1.6),
            (tail, -half, 1.6),
            (tail + 0.7, -half, p.height),
            (tail + 0.7, half, p.height),
        ]
    )
    parts = [
        block((split, -half, low), (x + length / 2, half, p.height - 0.15), p.body, "paint"),
        loft(rings, darker(p.body, 0.8), "paint"),
        panel(slope, (0.12, 0.88), (0.02, 0.45), BLACK),
        panel(slope, (0, 1), (0.62, 0.72), AMBER),
        *_sign(p, side, (0.2, 0.8), (0.35, 0.65)),
    ]
    for share in np.linspace(0.04, 0.96, 6):  # ribs
        post = split + share * (x + length / 2 - split)
        rib = block(
            (post - 0.05, half - 0.02, low),
            (post + 0.05, half + 0.05, p.height - 0.2),
            darker(p.body, 0.75),
        )
        parts.append(pair(rib))
    bar = tube(
        (tail + 0.15, half + 0.03, 0.7), (tail + 0.5, half + 0.03, 2.2), 0.05, STEEL, "metal"
    )
    lamp = block((tail - 0.02, half - 0.3, 1.25), (tail + 0.1, half - 0.05, 1.5), TAILLAMP, "lamp")
    return [*parts, pair(bar), pair(lamp)]


def _mixer(p: TruckParams) -> list[Asset]:
    """A slanting drum with painted spirals, a hopper and a chute."""
    x, length, _ = bed(p)
    low, radius = floor(p), (p.height - floor(p)) / 2 - 0.1
    profile = [(0.3, 0.5), (0.72, 0.42), (1, 0.12), (1, -0.08), (0.62, -0.38), (0.42, -0.5)]
    drum = revolve([(radius * r, -length * 0.9 * y) for r, y in profile], p.body, "paint", sides=24)
    middle = drum.mesh.triangles_center
    turn = np.arctan2(middle[:, 2], middle[:, 0]) + 2.5 * middle[:, 1]
    stripe = np.cos(turn) > 0.75  # a spiral of two bands
    drum.color[stripe] = p.band or _WHITE
    vertices = np.asarray(drum.mesh.vertices)[:, [1, 0, 2]] * [-1, 1, 1]
    tilt = 0.16
    turned = np.column_stack([
        vertices[:, 0] * np.cos(tilt) + vertices[:, 2] * np.sin(tilt),
        vertices[:, 1],
        vertices[:, 2] * np.cos(tilt) - vertices[:, 0] * np.sin(tilt),
    ])  # fmt: skip
    drum.mesh.vertices = turned
    rear = x - length / 2
    chute = [
        (rear + 0.5, 0.25, 1.9),
        (rear + 0.5, -0.25, 1.9),
        (rear - 0.1, -0.2, 1.2),
        (rear - 0.1, 0.2, 1.2),
    ]
    return [
        moved(drum, x, 0, low + radius + 0.25),
        block((x + 0.32 * length, -0.5, low), (x + 0.42 * length, 0.5, low + 1.1), p.cab),
        pair(tube((rear + 0.7, 0.8, low), (rear + 0.5, 0.3, p.height - 0.4), 0.06, p.cab, "metal")),
        loft([np.array(chute), np.array(chute) - [0, 0, 0.06]], STEEL, "metal"),
        tube(
            (rear + 0.6, 0, p.height - 0.75),
            (rear + 0.45, 0, p.height),
            0.3,
            p.cab,
            "paint",
            end_radius=0.6,
            sides=8,
        ),
    ]


def _skip(p: TruckParams) -> list[Asset]:
    """A skip between two lifting arms."""
    x, length, width = bed(p)
    low, half = floor(p), width / 2
    edge = _tub(x - 0.1 * length, 0.66 * length, half - 0.3, low + 0.2, p.height - 0.3, 0.45)
    heap = edge[1] * [1, 0.95, 1] - [0, 0, 0.1]
    peak = (heap - [x, 0, 0]) * [0.5, 0.4, 1] + [x, 0, 0.5 * p.fill]
    root, tip = (
        (x - 0.05 * length, half - 0.12, low + 0.2),
        (x - 0.38 * length, half - 0.12, p.height),
    )
    return [
        block((x - length / 2, -half, low), (x + length / 2, half, low + 0.16), TRIM, "metal"),
        loft(edge, p.body, "metal"),
        loft([heap, peak], (0.13, 0.10, 0.08), "concrete"),
        pair(tube(root, tip, 0.12, p.cab, "paint", sides=4)),
        pair(tube((root[0] + 0.28 * length, root[1], low + 0.2), root, 0.07, STEEL, "metal")),
        pair(tube(tip, (tip[0] + 0.1, half - 0.3, p.height - 0.4), 0.02, BLACK, sides=4)),
    ]


def _recovery(p: TruckParams) -> list[Asset]:
    """A tilting platform with a crane behind the cab."""
    x, length, width = bed(p)
    low, half = floor(p), width / 2
    front, rear = x + length / 2, x - length / 2 + 0.5  # ahead of the ramp
    elbow = (front - 0.3, 0.0, p.height + 0.3)
    hook = (front - 0.3 - 0.45 * length * p.fill, 0.0, p.height + 0.1)
    bar = block(
        (front - 0.05, -0.7, p.height - 0.35), (front + 0.1, 0.7, p.height - 0.2), AMBER, "lamp"
    )
    rail = block((rear, half - 0.06, low), (front, half, low + 0.22), p.body, "metal")
    return [
        block((rear, -half, low - 0.05), (front, half, low + 0.1), STEEL, "metal"),
        pair(rail),
        bar,
        tube((front - 0.3, 0, low), elbow, 0.16, p.cab, "paint", sides=8),
        tube(elbow, hook, 0.11, p.cab, "paint", sides=6),
        tube(hook, (hook[0], 0, hook[2] - 0.7), 0.02, BLACK, sides=4),
        polygon(
            [
                (rear, half, low),
                (rear, -half, low),
                (rear - 0.5, -half, 0.6),
                (rear - 0.5, half, 0.6),
            ],
            STEEL,
            "metal",
        ),
    ]


def _luton(p: TruckParams) -> list[Asset]:
    """A box that reaches forward over the cab."""
    x, length, width = bed(p)
    front = x + length / 2
    brow = [
        (front, p.cab_height + 0.04),
        (front + 1.0, p.cab_height + 0.1),
        (front + 1.15, p.height - 0.35),
        (front + 0.9, p.height),
        (front, p.height),
    ]
    rings = [np.array([(u, y, v) for u, v in brow]) for y in (width / 2, -width / 2)]
    return [*_box(p), loft(rings, p.body, "paint")]


LOADS: dict[str, Callable[[TruckParams], list[Asset]]] = {
    "box": _box,
    "curtain": _curtain,
    "flatbed": _flatbed,
    "tipper": _tipper,
    "tanker": _tanker,
    "refuse": _refuse,
    "mixer": _mixer,
    "skip": _skip,
    "recovery": _recovery,
    "luton": _luton,
}
"""Every load by name."""


def load(p: TruckParams) -> Asset:
    """What the lorry of ``p`` carries."""
    return merge(*LOADS[p.load](p))
