"""Builds heads: faces, hairdos, hats, hoods and helmets."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from scene.assets.parts.human import NECK, TORSO, Body, Outfit, Pose, limb, skin, spine
from scene.assets.parts.palette import GLASS, darker
from scene.assets.parts.skin import sheet
from scene.mesh.asset import Asset, Color, Parts, merge, repaint, reshaped, solid, translate
from scene.mesh.mesh import Mesh, cross, frozen
from scene.mesh.solids import ellipsoid

SIZE = np.array([0.055, 0.045, 0.066])
"""Half length, width and height of an adult's head, as shares of the standing height."""
SIDES = 16
# From chin to crown, in units of ``SIZE``: height, reach to the front and to the back, half width.
_SKULL = np.array([
    (-1.00, 0.66, 0.00, 0.26), (-0.86, 0.92, 0.30, 0.56), (-0.58, 0.97, 0.74, 0.82),
    (-0.28, 0.99, 0.92, 0.94), (0.02, 1.00, 1.03, 0.98), (0.32, 0.98, 1.07, 1.00),
    (0.58, 0.87, 1.00, 0.93), (0.80, 0.64, 0.76, 0.72), (0.95, 0.33, 0.40, 0.40),
    (1.00, 0.08, 0.08, 0.10),
])  # fmt: skip
_ANGLE = (np.arange(SIDES) + 0.5) * 2 * np.pi / SIDES
_FROM_AHEAD = np.degrees(np.abs(np.angle(np.exp(1j * _ANGLE))))
"""Angle of each corner of a ring from straight ahead, degrees in [0, 180]."""
_LEVEL = np.repeat((_SKULL[:-1, 0] + _SKULL[1:, 0]) / 2, SIDES).reshape(-1, SIDES)
_AROUND = np.degrees(np.abs(np.angle(np.exp(1j * (_ANGLE + np.pi / SIDES)))))[None, :]
"""Height of each face, and its angle from straight ahead, degrees in [0, 180]."""

Edge = tuple[tuple[float, float], ...]
"""Lower edge of hair or a hat: pairs of degrees from straight ahead and height."""


class Shell(NamedTuple):
    """Hair or a hat: the part of an enlarged skull above an edge."""

    edge: Edge
    grow: float
    volume: float = 0.0  # additional height of the top
    material: str = "cloth"
    brim: tuple[float, float] | None = None  # its reach ahead and to the sides
    peak: bool = False  # the brim is ahead only


_BROW = ((0, 0.30), (180, 0.10))
_SHELLS: dict[str, Shell] = {
    "beanie": Shell(((0, 0.36), (90, 0.05), (180, -0.15)), 1.12, 0.22),
    "cap": Shell(_BROW, 1.10, 0.08, brim=(1.75, 0.95), peak=True),
    "brim": Shell(_BROW, 1.12, 0.25, brim=(1.75, 1.6)),
    "hood": Shell(((0, 0.66), (40, 0.60), (60, 0.0), (75, -1.0)), 1.26, 0.08),
    "headscarf": Shell(((0, 0.55), (36, 0.50), (52, 0.0), (65, -1.0)), 1.12, 0.05),
    "hard hat": Shell(_BROW, 1.20, 0.12, "paint", (1.6, 1.3)),
    "cycle helmet": Shell(((0, 0.45), (180, 0.15)), 1.25, 0.20, "paint"),
    "open helmet": Shell(((0, 0.50), (45, 0.45), (65, 0.0), (75, -0.7)), 1.30, 0.05, "paint"),
}
_EARS_COVERED = ("hood", "headscarf", "open helmet")
_NAPE = {"short": -0.45, "bob": -0.9, "long": -0.9, "thick": -0.6, "curly": -0.7}
_FULL = {"short": (1.05, 0.02), "thick": (1.10, 0.08), "curly": (1.24, 0.10), "bob": (1.12, 0.05)}


@lru_cache
def _rings(grow: float = 1.0, volume: float = 0.0, edge: Edge = ((0, -1.0),)) -> np.ndarray:
    """Return the skull's rings f64[levels, sides, 3] above an edge, enlarged and ``volume`` higher."""
    z = np.maximum(_SKULL[:, :1], np.interp(_FROM_AHEAD, *np.transpose(edge)))
    front, back, half_width = (np.interp(z, _SKULL[:, 0], reach) for reach in _SKULL.T[1:])
    cos, sin = np.cos(_ANGLE), np.sin(_ANGLE)
    up = z + volume * np.maximum(z, 0)
    return frozen(grow * np.stack([np.where(cos > 0, front, back) * cos, half_width * sin, up], -1))


def _shell(shell: Shell, color: Color, stripes: Color | None = None) -> Asset:
    """Build hair or a hat in units of the head; ``stripes`` run from its edge to the crown."""
    rings = _rings(shell.grow, shell.volume, shell.edge)
    skull_cap = skin(rings, color, shell.material)
    sides = np.arange(2 * SIDES * (len(rings) - 1)) // 2 % SIDES
    if stripes is not None:
        skull_cap = repaint(skull_cap, np.flatnonzero(sides % 4 == 1), stripes, "plain")
    # Rings below the edge coincide with it: drop the faces between them, and the bottom.
    corners = skull_cap.mesh.vertices[skull_cap.mesh.faces]
    flat = np.linalg.norm(
        cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    keep = flat > 1e-9
    keep[len(sides) : len(sides) + SIDES - 2] = False
    mesh = Mesh(skull_cap.mesh.vertices, skull_cap.mesh.faces[keep])
    return Asset(mesh, skull_cap.color[keep], skull_cap.material[keep])


def _hair(outfit: Outfit) -> Parts:
    """Build hair in units of the head."""
    hairdo, color = outfit.hairdo, outfit.hair
    if hairdo == "bald":
        return
    # The edge runs down to a sideburn, over the ear, and to the nape.
    nape = _NAPE.get(hairdo, -0.5)
    edge = ((0, 0.5), (45, 0.42), (68, 0.2), (80, -0.2), (100, 0.0), (122, nape))
    grow, volume = (1.06, 0.02) if outfit.hat else _FULL.get(hairdo, (1.07, 0.03))
    yield _shell(Shell(edge, grow, volume), color)
    if hairdo in ("bob", "long"):
        low = -1.05 if hairdo == "bob" else -1.95
        levels = np.linspace(0.3, low, 5)
        turn = np.radians(np.linspace(72, 288, 11))
        spread = np.array([1.10, 1.18, 1.20, 1.14, 0.98])
        curtain = np.array([
            np.column_stack([1.02 * s * np.cos(turn) - 0.04 * k, s * np.sin(turn),
                             np.full(len(turn), z)])
            for k, (s, z) in enumerate(zip(spread, levels, strict=True))
        ])  # fmt: skip
        yield sheet(curtain, color, "cloth")
    if hairdo == "ponytail":
        tail = [(-1.0, 0, 0.45), (-1.5, 0, 0.35), (-1.62, 0, -0.5), (-1.45, 0, -1.5)]
        yield limb(np.array(tail), [0.2, 0.3, 0.34, 0.08], color, "cloth", 6)
    if hairdo == "bun":
        yield ellipsoid((-0.85, 0, 0.85), (0.45, 0.5, 0.42), color, "cloth")


def _brim(reach: float, width: float, z: float, ahead: bool, color: Color, material: str) -> Asset:
    """Build a flat brim all around, or a peak only ahead."""
    turn = np.linspace(-1.3, 1.3, 9) if ahead else np.arange(17) * 2 * np.pi / 16
    inner = np.column_stack([0.95 * np.cos(turn), 0.95 * np.sin(turn), np.full(len(turn), z)])
    outer = np.column_stack(
        [reach * np.cos(turn), width * np.sin(turn), np.full(len(turn), z - 0.08)]
    )
    i = np.arange(len(turn) - 1)
    n = len(turn)
    faces = np.concatenate([np.stack([i, i + 1, i + n + 1], 1), np.stack([i, i + n + 1, i + n], 1)])
    return solid(np.concatenate([inner, outer]), faces, color, material)


def _hat(outfit: Outfit) -> Parts:
    """Build a hat in units of the head."""
    hat, color = outfit.hat, outfit.hat_color
    if hat == "full helmet":
        rings = skin(_rings(1.36, 0.02), color, "paint")
        visor = np.repeat(((_AROUND < 68) & (np.abs(_LEVEL - 0.1) < 0.42)).ravel(), 2)
        faces = np.concatenate([visor, np.zeros(2 * (SIDES - 2), bool)])
        yield repaint(rings, faces, GLASS, "glass")
        return
    if not hat:
        return
    shell = _SHELLS[hat]
    yield _shell(shell, color, darker(color, 0.25) if hat == "cycle helmet" else None)
    if shell.brim is not None:
        yield _brim(*shell.brim, 0.43, shell.peak, color, shell.material)
    if hat == "headscarf":
        drape = np.array([(0.05, 0, -0.7), (-0.05, 0, -1.3), (-0.05, 0, -1.9)])
        yield limb(drape, [0.85, 1.05, 1.65], color, "cloth", 10)


def _face(outfit: Outfit) -> Parts:
    """Build the bare head: skull, nose, ears, brows and mouth, in units of the head."""
    skull = skin(_rings(), outfit.skin, "skin")
    if outfit.beard:
        jaw = np.repeat(((_LEVEL < -0.35) & (_AROUND < 95)).ravel(), 2)
        mask = np.concatenate([jaw, np.ones(SIDES - 2, bool), np.zeros(SIDES - 2, bool)])
        skull = repaint(skull, mask, outfit.hair, "cloth")
    yield skull
    nose = np.array([(0.98, 0, 0.18), (1.26, 0, -0.22), (0.96, 0.2, -0.3), (0.96, -0.2, -0.3)])
    yield solid(nose, np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2]]), outfit.skin, "skin")

    def patch(y: float, z: float, half: float, high: float, color: Color) -> Asset:
        """Build a small mark on the front of the face."""
        sides = np.array([y - half, y, y + half])
        front, half_width = (np.interp(z, _SKULL[:, 0], _SKULL[:, k]) for k in (1, 3))
        x = 0.04 + front * np.sqrt(1 - (sides / half_width) ** 2)
        low, top = (np.column_stack([x, sides, np.full(3, height)]) for height in (z, z + high))
        return solid(np.concatenate([low, top]), np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]]),
                     color, "skin")  # fmt: skip

    for side in (0.42, -0.42):
        yield patch(side, 0.02, 0.2, 0.12, darker(outfit.skin, 0.28))
        yield patch(side, 0.2, 0.24, 0.07, darker(outfit.hair, 0.9))
        if outfit.hat not in _EARS_COVERED:
            ear = (-0.1, 2.4 * side, -0.05), (0.2, 0.1, 0.27)
            yield ellipsoid(*ear, outfit.skin, "skin", subdivisions=0)
    red, green, blue = outfit.skin
    yield patch(0.0, -0.6, 0.3, 0.09, (0.7 * red, 0.4 * green, 0.4 * blue))


def head(body: Body, outfit: Outfit, pose: Pose) -> Asset:
    """Build the neck and head of a person in ``pose``, m."""
    h, (up, forward) = body.height, spine(pose)
    neck = np.array([np.sin(pose.look), 0, np.cos(pose.look)])
    base = np.array(pose.hip) + h * (TORSO * 1.04 * up - 0.006 * forward)
    centre = base + (NECK - 0.012 + 0.05 * (body.head - 1)) * h * neck + 0.008 * h * neck[::-1]
    face = [] if outfit.hat == "full helmet" else _face(outfit)
    hair = [] if outfit.hat in ("hood", "headscarf", "full helmet") else _hair(outfit)
    merged = merge(*face, *hair, *_hat(outfit))
    tilt, turn = 0.7 * pose.look, pose.turn
    pitch = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    yaw = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    scaled = merged.mesh.vertices * SIZE * h * body.head @ (pitch @ yaw).T
    placed = translate(reshaped(merged, scaled), centre)
    radius = 0.031 * h * body.girth**0.4
    throat = limb([base - 0.01 * h * up, centre - 0.3 * SIZE[2] * h * neck],
                  [1.15 * radius, 0.95 * radius], outfit.skin, "skin", 10)  # fmt: skip
    if outfit.collar is None:
        return merge(placed, throat)
    points = np.array([base - 0.02 * h * up, base + 0.02 * h * neck, base + 0.055 * h * neck])
    scarf = limb(points, [0.052 * h, 0.056 * h, 0.046 * h], outfit.collar, "cloth", 10)
    return merge(placed, throat, scarf)
