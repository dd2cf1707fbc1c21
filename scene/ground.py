"""The ground: carriageway with markings and crosswalks, kerb, sidewalk and terrain.

Flat but for the kerb. The carriageway reaches ``ROAD_HALF_WIDTH`` from the centre line, then comes the
sidewalk, then terrain to the horizon.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.asset import Asset, box, merge, quad
from scene.classes import TrainId

ROAD_HALF_WIDTH = 5.0
SIDEWALK_WIDTH = 3.0
KERB_HEIGHT = 0.12
KERB_WIDTH = 0.18
GROUND_START, GROUND_END, GROUND_SIDE = -40.0, 600.0, 400.0
"""Extent of the ground, metres: along the road from, to, and to each side."""
PAINT_LIFT = 0.008
"""Markings lie this far above the asphalt, metres."""

GROUND_INSTANCES: dict[int, int] = {
    1: int(TrainId.ROAD),
    2: int(TrainId.SIDEWALK),
    3: int(TrainId.TERRAIN),
}
"""Instance id -> train id of the three ground surfaces."""


class Ground(NamedTuple):
    """What varies from one road surface to the next; colours are linear RGB."""

    asphalt: tuple[float, float, float]
    paving: tuple[float, float, float]
    terrain: tuple[float, float, float]
    terrain_material: str
    dash: tuple[float, float]  # metres painted, metres bare, on the centre line
    edge_lines: int  # 0 none, 1 one line, 2 double line along each kerb
    edge_yellow: bool
    crosswalks: tuple[float, ...]  # metres along the road


def ground_height(y: float) -> float:
    """Height of the ground ``y`` metres from the centre line."""
    return 0.0 if abs(y) < ROAD_HALF_WIDTH else KERB_HEIGHT


def sample_ground(rng: np.random.Generator) -> Ground:
    """Draw a road surface: shade, markings, crosswalks every 40-90 m, grass, gravel or paving."""
    grey = rng.uniform(0.05, 0.13)
    paving = rng.uniform(0.08, 0.24)
    warmth = rng.uniform(0.0, 0.12)
    kind = rng.choice(["grass", "dry grass", "earth"], p=[0.6, 0.25, 0.15])
    terrain = {
        "grass": (0.07, 0.12, 0.03),
        "dry grass": (0.16, 0.15, 0.06),
        "earth": (0.17, 0.12, 0.08),
    }[str(kind)]
    shade = rng.uniform(0.7, 1.3)
    crosswalks, x = [], rng.uniform(5, 60)
    while x < 150:
        crosswalks.append(float(x))
        x += rng.uniform(40, 90)
    return Ground(
        asphalt=(grey, grey * 1.01, grey * 1.05),
        paving=(paving, paving * (1 - 0.4 * warmth), paving * (1 - warmth)),
        terrain=(terrain[0] * shade, terrain[1] * shade, terrain[2] * shade),
        terrain_material="concrete" if kind == "earth" else "grass",
        dash=(float(rng.uniform(2, 4)), float(rng.uniform(2, 6))),
        edge_lines=int(rng.choice([0, 1, 2], p=[0.35, 0.35, 0.3])),
        edge_yellow=bool(rng.random() < 0.6),
        crosswalks=tuple(crosswalks) if rng.random() < 0.7 else (),
    )


def _strip(
    y0: float, y1: float, z: float, color: tuple[float, float, float], material: str
) -> Asset:
    """A ground strip between two distances from the centre line (both signs give both sides)."""
    x0, x1 = GROUND_START, GROUND_END
    return quad([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], color, material)


def _paint(
    x: float, y: float, length: float, width: float, color: tuple[float, float, float]
) -> Asset:
    """A painted rectangle centred on (x, y)."""
    a, b = length / 2, width / 2
    z = PAINT_LIFT
    corners = [(x - a, y - b, z), (x + a, y - b, z), (x + a, y + b, z), (x - a, y + b, z)]
    return quad(corners, color, "marking")


def ground_assets(ground: Ground) -> dict[int, Asset]:
    """The three surfaces by instance id: road with its markings, sidewalk with its kerb, terrain."""
    white = (0.55, 0.55, 0.53)
    edge = (0.5, 0.36, 0.06) if ground.edge_yellow else white
    outer = ROAD_HALF_WIDTH + SIDEWALK_WIDTH
    road = [_strip(-ROAD_HALF_WIDTH, ROAD_HALF_WIDTH, 0.0, ground.asphalt, "asphalt")]
    painted, bare = ground.dash
    starts = np.arange(-20.0, 200.0, painted + bare)
    clear = [x for x in starts if all(abs(x - c) > 4 + painted / 2 for c in ground.crosswalks)]
    road += [_paint(x, 0.0, painted, 0.13, white) for x in clear]
    length = GROUND_END - GROUND_START
    middle = (GROUND_END + GROUND_START) / 2
    for side in (-1, 1):
        for k in range(ground.edge_lines):
            y = side * (ROAD_HALF_WIDTH - 0.3 - 0.22 * k)
            road.append(_paint(middle, y, length, 0.1, edge))
    for x in ground.crosswalks:
        stripes = np.arange(-ROAD_HALF_WIDTH + 0.6, ROAD_HALF_WIDTH - 0.3, 1.0)
        road += [_paint(x, float(y), 3.0, 0.5, white) for y in stripes]
        # Stop lines before and behind.
        road += [_paint(x + d, 0.0, 0.3, 2 * ROAD_HALF_WIDTH - 1.4, white) for d in (-3.0, 3.0)]
    sidewalk, terrain = [], []
    for side in (-1, 1):
        inner = side * (ROAD_HALF_WIDTH + KERB_WIDTH)
        sidewalk.append(_strip(inner, side * outer, KERB_HEIGHT, ground.paving, "paving"))
        kerb = box(
            (length, KERB_WIDTH, KERB_HEIGHT + 0.005),
            (middle, side * (ROAD_HALF_WIDTH + KERB_WIDTH / 2), 0.0),
            (0.3, 0.3, 0.29),
            "concrete",
        )
        sidewalk.append(kerb)
        terrain.append(
            _strip(
                side * outer,
                side * GROUND_SIDE,
                KERB_HEIGHT,
                ground.terrain,
                ground.terrain_material,
            )
        )
    return {1: merge(*road), 2: merge(*sidewalk), 3: merge(*terrain)}
