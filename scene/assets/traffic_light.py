"""Traffic light heads that hang on a signpost at x = y = 0 and face the camera (-x)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.family import SIGN, Family, Size
from scene.assets.parts.draw import near, sample_fields
from scene.assets.parts.palette import (
    LIGHT_AMBER,
    LIGHT_GREEN,
    LIGHT_RED,
    LIGHT_WHITE,
    SIGNAL_BLACK,
    SIGNAL_YELLOW,
    WHITE,
)
from scene.assets.parts.skin import in_plane
from scene.assets.signpost import MAX_RADIUS, MIN_HEIGHT
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Parts, merge
from scene.mesh.solids import box, disc, loft, polygon

UNLIT = 0.05
"""Brightness of a lamp that is off, as a share of its lit colour; its material is glass, not lamp."""


class Head(NamedTuple):
    """One column of lamps."""

    y: float  # m
    lamps: tuple[Color, ...]  # lit colours from the top down
    lit: int  # index of the lamp that is on
    scale: float = 1.0  # of the lamps


class _Kind(NamedTuple):
    """What all lights of a kind have in common."""

    columns: tuple[tuple[tuple[Color, ...], float], ...]  # lamps and scale of each head
    lit: int  # index of the lamp that is on in the first head
    board: float = 0.0  # margin of the board behind the housing, m; 0 for none
    edge: Color = SIGNAL_BLACK  # of the board; white in Britain
    round_board: bool = False
    hoods: bool = True  # long visors; else short ones
    color: Color = SIGNAL_BLACK
    front: Color = SIGNAL_BLACK  # of the housing's face


class TrafficLightParams(NamedTuple):
    """One or more heads side by side."""

    centre: float  # height of the heads' centre, m
    heads: tuple[Head, ...]
    lamp_radius: float  # m
    depth: float  # of the housing, m
    kind: _Kind  # with its colours drawn


_THREE = ((LIGHT_RED, LIGHT_AMBER, LIGHT_GREEN), 1.0)
_WALK = ((LIGHT_RED, LIGHT_GREEN), 1.0)
_KINDS: dict[str, _Kind] = {
    "backed red": _Kind((_THREE,), 0, 0.15, WHITE),
    "backed green": _Kind((_THREE,), 2, 0.15, WHITE),
    "pedestrian": _Kind((_WALK,), 0, hoods=False),
    "single": _Kind((_THREE,), 2),
    "double": _Kind((_THREE, _THREE), 0),
    "filter arrow": _Kind((_THREE, ((LIGHT_GREEN,), 1.0)), 2, 0.12, SIGNAL_BLACK),
    "yellow": _Kind((_THREE,), 0, color=SIGNAL_YELLOW, front=SIGNAL_BLACK),
    "tall": _Kind((((LIGHT_RED, LIGHT_AMBER, LIGHT_GREEN, LIGHT_GREEN), 1.0),), 3, 0.16, SIGNAL_BLACK, True),
    "cycle": _Kind((((LIGHT_RED, LIGHT_AMBER, LIGHT_GREEN), 0.55), _WALK), 1, color=(0.05, 0.05, 0.055)),
    "tram": _Kind((((LIGHT_WHITE, LIGHT_AMBER, LIGHT_WHITE), 0.85),), 0, 0.13, (0.4, 0.03, 0.03), True,
                 color=(0.16, 0.165, 0.17)),
}  # fmt: skip


def sample_traffic_light(rng: np.random.Generator, kind: str) -> TrafficLightParams:
    """Draw a light of one kind; a second head shows the first one's colour if it has that."""
    entry = _KINDS[kind]
    radius = float(rng.uniform(0.10, 0.118))
    spread = float(rng.uniform(0.26, 0.32))
    places = (0.0,) if len(entry.columns) == 1 else (-spread, spread)
    lit_color = entry.columns[0][0][entry.lit]
    lit = [lamps.index(lit_color) if lit_color in lamps else 0 for lamps, _ in entry.columns]
    lit[0] = entry.lit  # there may be two lamps of this colour
    heads = tuple(
        Head(y, lamps, lit_lamp, scale)
        for y, (lamps, scale), lit_lamp in zip(places, entry.columns, lit, strict=True)
    )
    half_height = max(len(h.lamps) * h.scale for h in heads) * (radius + 0.03)
    # The housing must reach down to the shortest post.
    centre = float(rng.uniform(2.3, min(2.95, MIN_HEIGHT - 0.1 + half_height)))
    depth = float(rng.uniform(0.18, 0.24))
    entry = sample_fields(rng, entry, edge=near(0.1), color=near(0.25), front=near(0.25))
    return TrafficLightParams(centre, heads, radius, depth, entry)


def _lamp(
    p: TrafficLightParams, y: float, z: float, radius: float, color: Color, *, lit: bool
) -> Parts:
    """Build a lens and its visor, in front of the housing."""
    front = -MAX_RADIUS - p.depth
    red, green, blue = np.asarray(color) * (1.0 if lit else UNLIT)
    material = "lamp" if lit else "glass"
    reach = 0.19 if p.kind.hoods else 0.07
    # A visor is a piece of pipe, open below, whose edge recedes from its top to its sides.
    turn = np.radians(np.linspace(-40, 220, 15))
    ahead = reach * (0.35 + 0.65 * np.clip(np.sin(turn), 0, 1))
    edge = np.column_stack([y + 1.1 * radius * np.cos(turn), z + 1.1 * radius * np.sin(turn)])
    rims = [in_plane(front, edge), np.column_stack([front - ahead, edge])]
    yield disc((front - 0.006, y, z), radius, (red, green, blue), material, sides=16)
    yield loft(np.array(rims), p.kind.front, "plain", closed=False, caps=False)


def _outline(
    y: float, z: float, half_width: float, half_height: float, corner: float
) -> np.ndarray:
    """Return points (y, z) of a rectangle with round corners."""
    parts = []
    for a, b, start in ((1, 1, 0), (-1, 1, 90), (-1, -1, 180), (1, -1, 270)):
        turn = np.radians(np.linspace(start, start + 90, 4))
        parts.append(np.column_stack([y + a * (half_width - corner) + corner * np.cos(turn),
                                      z + b * (half_height - corner) + corner * np.sin(turn)]))  # fmt: skip
    return np.concatenate(parts)


def _head(p: TrafficLightParams, head: Head) -> Parts:
    radius = p.lamp_radius * head.scale
    spacing = 2 * radius + 0.065 * head.scale
    half, width = len(head.lamps) * spacing / 2 + 0.03, radius + 0.045
    near = -MAX_RADIUS - p.depth
    outline = _outline(head.y, p.centre, width, half, 0.05 * head.scale)
    rings = [in_plane(x, outline) for x in (-MAX_RADIUS - 0.02, near)]
    yield loft(np.array(rings), p.kind.color, "plain")
    yield polygon(in_plane(near - 0.003, outline), p.kind.front, "plain")
    for i, color in enumerate(head.lamps):
        z = p.centre + ((len(head.lamps) - 1) / 2 - i) * spacing
        yield from _lamp(p, head.y, z, radius, color, lit=i == head.lit)
    if p.kind.board:
        edge, face = (0.035, p.kind.board, p.kind.edge), (0.045, p.kind.board - 0.03, SIGNAL_BLACK)
        for depth, margin, color in (edge, face):
            corner = 0.9 * (width + margin) if p.kind.round_board else 0.05
            board = _outline(head.y, p.centre, width + margin, half + margin, corner)
            x = -MAX_RADIUS - depth
            yield polygon(in_plane(x, board), color, "plain")
    for z in (p.centre - 0.7 * half, p.centre + 0.7 * half):
        bracket = (0.03, abs(head.y) + 0.06, 0.04)
        yield box(bracket, (-MAX_RADIUS - 0.01, head.y / 2, z), p.kind.color, "metal")


def traffic_light(p: TrafficLightParams) -> Asset:
    """Build the light."""
    parts = [part for head in p.heads for part in _head(p, head)]
    if len(p.heads) > 1:
        reach = max(h.y for h in p.heads) - min(h.y for h in p.heads)
        place = (-MAX_RADIUS - 0.03, 0, p.centre)
        parts.append(box((0.05, reach, 0.05), place, p.kind.color, "metal"))
    return merge(*parts)


FAMILY = Family(
    "traffic light", TrainId.TRAFFIC_LIGHT, tuple(_KINDS), sample_traffic_light, traffic_light,
    count=10, size=Size((0.3, 10), (0.3, 10)), tone=1.4, line=("pole", 0.25),
    facing="camera", front="back", stage=SIGN, mounted_on="signpost",
)  # fmt: skip
