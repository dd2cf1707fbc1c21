"""What road and rail vehicles share: wheels, hulls, and glass and lamps laid on their walls."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, Point, loft, merge, polygon, tube
from scene.assets._palette import BLACK, GLASS, STEEL, TYRE

Corners = np.ndarray
"""f64[4, 3]: a wall seen from outside, anticlockwise from its lower left corner."""


def circle(centre: Point, radius: float, sides: int) -> np.ndarray:
    """Points [sides, 3] of a circle that stands in the x-z plane, the first one lowest."""
    angle = (np.arange(sides) / sides - 0.25) * 2 * np.pi
    ring = np.column_stack([np.cos(angle), np.zeros(sides), np.sin(angle)])
    return np.asarray(centre) + radius * ring


def rod(start: Point, end: Point, radius: float, color: Color, material: str = "metal") -> Asset:
    """A thin bar of four sides without ends; 8 faces."""
    return tube(start, end, radius, color, material, sides=4, caps=False)


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


def wheel(
    x: float,
    y: float,
    radius: float,
    width: float,
    rim: Color | None = STEEL,
    *,
    rim_share: float = 0.64,
    sides: int = 10,
) -> Asset:
    """A wheel on the ground at ``x`` with its outer face at ``y``; 4 faces a side less 4."""
    outward = np.sign(y)
    face = circle((x, y, radius), radius, sides)
    inner = face - [0, outward * width, 0]
    tyre = merge(loft([inner, face], TYRE, "rubber", caps=False), polygon(face, TYRE, "rubber"))
    if rim is None:
        return tyre
    disc = circle((x, y + 0.008 * outward, radius), rim_share * radius, sides)
    return merge(tyre, polygon(disc, rim, "metal"))


def axle(
    x: float,
    half_width: float,
    radius: float,
    width: float,
    rim: Color | None = STEEL,
    *,
    rim_share: float = 0.64,
    sides: int = 10,
) -> Asset:
    """A wheel on either side, outer faces at ``half_width``."""
    return merge(
        *(
            wheel(x, y, radius, width, rim, rim_share=rim_share, sides=sides)
            for y in (half_width, -half_width)
        )
    )


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
    wall: Corners,
    u: tuple[float, float],
    v: tuple[float, float],
    color: Color,
    material: str = "plain",
    *,
    lift: float = 0.012,
) -> Asset:
    """A rectangle laid on ``wall``: shares ``u`` along and ``v`` up it, ``lift`` m outside."""
    low_left, low_right, high_right, high_left = wall
    normal = np.cross(low_right - low_left, high_left - low_left)
    outside = lift * normal / np.linalg.norm(normal)
    corners = [
        (low_left * (1 - s) + low_right * s) * (1 - t) + (high_left * (1 - s) + high_right * s) * t
        for s, t in ((u[0], v[0]), (u[1], v[0]), (u[1], v[1]), (u[0], v[1]))
    ]
    return polygon(np.array(corners) + outside, color, material)


def window_row(
    wall: Corners, count: int, u: tuple[float, float], v: tuple[float, float], pillar: float = 0.12
) -> Asset:
    """``count`` panes side by side in the rectangle ``u``, ``v``; ``pillar`` of a bay apart."""
    edges = np.linspace(*u, count + 1)
    gap = (edges[1] - edges[0]) * pillar / 2
    return merge(*(panel(wall, (a + gap, b - gap), v, GLASS, "glass") for a, b in pairwise(edges)))


def hull(
    length: float,
    width: float,
    low: float,
    high: float,
    color: Color,
    *,
    x: float = 0,
    chamfer: float = 0.15,
    nose: float = 0.0,
    tail: float = 0.0,
    material: str = "paint",
) -> Asset:
    """A body with chamfered roof edges; ``nose`` and ``tail`` are metres its roof is set back."""
    half = width / 2
    section = np.array(
        [(half, low), (half, high - chamfer), (half - chamfer, high)]
        + [(chamfer - half, high), (-half, high - chamfer), (-half, low)]
    )
    up = (section[:, 1] - low) / (high - low)
    front = np.column_stack([x + length / 2 - nose * up, section])
    rear = np.column_stack([x - length / 2 + tail * up, section])
    return loft([rear, front], color, material)


def lamps(
    wall: Corners, u: tuple[float, float], v: tuple[float, float], color: Color, lift: float = 0.015
) -> Asset:
    """A pair of lamps on ``wall``, mirrored about its middle."""
    return merge(
        panel(wall, u, v, color, "lamp", lift=lift),
        panel(wall, (1 - u[1], 1 - u[0]), v, color, "lamp", lift=lift),
    )
