"""Traffic light heads that hang on a signpost at x = y = 0 and face the camera (-x)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, box, disc, merge, quad, tube, vary
from scene.assets.signpost import MAX_RADIUS, MIN_HEIGHT

KINDS: tuple[str, ...] = ("single", "backed", "double", "pedestrian", "tall", "yellow")

RED: Color = (0.95, 0.05, 0.03)
AMBER: Color = (0.98, 0.45, 0.03)
GREEN: Color = (0.05, 0.95, 0.45)
UNLIT = 0.06
"""Brightness of a lamp that is off, as a share of its lit colour."""

LIT_ODDS = (0.5, 0.4, 0.1)
"""How often the first, the last and the second lamp shines."""


class TrafficLightParams(NamedTuple):
    """One or more equal heads side by side, each a column of lamps."""

    centre: float  # height of the heads' centre, m
    heads: tuple[float, ...]  # y of each head, m
    lamps: tuple[Color, ...]  # lit colours from the top down
    lit: tuple[int, ...]  # lamp that shines in each head
    spacing: float  # between lamps, m
    lamp_radius: float  # m
    width: float  # of the housing, m
    depth: float  # of the housing, m
    board: float  # margin of the board behind the housing, m; 0 for none
    board_edge: Color  # white in Britain
    color: Color


def sample_traffic_light(rng: np.random.Generator, kind: str) -> TrafficLightParams:
    """Draw a light of one of ``KINDS``."""
    if kind not in KINDS:
        raise ValueError(f"unknown kind of traffic light {kind!r}; known: {', '.join(KINDS)}")
    lamps = {"pedestrian": (RED, GREEN), "tall": (RED, AMBER, GREEN, GREEN)}.get(
        kind, (RED, AMBER, GREEN)
    )
    spread = float(rng.uniform(0.26, 0.36))
    heads = (-spread, spread) if kind == "double" else (0.0,)
    lamp_radius = float(rng.uniform(0.10, 0.125))
    spacing = 2 * lamp_radius + float(rng.uniform(0.05, 0.09))
    half = len(lamps) * spacing / 2
    # The housing must reach down to the shortest post.
    centre = float(rng.uniform(2.3, min(3.0, MIN_HEIGHT - 0.1 + half)))
    yellow = vary(rng, (0.55, 0.33, 0.02), 0.2)
    return TrafficLightParams(
        centre=centre, heads=heads, lamps=lamps,
        lit=tuple(int(i) for i in rng.choice((0, len(lamps) - 1, 1), len(heads), p=LIT_ODDS)),
        spacing=spacing, lamp_radius=lamp_radius, width=2 * lamp_radius + 0.1,
        depth=float(rng.uniform(0.16, 0.24)),
        board=float(rng.uniform(0.1, 0.18)) if kind in ("backed", "tall") else 0.0,
        board_edge=vary(rng, (0.6, 0.6, 0.58)) if rng.random() < 0.6 else (0.02, 0.02, 0.02),
        color=yellow if kind == "yellow" else vary(rng, (0.02, 0.022, 0.022), 0.3),
    )  # fmt: skip


def _lamp(params: TrafficLightParams, y: float, z: float, color: Color) -> list[Asset]:
    """A lens and the visor over it, in front of the housing."""
    front = -MAX_RADIUS - params.depth
    lens = disc((front - 0.006, y, z), params.lamp_radius, color, "lamp", sides=8)
    visor = tube(
        (front, y, z + 0.01), (front - 0.16, y, z + 0.035), 1.08 * params.lamp_radius,
        params.color, "plain", sides=8, caps=False,
    )  # fmt: skip
    # A visor is open below: drop the sides under the lens.
    upper = visor.mesh.triangles_center[:, 2] > z - 0.4 * params.lamp_radius
    visor.mesh.update_faces(upper)
    return [lens, visor._replace(color=visor.color[upper], material=visor.material[upper])]


def _board(params: TrafficLightParams, y: float, half: float) -> list[Asset]:
    """A dark board with a pale edge behind the housing."""
    layers = []
    for depth, margin, color in ((0.01, params.board, params.board_edge),
                                 (0.02, params.board - 0.035, (0.02, 0.02, 0.02))):  # fmt: skip
        x, w, h = -MAX_RADIUS - depth, params.width / 2 + margin, half + margin
        z = params.centre
        corners = [(x, y - w, z - h), (x, y + w, z - h), (x, y + w, z + h), (x, y - w, z + h)]
        layers.append(quad(corners, color, "plain"))
    return layers


def _head(params: TrafficLightParams, y: float, lit: int) -> list[Asset]:
    p = params
    half = len(p.lamps) * p.spacing / 2 + 0.03
    x = -MAX_RADIUS - p.depth / 2
    parts = [box((p.depth, p.width, 2 * half), (x, y, p.centre - half), p.color, "plain")]
    for i, color in enumerate(p.lamps):
        z = p.centre + ((len(p.lamps) - 1) / 2 - i) * p.spacing
        red, green, blue = np.asarray(color) * (1.0 if i == lit else UNLIT)
        parts += _lamp(p, y, z, (red, green, blue))
    return parts + (_board(p, y, half) if p.board else [])


def traffic_light(params: TrafficLightParams) -> Asset:
    """Build the light."""
    p = params
    parts = [part for y, lit in zip(p.heads, p.lit, strict=True) for part in _head(p, y, lit)]
    if len(p.heads) > 1:
        reach = max(p.heads) - min(p.heads)
        parts.append(box((0.06, reach, 0.06), (-MAX_RADIUS - 0.03, 0, p.centre), p.color, "plain"))
    return merge(*parts)
