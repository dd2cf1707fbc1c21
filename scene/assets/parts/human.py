"""What people on foot and riders share: sizes, joints, outfits, and skins around bones.

The body is built in ``parts/body.py``, the head in ``parts/head.py``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.parts.palette import BLACK
from scene.mesh.asset import Asset, Color, Point, repaint, solid
from scene.mesh.mesh import circle, cross
from scene.mesh.solids import loft_faces

# Joint lengths as shares of the standing height.
THIGH, SHIN, ANKLE = 0.245, 0.246, 0.04
UPPER_ARM, FOREARM, HAND = 0.172, 0.150, 0.095
TORSO, NECK = 0.288, 0.118  # hip to shoulder; shoulder to the middle of the head
HIP_HALF, SHOULDER_HALF = 0.048, 0.106  # from the middle to a joint


class Outfit(NamedTuple):
    """The look of one person: skin, hair and clothes."""

    skin: Color
    hair: Color
    top: Color
    legs: Color
    shoes: Color
    sole: Color = BLACK
    accent: Color | None = None  # lower half of the top, or its stripes
    stripes: bool = False  # of ``accent`` around the top
    shirt: Color | None = None  # visible in the open front of a jacket
    sleeves: float = 1.0  # share of the arm that is covered
    trousers: float = 1.0  # share of the leg that is covered
    width: float = 1.0  # of the trousers' legs, relative to slim ones
    padding: float = 0.0  # thickness of the top, as a share of the height
    quilted: bool = False
    hem: float = 0.0  # share of the leg that a coat or skirt covers
    hem_color: Color | None = None  # of a skirt; None for the colour of the top
    flare: float = 1.0
    collar: Color | None = None  # a scarf or a raised collar
    bands: Color | None = None  # reflecting bands of a work vest
    hairdo: str = "short"  # see ``parts/head.py``
    beard: bool = False
    hat: str = ""  # see ``parts/head.py``
    hat_color: Color = BLACK


class Body(NamedTuple):
    """Sizes of one person."""

    height: float  # standing, m
    girth: float = 1.0  # 1 average, more is stouter
    head: float = 1.0  # 1 for adults, more for children
    curves: float = 0.0  # 0 broad shoulders .. 1 broad hips
    belly: float = 0.0  # depth, as a share of the height


class Pose(NamedTuple):
    """The joints that determine a pose; metres and radians."""

    hip: Point  # middle of the hips
    lean: float  # of the back, forward from upright
    hands: tuple[Point, Point]  # left and right wrist
    ankles: tuple[Point, Point]
    toes: tuple[float, float] = (0.0, 0.0)  # pitch of the shoes, down
    elbows: tuple[Point, Point] = ((-1.0, 0.1, -0.3), (-1.0, 0.1, -0.3))  # y is outwards
    look: float = 0.0  # lean of the neck
    turn: float = 0.0  # of the head to the left
    twist: float = 0.0  # of the shoulders to the left


def bend(
    start: np.ndarray, end: np.ndarray, upper: float, lower: float, towards: Point
) -> np.ndarray:
    """Return the joint between two bones of ``upper`` and ``lower`` m from ``start`` to ``end``.

    The law of cosines gives it, on the side that ``towards`` points to; it is straight if the end is too far.
    """
    reach = end - start
    distance = np.sqrt(reach.dot(reach))
    along = reach / distance
    near = np.clip((upper**2 - lower**2 + distance**2) / (2 * distance), -upper, upper)
    if distance >= upper + lower:
        return start + reach * upper / (upper + lower)
    side = np.asarray(towards, float)
    side = side - along * (side @ along)
    return start + near * along + np.sqrt(upper**2 - near**2) * side / np.sqrt(side.dot(side))


def skin(rings: np.ndarray, color: Color, material: str = "cloth") -> Asset:
    """Build a closed skin over rings [n, sides, 3]; faces are [band, side, 2], then both ends."""
    count, sides = rings.shape[:2]
    return solid(rings.reshape(-1, 3), loft_faces(count, sides), color, material)


def paint_bands(
    asset: Asset, sides: int, low: int, high: int, color: Color, material: str = "cloth"
) -> Asset:
    """Paint bands ``low`` to ``high`` of a skin in another colour."""
    return repaint(asset, np.arange(2 * sides * low, 2 * sides * high), color, material)


def circles(points: np.ndarray, radii: np.ndarray, sides: int = 8) -> np.ndarray:
    """Return rings f64[n, sides, 3] of ``radii`` around a line of ``points``, square to it."""
    bones = np.diff(points, axis=0)
    bones /= _lengths(bones)
    along = np.concatenate([bones[:1], bones[:-1] + bones[1:], bones[-1:]])
    along /= _lengths(along)
    mean = np.abs(along.sum(0))
    u = cross(along, _X if mean[1] > max(mean[0], mean[2]) else _Y)
    u /= _lengths(u)
    cos, sin = circle(sides)[..., None]
    ring = cos * u[:, None] + sin * cross(along, u)[:, None]
    return points[:, None] + radii[:, None, None] * ring


_X, _Y = np.eye(3)[:2]


def _lengths(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths f64[n, 1] of vectors f64[n, 3], none below a nanometre."""
    return np.maximum(np.sqrt((vectors * vectors).sum(axis=1, keepdims=True)), 1e-9)


def limb(
    joints: list[np.ndarray] | np.ndarray,
    radii: list[float],
    color: Color,
    material: str = "cloth",
    sides: int = 8,
) -> Asset:
    """Build a skin of circles around a line of joints."""
    return skin(circles(np.asarray(joints, float), np.asarray(radii), sides), color, material)


def spine(pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Return unit vectors up along the back and forward out of the chest."""
    sin, cos = np.sin(pose.lean), np.cos(pose.lean)
    return np.array([sin, 0, cos]), np.array([cos, 0, -sin])


def shoulders(body: Body, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Return the left and the right shoulder joint, m."""
    up, forward = spine(pose)
    middle = np.array(pose.hip) + (TORSO - 0.034) * body.height * up
    across = np.cos(pose.twist) * np.array([0, 1.0, 0]) - np.sin(pose.twist) * forward
    half = SHOULDER_HALF * body.height * (1 - 0.1 * body.curves) * body.girth**0.4
    return middle + half * across, middle - half * across
