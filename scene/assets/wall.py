"""Free-standing and retaining walls: near face in the plane y = 0, body towards y > 0."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, box, merge, solid, vary

KINDS: tuple[str, ...] = ("brick", "stone", "concrete", "plaster", "retaining", "piered")


class WallParams(NamedTuple):
    """A straight length of wall with a coping and piers."""

    length: float  # along x, m
    height: float  # without the coping, m
    thickness: float  # at the foot, m
    batter: float  # how far the near face leans back at the top, m
    coping: float  # height of the coping, m; 0 for none
    piers: tuple[float, ...]  # x of each pier, as a share of half the length
    plinth: float  # height of a darker foot, m; 0 for none
    color: Color
    coping_color: Color
    material: str


def sample_wall(rng: np.random.Generator, kind: str) -> WallParams:
    """Draw a wall of one of ``KINDS``."""
    bricks = ((0.25, 0.09, 0.06), (0.33, 0.25, 0.15), (0.20, 0.11, 0.08), (0.28, 0.14, 0.08))
    brick = vary(rng, bricks[rng.integers(len(bricks))], 0.2)
    pale = vary(rng, (0.32, 0.30, 0.27), 0.2)
    wall_ = WallParams(
        length=float(rng.uniform(3.2, 4.0)), height=float(rng.uniform(1.0, 2.3)),
        thickness=float(rng.uniform(0.22, 0.35)), batter=0.0,
        coping=float(rng.uniform(0.06, 0.12)), piers=(), plinth=0.0,
        color=brick, coping_color=pale, material="brick",
    )  # fmt: skip
    match kind:
        case "brick":
            return wall_
        case "stone":
            return wall_._replace(
                color=vary(rng, (0.27, 0.24, 0.19), 0.25), material="paving", batter=0.05,
                thickness=float(rng.uniform(0.3, 0.45)),
            )  # fmt: skip
        case "concrete":
            grey = vary(rng, (0.30, 0.29, 0.28), 0.2)
            return wall_._replace(
                color=grey, coping_color=grey, coping=0.0, material="concrete", piers=(-1.0, 1.0)
            )
        case "plaster":
            creams = ((0.55, 0.52, 0.46), (0.5, 0.42, 0.28), (0.45, 0.45, 0.44))
            return wall_._replace(
                color=vary(rng, creams[rng.integers(3)]), material="plaster", plinth=0.35,
                coping_color=brick if rng.random() < 0.5 else pale,
            )  # fmt: skip
        case "retaining":
            return wall_._replace(
                height=float(rng.uniform(1.8, 3.0)), thickness=0.5, batter=0.25,
                material=str(rng.choice(["concrete", "brick"])),
                color=brick if rng.random() < 0.4 else pale,
            )  # fmt: skip
        case "piered":
            return wall_._replace(height=float(rng.uniform(0.7, 1.4)), piers=(-0.95, 0.95))
    raise ValueError(f"unknown kind of wall {kind!r}; known: {', '.join(KINDS)}")


def _body(params: WallParams) -> Asset:
    """The wall proper; its near face leans back by ``batter``."""
    p = params
    body = box((p.length, p.thickness, p.height), (0, p.thickness / 2, 0), p.color, p.material)
    vertices = np.array(body.mesh.vertices)
    near_top = (vertices[:, 1] == 0) & (vertices[:, 2] > 0)
    vertices[near_top, 1] = p.batter
    return solid(vertices, body.mesh.faces, p.color, p.material)


def wall(params: WallParams) -> Asset:
    """Build the wall."""
    p = params
    middle = (p.thickness + p.batter) / 2
    parts = [_body(p)]
    if p.coping:
        size = (p.length, p.thickness - p.batter + 0.1, p.coping)
        parts.append(box(size, (0, middle, p.height), p.coping_color, "concrete"))
    if p.plinth:
        red, green, blue = np.asarray(p.color) * 0.5
        parts.append(box((p.length, 0.1, p.plinth), (0, 0.01, 0), (red, green, blue), p.material))
    for share in p.piers:
        size = (0.36, p.thickness + 0.2, p.height + p.coping + 0.12)
        x = share * (p.length - size[0]) / 2
        parts.append(box(size, (x, p.thickness / 2, 0), p.color, p.material))
    return merge(*parts)
