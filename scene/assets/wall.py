"""Free-standing and retaining walls, their near face in the plane y = 0, their body in y > 0."""

from __future__ import annotations

import numpy as np

from scene.assets.family import FRONTAGE, Family, Size
from scene.assets.parts.draw import SEED, between, near, sampler, times
from scene.assets.parts.palette import (
    BRICK,
    CREAM_RENDER,
    GALVANISED,
    PALE_STONE,
    PANEL_CONCRETE,
    RUBBLE,
    YELLOW_BRICK,
    darker,
)
from scene.assets.parts.wall_faces import FACES, RELIEF, TOPS, WallParams
from scene.classes import TrainId
from scene.mesh.asset import Asset, Parts, merge, rotate, solid, translate
from scene.mesh.solids import box, extrude, turned

_BASE = WallParams(3.6, 1.6, 0.28, BRICK, "brick", PALE_STONE, 0.08)
_KINDS: dict[str, WallParams] = {
    "brick": _BASE,
    "rubble stone": _BASE._replace(color=RUBBLE, material="concrete", second_color=(0.12, 0.11, 0.10),
                                   thickness=0.42, height=1.3, coping=0.0, face="blocks"),
    "concrete panels": _BASE._replace(color=PANEL_CONCRETE, material="concrete", coping=0.0, height=2.0,
                                      piers=(-1.0, 0.0, 1.0), second_color=PANEL_CONCRETE),
    "rendered": _BASE._replace(color=CREAM_RENDER, material="plaster", plinth=0.35, second_color=BRICK,
                               height=1.9, ridge=True, coping=0.16),
    "retaining": _BASE._replace(height=2.4, thickness=0.5, batter=0.22, color=PALE_STONE, face="weep holes",
                                material="concrete", second_color=(0.05, 0.05, 0.05)),
    "piered": _BASE._replace(height=0.9, piers=(-0.95, 0.95), ball=True, color=YELLOW_BRICK),
    "railing top": _BASE._replace(height=0.75, top="railings", second_color=RUBBLE, piers=(-1.0, 1.0)),
    "graffiti": _BASE._replace(height=2.3, color=PANEL_CONCRETE, material="concrete", coping=0.0,
                               face="graffiti"),
    "noise barrier": _BASE._replace(height=2.7, thickness=0.2, color=(0.05, 0.10, 0.065), coping=0.0,
                                    material="metal", face="ribs", second_color=GALVANISED),
    "gabions": _BASE._replace(height=1.5, thickness=0.55, color=(0.19, 0.19, 0.185), coping=0.0,
                              material="concrete", face="stones", second_color=(0.06, 0.06, 0.06)),
    "banded brick": _BASE._replace(height=2.1, color=YELLOW_BRICK, face="bands",
                                   second_color=(0.15, 0.05, 0.04), coping=0.12, ridge=True),
    "balustrade": _BASE._replace(height=0.4, color=(0.42, 0.39, 0.33), material="plaster",
                                 second_color=(0.42, 0.39, 0.33), top="balusters", piers=(-1.0, 1.0)),
    "stepped": _BASE._replace(height=1.9, steps=3, color=(0.20, 0.10, 0.075), second_color=PANEL_CONCRETE),
    "sleepers": _BASE._replace(height=1.2, color=(0.085, 0.06, 0.04), material="wood", coping=0.0,
                               face="beams", second_color=(0.03, 0.022, 0.017), thickness=0.3),
    "ivy": _BASE._replace(height=2.0, face="ivy", second_color=(0.022, 0.05, 0.018), coping=0.0,
                          top="mound"),
    "crash barrier": _BASE._replace(height=0.85, thickness=0.55, color=(0.36, 0.355, 0.34),
                                    material="concrete", coping=0.0, face="profile",
                                    second_color=(0.5, 0.03, 0.02)),
}  # fmt: skip


def _leaning(p: WallParams, x: float, length: float, height: float) -> Asset:
    """Build a box whose near face leans back by ``batter``, or is set back behind the stones on it."""
    has_stones = p.face in ("blocks", "stones", "beams")
    front, color = (RELIEF, p.second_color) if has_stones else (0.0, p.color)
    depth = p.thickness - front
    body = box((length, depth, height), (x, front + depth / 2, 0), color, p.material)
    vertices = np.array(body.mesh.vertices)
    vertices[(vertices[:, 1] < front + 1e-9) & (vertices[:, 2] > 0), 1] += p.batter
    return solid(vertices, body.mesh.faces, color, p.material)


def _coping(p: WallParams, x: float, length: float, height: float) -> Asset:
    """Build a flat coping, or one with two slopes like a roof."""
    width, middle = p.thickness - p.batter + 0.1, (p.thickness + p.batter) / 2
    if not p.ridge:
        return box((length, width, p.coping), (x, middle, height), p.second_color, "concrete")
    outline = [(-width / 2, 0.0), (width / 2, 0.0), (width / 2, 0.04), (0.0, p.coping),
               (-width / 2, 0.04)]  # fmt: skip
    roof = rotate(extrude(outline, length, p.second_color, "concrete"), np.pi / 2, (0, 0, 1))
    return translate(roof, (x, middle, height))


def _piers(p: WallParams) -> Parts:
    high = p.height + p.coping + (0.62 if p.top in TOPS else 0.12)
    for share in p.piers:
        x = share * (p.length - 0.36) / 2
        y = p.thickness / 2
        yield box((0.36, p.thickness + 0.2, high), (x, y, 0), p.color, p.material)
        yield box((0.46, p.thickness + 0.29, 0.08), (x, y, high), p.second_color, "concrete")
        if p.ball:
            turn = np.linspace(-1.2, np.pi / 2, 6)
            globe = [(high + 0.21 + 0.15 * np.sin(a), max(0.15 * np.cos(a), 0.004)) for a in turn]
            yield turned(globe, p.second_color, "concrete", at=(x, y))


def wall(p: WallParams) -> Asset:
    """Build the wall."""
    rng = np.random.default_rng(p.seed)
    parts = [*_body(p)]
    if p.face:
        parts += FACES[p.face](p, rng)
    if p.top:
        parts += TOPS[p.top](p, rng)
    return merge(*parts, *_piers(p))


def _body(p: WallParams) -> Parts:
    """Build the wall itself, in steps with copings or with the profile of a crash barrier, and its plinth."""
    if p.face == "profile":
        t, h = p.thickness, p.height
        rear = [(t, 0.0), (t, 0.09), (0.7 * t, 0.35 * h), (0.62 * t, h)]
        outline = [(0.0, 0.0), *rear, (0.38 * t, h), (0.3 * t, 0.35 * h), (0.0, 0.09)]
        yield rotate(extrude(outline, p.length, p.color, p.material), np.pi / 2, (0, 0, 1))
    else:
        step = p.length / p.steps
        for k in range(p.steps):
            x, high = -p.length / 2 + (k + 0.5) * step, p.height * (1 - 0.22 * k)
            yield _leaning(p, x, step, high)
            if p.coping:
                yield _coping(p, x, step, high)
    if p.plinth:
        yield box((p.length, 0.1, p.plinth), (0, 0.01, 0), darker(p.color, 0.4), p.material)


FAMILY = Family(
    "wall", TrainId.WALL, tuple(_KINDS),
    sampler(_KINDS, length=between(3.3, 3.9), height=times(0.9, 1.1), thickness=times(0.95, 1.05),
            color=near(0.22), second_color=near(0.2), seed=SEED),
    wall,
    count=16, size=Size((0.5, 40), (0.3, 8)), tone=0.66, line=("fence", 0.4),
    facing="road", front="right", stage=FRONTAGE, in_rows=True,
)  # fmt: skip
