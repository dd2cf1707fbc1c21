"""What people on foot and people who ride share: a jointed figure, its clothes, its skin."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, Point, ellipsoid, loft, merge, repaint, solid
from scene.assets._palette import BLACK, GLASS, pick

SKINS: tuple[Color, ...] = (
    (0.55, 0.36, 0.26),
    (0.48, 0.29, 0.19),
    (0.36, 0.20, 0.12),
    (0.22, 0.115, 0.065),
    (0.10, 0.050, 0.030),
)
HAIRS: tuple[Color, ...] = (
    (0.012, 0.010, 0.009),
    (0.035, 0.020, 0.012),
    (0.085, 0.045, 0.022),
    (0.28, 0.18, 0.08),
    (0.30, 0.29, 0.28),
)
CLOTHES: tuple[Color, ...] = (
    (0.018, 0.018, 0.020),
    (0.020, 0.024, 0.045),
    (0.055, 0.057, 0.060),
    (0.030, 0.045, 0.100),
    (0.100, 0.075, 0.050),
    (0.050, 0.060, 0.035),
    (0.180, 0.025, 0.030),
    (0.160, 0.160, 0.160),
    (0.450, 0.440, 0.420),
    (0.060, 0.130, 0.240),
)
TROUSERS: tuple[Color, ...] = (
    (0.018, 0.018, 0.020),
    (0.022, 0.030, 0.060),
    (0.045, 0.075, 0.140),
    (0.060, 0.060, 0.062),
    (0.200, 0.160, 0.110),
)
SHOES: tuple[Color, ...] = ((0.015, 0.014, 0.013), (0.06, 0.035, 0.02), (0.45, 0.45, 0.44))

# Joint lengths as shares of the standing height.
THIGH, SHIN, ANKLE = 0.245, 0.246, 0.04
UPPER_ARM, FOREARM, HAND = 0.172, 0.150, 0.075
TORSO, NECK = 0.288, 0.118  # hip to shoulder; shoulder to the middle of the head


class Outfit(NamedTuple):
    """Colours of one person."""

    skin: Color = SKINS[0]
    hair: Color = HAIRS[1]
    top: Color = CLOTHES[1]
    legs: Color = TROUSERS[0]
    shoes: Color = SHOES[0]
    short_sleeves: bool = False
    long_hair: bool = False
    helmet: Color | None = None
    visor: bool = False  # a full-face helmet with a dark visor


class Pose(NamedTuple):
    """Where the joints are that the rest follows from; metres and radians."""

    hip: Point  # middle of the hips
    lean: float  # of the back, forward from upright
    hands: tuple[Point, Point]  # left and right wrist
    ankles: tuple[Point, Point]
    toes: tuple[float, float] = (0.0, 0.0)  # pitch of the shoes, down
    elbows: Point = (-1.0, 0.0, -0.3)  # the way they point, left arm
    look: float = 0.0  # lean of the neck


def sample_outfit(rng: np.random.Generator) -> Outfit:
    """Draw skin, hair and everyday clothes."""
    return Outfit(
        skin=pick(rng, SKINS),
        hair=pick(rng, HAIRS),
        top=pick(rng, CLOTHES, 0.3),
        legs=pick(rng, TROUSERS, 0.3),
        shoes=pick(rng, SHOES),
        short_sleeves=bool(rng.random() < 0.25),
        long_hair=bool(rng.random() < 0.4),
    )


def bend(
    start: np.ndarray, end: np.ndarray, upper: float, lower: float, towards: Point
) -> np.ndarray:
    """The joint between two bones of ``upper`` and ``lower`` m from ``start`` to ``end``.

    By the law of cosines, on the side that ``towards`` points to; straight if the end is too far.
    """
    reach = end - start
    distance = np.linalg.norm(reach)
    along = reach / distance
    near = np.clip((upper**2 - lower**2 + distance**2) / (2 * distance), -upper, upper)
    if distance >= upper + lower:
        return start + reach * upper / (upper + lower)
    side = np.asarray(towards, float)
    side = side - along * (side @ along)
    return start + near * along + np.sqrt(upper**2 - near**2) * side / np.linalg.norm(side)


def limb(
    joints: list[np.ndarray],
    radii: list[float],
    color: Color,
    material: str = "cloth",
    sides: int = 6,
) -> Asset:
    """A skin of circles around a line of joints; 2 faces a side for each bone, and both ends."""
    points = np.asarray(joints, float)
    bones = np.diff(points, axis=0)
    bones /= np.linalg.norm(bones, axis=1, keepdims=True)
    along = np.concatenate([bones[:1], bones[:-1] + bones[1:], bones[-1:]])
    angle = np.arange(sides) * 2 * np.pi / sides
    rings = []
    for point, radius, axis in zip(points, radii, along, strict=True):
        helper = (
            np.array([0, 1.0, 0]) if abs(axis[1]) < 0.8 * np.linalg.norm(axis) else np.eye(3)[0]
        )
        u = np.cross(axis, helper)
        u /= np.linalg.norm(u)
        v = np.cross(axis, u) / np.linalg.norm(axis)
        rings.append(point + radius * (np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v))
    return loft(rings, color, material)


def oval(
    centre: np.ndarray, forward: np.ndarray, deep: float, wide: float, sides: int = 8
) -> np.ndarray:
    """Points of an ellipse, ``deep`` m along ``forward`` and ``wide`` m to either side."""
    angle = (np.arange(sides) + 0.5) * 2 * np.pi / sides
    across = np.array([0, 1.0, 0])
    return centre + deep * np.cos(angle)[:, None] * forward + wide * np.sin(angle)[:, None] * across


def spine(pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors up along the back and forward out of the chest."""
    sin, cos = np.sin(pose.lean), np.cos(pose.lean)
    return np.array([sin, 0, cos]), np.array([cos, 0, -sin])


def figure(height: float, girth: float, head: float, outfit: Outfit, pose: Pose) -> Asset:
    """A person of ``height`` m in ``pose``.

    Args:
        height: standing height, m.
        girth: 1 for average, more for stout.
        head: size of the head, 1 for an adult.
        outfit: colours.
        pose: joints, m.
    """
    parts = [_torso(height, girth, outfit, pose), _head(height, head, outfit, pose)]
    up, _ = spine(pose)
    hip = np.array(pose.hip)
    shoulder = hip + TORSO * height * up
    thick = height * girth
    for k, side in enumerate((1, -1)):
        across = np.array([0, side, 0.0])
        top = hip + 0.05 * height * across
        ankle = np.array(pose.ankles[k])
        knee = bend(top, ankle, THIGH * height, SHIN * height, (1, 0.15 * side, 0.3))
        leg = [top, knee, ankle]
        parts.append(limb(leg, [0.047 * thick, 0.033 * thick, 0.024 * thick], outfit.legs))
        parts.append(_shoe(ankle, height, pose.toes[k], outfit.shoes))

        start = shoulder + 0.108 * height * girth**0.5 * across - 0.02 * height * up
        wrist = np.array(pose.hands[k])
        towards = (pose.elbows[0], pose.elbows[1] * side, pose.elbows[2])
        elbow = bend(start, wrist, UPPER_ARM * height, FOREARM * height, towards)
        hand = wrist + HAND * height * (wrist - elbow) / np.linalg.norm(wrist - elbow)
        radii = [0.034 * thick, 0.026 * thick, 0.018 * thick, 0.016 * thick]
        arm = limb([start, elbow, wrist, hand], radii, outfit.top)
        bare = np.arange(12 if outfit.short_sleeves else 24, len(arm.color))
        parts.append(repaint(arm, bare[bare < 36], outfit.skin, "skin"))
    return merge(*parts)


def _torso(height: float, girth: float, outfit: Outfit, pose: Pose) -> Asset:
    up, forward = spine(pose)
    stations = (  # along the back, half depth, half width
        (-0.2, 0.050, 0.070), (0.0, 0.062, 0.092), (0.36, 0.052, 0.080), (0.74, 0.066, 0.104),
        (0.96, 0.050, 0.112), (1.07, 0.030, 0.040),
    )  # fmt: skip
    rings = []
    for along, deep, wide in stations:
        direction = up if along > 0 else np.array([0, 0, 1.0])
        centre = np.array(pose.hip) + along * TORSO * height * direction
        rings.append(oval(centre, forward, deep * height * girth, wide * height * girth**0.5))
    torso = loft(rings, outfit.top, "cloth")
    return repaint(torso, np.arange(16), outfit.legs, "cloth")


def _head(height: float, size: float, outfit: Outfit, pose: Pose) -> Asset:
    """Head and neck; hair or a helmet covers the top and the back."""
    up, _ = spine(pose)
    neck = np.array([np.sin(pose.look), 0, np.cos(pose.look)])
    base = np.array(pose.hip) + TORSO * height * up
    centre = base + (NECK + 0.06 * (size - 1)) * height * neck
    radii = np.array([0.059, 0.049, 0.070]) * height * size
    if outfit.visor:
        radii = radii * 1.32
    skull = ellipsoid((0, 0, 0), (1, 1, 1), outfit.skin, "skin")
    x, _, z = skull.mesh.triangles_center.T
    ball = skull.mesh.vertices
    if outfit.helmet is not None and not outfit.visor:
        ball = ball * np.where(ball[:, 2:] > 0.2, 1.18, 1.0)  # a cycle helmet stands off the head
    skull = solid(centre + ball * radii, skull.mesh.faces, outfit.skin, "skin")
    if outfit.visor:
        skull = repaint(skull, np.arange(len(x)), outfit.helmet or BLACK, "paint")
        skull = repaint(skull, (x > 0.45) & (abs(z - 0.1) < 0.42), GLASS, "glass")
    else:
        low = -0.75 if outfit.long_hair else -0.3
        cover = (z > 0.45) | ((x < 0.1) & (z > low))
        skull = repaint(skull, cover, outfit.hair, "cloth")
        if outfit.helmet is not None:
            skull = repaint(skull, z > 0.3, outfit.helmet, "paint")
    throat = limb([base, centre - [0, 0, 0.3 * radii[2]]], [0.03 * height] * 2, outfit.skin, "skin")
    return merge(skull, throat)


def _shoe(ankle: np.ndarray, height: float, pitch: float, color: Color) -> Asset:
    """A shoe whose sole is ``ANKLE`` of the height below the ankle."""
    half = 0.026 * height
    sin, cos = np.sin(pitch), np.cos(pitch)
    rings = []
    for x, low, high in ((-0.035, -ANKLE, 0.012), (0.105, -ANKLE, -0.016)):
        loop = [(y, z) for y, z in ((-half, low), (half, low), (half, high), (-half, high))]
        rings.append(
            [
                ankle + [(x * cos + z * sin) * height, y, (z * cos - x * sin) * height]
                for y, z in loop
            ]
        )
    return loft(np.array(rings), color, "plain")
