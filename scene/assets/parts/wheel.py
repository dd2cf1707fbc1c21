"""Road wheels: a tyre and a dished rim with spokes, a hub cap or holes in bare steel."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from scene.assets.parts.palette import BLACK, STEEL, TYRE
from scene.assets.parts.skin import mirrored, revolve
from scene.mesh.asset import Asset, Color, merge, solid, translate

_SPOKES = {"spokes": ((0.0, 0.46),), "twin spokes": ((-0.2, 0.2), (0.2, 0.2))}
"""Turn and width of each spoke, as shares of the gap between two."""
_HOLES = {"cap": (0.72, 0.88), "steel": (0.55, 0.85)}
"""Inner and outer edge of the holes, as shares of the rim."""
STYLES: tuple[str, ...] = (*_SPOKES, *_HOLES)
"""Designs of a rim's face."""


class Wheel(NamedTuple):
    """One wheel; metres."""

    radius: float
    width: float
    style: str = "spokes"
    spokes: int = 5
    rim_share: float = 0.66  # of the radius
    color: Color = STEEL
    dish: float = 0.18  # depth of the rim's floor, as a share of the width


@lru_cache(maxsize=8)  # the axles of a lorry share one
def wheel(w: Wheel, *, sides: int = 14) -> Asset:
    """Build a wheel standing on z = 0 at x = 0, its outer face in y = 0, facing +y."""
    r, rim = w.radius, w.rim_share * w.radius
    tread = [(rim, 0.0), (0.93 * r, -0.004), (r, -0.16 * w.width), (r, -0.9 * w.width)]
    dish = -w.dish * w.width
    floor = w.color if w.style in _HOLES else BLACK
    parts = [
        revolve(tread[::-1], TYRE, "rubber", sides=sides),
        revolve([(0.92 * rim, dish), (rim, 0.0)][::-1], w.color, "metal", sides=sides),
        _sectors(np.zeros(1), (0.0, 0.93 * rim), 2 * np.pi, dish, floor, sides=sides),
        _sectors(np.zeros(1), (0.0, 0.2 * rim), 2 * np.pi, 0.1 * dish, w.color, sides=6),
    ]
    turn = np.arange(w.spokes) * 2 * np.pi / w.spokes + np.pi / 2
    gap = 2 * np.pi / w.spokes
    for side, width in _SPOKES.get(w.style, ()):
        arms, span = turn + side * gap, (0.1 * rim, 0.95 * rim)
        parts.append(_sectors(arms, span, width * gap, 0.45 * dish, w.color))
    if w.style in _HOLES:
        low, high = _HOLES[w.style]
        parts.append(_sectors(turn, (low * rim, high * rim), 0.5 * gap, 0.9 * dish, BLACK))
    return translate(merge(*parts), (0, 0, r))


def _sectors(
    turn: np.ndarray,
    span: tuple[float, float],
    width: float,
    y: float,
    color: Color,
    *,
    sides: int = 1,
) -> Asset:
    """Build sectors around the hub, each ``width`` radians wide between two radii, facing +y."""
    low, high = span
    angle = turn[:, None] + np.linspace(-0.5, 0.5, sides + 1) * width
    # The foot of a spoke is about as wide as its tip; a true sector would shrink to nothing.
    foot = turn[:, None] + np.linspace(-0.5, 0.5, sides + 1) * width * min(
        1.6, high / max(low, 1e-3) / 3
    )
    rows = [(low, foot), (high, angle)] if low > 0 else [(high, angle)]
    points = np.concatenate(
        [np.stack([r * np.cos(a), np.full_like(a, y), r * np.sin(a)], -1) for r, a in rows], 1
    )
    n, k = sides + 1, np.arange(sides)
    if low > 0:
        faces = np.concatenate(
            [np.stack([k, k + 1, k + n + 1], 1), np.stack([k, k + n + 1, k + n], 1)]
        )
    else:
        points = np.concatenate([points, np.broadcast_to([0, y, 0], (len(turn), 1, 3))], 1)
        faces = np.stack([k + 1, k, np.full_like(k, n)], 1)[:, ::-1]
    steps = np.arange(len(turn))[:, None, None] * points.shape[1]
    return solid(points.reshape(-1, 3), (faces + steps).reshape(-1, 3), color, "metal")


def wheels(w: Wheel, axles: tuple[float, ...], half_width: float, *, sides: int = 14) -> Asset:
    """Build a wheel on either side of every axle x, outer faces at ``half_width``, m."""
    left = translate(wheel(w, sides=sides), (0, half_width, 0))
    right = mirrored(left)
    return merge(*(translate(side, (x, 0, 0)) for x in axles for side in (left, right)))
