"""What people carry or push: bags, cases, umbrellas, sticks, prams; in metres, placed around a pose.

In Cityscapes, carried objects are part of the person; those that stand or roll on the ground have no class.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from common.errors import hint
from scene.assets.parts.human import Body, Pose, limb, shoulders, skin, spine
from scene.assets.parts.palette import BLACK, STEEL, darker
from scene.mesh.asset import Asset, Color, Point, ignore, merge, rotate, solid, translate
from scene.mesh.solids import block, box, ring

CARRIED: tuple[str, ...] = (
    "backpack", "shopping", "handbag", "shoulder bag", "briefcase", "suitcase", "umbrella",
    "stick", "pram", "buggy", "box", "cup",
)  # fmt: skip
"""Names for ``carried``."""

PRAM_HANDLE = (0.42, 0.98)
"""Where a pram is held: distance ahead of the hips, and height, m."""


def _pillow(size: Point, base: Point, color: Color, bulge: float = 0.75) -> Asset:
    """Build a soft box of ``size`` above ``base``, narrower at top and bottom than in the middle."""
    turn = (np.arange(12) + 0.5) * 2 * np.pi / 12
    cos, sin = (np.sign(f) * np.abs(f) ** 0.6 for f in (np.cos(turn), np.sin(turn)))
    rings = [
        np.column_stack([k * size[0] / 2 * cos, k * size[1] / 2 * sin, np.full(12, z * size[2])])
        for k, z in ((bulge, 0.0), (1.0, 0.15), (1.0, 0.7), (bulge, 0.93), (0.5 * bulge, 1.0))
    ]
    return skin(np.array(rings) + np.array(base), color)


def backpack(body: Body, pose: Pose, color: Color, size: float = 1.0) -> Asset:
    """Build a bag on the back with two straps over the shoulders."""
    h, (up, forward) = body.height, spine(pose)
    depth = 0.066 * h * body.girth**0.7
    base, before = (
        (-depth - 0.045 * h * size, 0, 0.055 * h),
        (-depth - 0.10 * h * size, 0, 0.07 * h),
    )
    bag = _pillow((0.10 * h * size, 0.165 * h, 0.25 * h * size), base, color)
    pocket = _pillow((0.05 * h * size, 0.12 * h, 0.10 * h), before, darker(color, 0.7))
    parts = [translate(rotate(merge(bag, pocket), pose.lean, (0, 1, 0)), pose.hip)]
    hip = np.array(pose.hip)
    strap = ((0.27, -0.06), (0.315, -0.01), (0.27, 0.065), (0.20, 0.08), (0.13, 0.065))
    for side in (0.055, -0.055):
        y = np.array([0, side * h, 0])
        path = [hip + y * 1.2 + a * h * up + b * h * forward for a, b in strap]
        parts.append(limb(np.array(path), [0.016 * h] * 5, darker(color, 0.5), "cloth", 4))
    return merge(*parts)


def _shopping(hand: np.ndarray, h: float, color: Color) -> Asset:
    x, y, z = hand
    top = z - 0.15 * h
    low, high = (x - 0.085 * h, y - 0.035 * h, top - 0.19 * h), (x + 0.085 * h, y + 0.035 * h, top)
    parts = [block(low, high, color, "paint")]
    for d in (0.03 * h, -0.03 * h):
        loop = [(x - 0.05 * h, y + d, top), (x, y, z - 0.06 * h), (x + 0.05 * h, y + d, top)]
        parts.append(limb(np.array(loop), [0.006] * 3, BLACK, "cloth", 3))
    return merge(*parts)


def _shoulder_bag(body: Body, pose: Pose, color: Color, across: bool) -> Asset:
    """Build a bag at the right hip, its strap over the right shoulder or across the chest."""
    h, hip = body.height, np.array(pose.hip)
    left, right = shoulders(body, pose)
    side = -0.135 * h * body.girth**0.5
    base = (hip[0] - 0.01, hip[1] + side, hip[2] - 0.05 * h)
    parts = [_pillow((0.19 * h, 0.06 * h, 0.14 * h), base, color)]
    over = (left if across else right) + np.array([0, -0.03 * h if across else 0.02 * h, 0.045 * h])
    chest = (over + hip) / 2
    for ahead in (0.085, -0.085):
        middle = chest + np.array([ahead * h, 0.02 * h if across else 0.5 * side, 0.05 * h])
        low = np.array([hip[0] + 0.5 * ahead * h, hip[1] + side, hip[2] + 0.08 * h])
        path = np.array([over, middle, low])
        parts.append(limb(path, [0.009 * h] * 3, darker(color, 0.6), "cloth", 4))
    return merge(*parts)


def _suitcase(body: Body, pose: Pose, color: Color) -> Asset:
    """Build a case on wheels pulled behind the right hand."""
    hand, h = np.array(pose.hands[1]), body.height
    foot = np.array([hand[0] - 0.55, hand[1] - 0.04, 0.083])
    case = merge(
        _pillow((0.24, 0.40, 0.60), (0, 0, 0.03), color, 0.95),
        box((0.02, 0.34, 0.02), (-0.12, 0, 0.2), darker(color, 0.5)),
        box((0.02, 0.34, 0.02), (-0.12, 0, 0.42), darker(color, 0.5)),
        *(box((0.02, 0.02, 0.42), (0.06, y, 0.6), STEEL, "metal") for y in (0.09, -0.09)),
        box((0.03, 0.2, 0.03), (0.06, 0, 1.0), BLACK),
        *(ring((0.06, y, 0.0), 0.035, 0.03, BLACK, sides=8) for y in (0.17, -0.17)),
    )
    reach = hand - foot
    tilt = float(np.arctan2(reach[0], max(reach[2] + 0.02 * h, 0.1)))
    return translate(rotate(case, tilt, (0, 1, 0)), foot)


def _umbrella(hand: np.ndarray, body: Body, color: Color, second_color: Color) -> Asset:
    """Build an open umbrella over the head, its panels in two alternating colours."""
    x, y, z = hand
    top = max(1.13 * body.height, z + 0.55)
    sides = 8
    turn = np.arange(2 * sides) * np.pi / sides
    droop = np.where(np.arange(2 * sides) % 2, 0.94, 1.0)
    centre = np.array([x - 0.06, 0.5 * y, top])
    rings = [
        centre + np.column_stack([r * droop * np.cos(turn), r * droop * np.sin(turn),
                                  np.full(2 * sides, drop)])
        for r, drop in ((0.02, 0.17), (0.2, 0.14), (0.36, 0.05), (0.48, -0.06))
    ]  # fmt: skip
    canopy = skin(np.array(rings), color)
    count = 3 * 4 * sides
    colors = canopy.color[:count].copy()
    colors[(np.arange(count) // 4) % 2 == 1] = second_color
    canopy = solid(canopy.mesh.vertices, canopy.mesh.faces[:count], color, "cloth")
    ends = np.array([hand + [0, 0, -0.12], centre + [0, 0, 0.22]])
    return merge(canopy._replace(color=colors), limb(ends, [0.011, 0.008], BLACK, "metal", 5))


def _stick(hand: np.ndarray, h: float, color: Color) -> Asset:
    x, y, z = hand + np.array([0.035, 0, -0.02])
    points = np.array([(x - 0.09, y, z + 0.03), (x, y, z + 0.035), (x + 0.12, y * 1.05, 0.0)])
    return limb(points, [0.012, 0.013, 0.011], color, "wood", 6)


def _pram(pose: Pose, color: Color, buggy: bool) -> Asset:
    """Build a pram with a folding hood, or a buggy with a child in it, held by its handle."""
    ahead, high = PRAM_HANDLE
    handle = pose.hip[0] + ahead
    x, radius = handle + 0.42, 0.11 if buggy else 0.17
    turn = np.linspace(0, np.pi, 9)
    parts, hub = [], radius + 0.018
    for wheel_x, y in product((x - 0.26, x + 0.30), (0.25, -0.25)):
        parts.append(ring((wheel_x, y, hub), radius, 0.035, BLACK, sides=14))
        parts.append(box((2 * radius, 0.012, 0.012), (wheel_x, y, hub - 0.006), STEEL, "metal"))
        parts.append(box((0.012, 0.012, 2 * radius), (wheel_x, y, hub - radius), STEEL, "metal"))
    for y in (0.23, -0.23):
        for path in (
            [(x + 0.30, y, radius), (x - 0.12, y, 0.62), (handle, y, high)],
            [(x - 0.26, y, radius), (x + 0.06, y, 0.58)],
        ):
            parts.append(limb(np.array(path), [0.014] * len(path), STEEL, "metal", 5))
    grip = np.array([(handle, -0.24, high), (handle, 0.24, high)])
    parts.append(limb(grip, [0.018] * 2, BLACK, "rubber", 6))
    low, length, back = (0.36, 0.52, 0.30) if buggy else (0.50, 0.82, 0.24)
    tub = [
        np.column_stack([x + length / 2 * k * np.cos(2 * turn[:-1]), 0.2 * k * np.sin(2 * turn[:-1]),
                         np.full(8, low + z)])
        for k, z in ((0.72, 0.0), (0.95, 0.10), (1.0, back))
    ]  # fmt: skip
    parts.append(skin(np.array(tub), color))
    hood = [
        np.column_stack([x - 0.34 * length + 0.32 * np.cos(a) * np.ones(9), 0.2 * np.cos(turn),
                         low + back + 0.34 * np.sin(a) * np.sin(turn)])
        for a in np.linspace(2.8, 1.0, 5)
    ]  # fmt: skip
    parts.append(skin(np.array(hood), darker(color, 0.75)))
    parts = [ignore(merge(*parts))]
    if buggy:
        for z, r, c in ((0.72, 0.12, (0.45, 0.30, 0.22)), (0.55, 0.14, (0.35, 0.06, 0.08))):
            rings = [
                np.column_stack([x - 0.06 + k * r * np.cos(2 * turn[:-1]),
                                 k * r * np.sin(2 * turn[:-1]), np.full(8, z + d * r)])
                for k, d in ((0.4, -0.9), (0.9, -0.5), (1.0, 0.1), (0.75, 0.7), (0.1, 1.0))
            ]  # fmt: skip
            parts.append(skin(np.array(rings), c, "skin"))
    return merge(*parts)


def carried(name: str, body: Body, pose: Pose, color: Color, second_color: Color) -> Asset:
    """Build an object of ``CARRIED`` where a person in ``pose`` holds it.

    Raises:
        ValueError: unknown name.
    """
    h = body.height
    left, right = (np.array(hand) for hand in pose.hands)
    match name:
        case "backpack":
            return backpack(body, pose, color)
        case "shopping":
            return merge(_shopping(left, h, second_color), _shopping(right, 1.1 * h, color))
        case "handbag":
            return _shopping(right, 0.85 * h, color)
        case "shoulder bag":
            return _shoulder_bag(body, pose, color, across=bool(second_color[0] > color[0]))
        case "briefcase":
            x, y, z = (float(v) for v in right)
            low, high = (x - 0.2, y - 0.05, z - 0.45), (x + 0.2, y + 0.05, z - 0.14)
            grip = box((0.14, 0.02, 0.04), (x, y, z - 0.14), BLACK)
            return merge(block(low, high, color, "plain"), grip)
        case "suitcase":
            return ignore(_suitcase(body, pose, color))
        case "umbrella":
            return _umbrella(right, body, color, second_color)
        case "stick":
            return _stick(right, h, (0.12, 0.06, 0.03))
        case "pram" | "buggy":
            return _pram(pose, color, name == "buggy")
        case "box":
            x, y, z = (float(v) for v in (left + right) / 2)
            return block((x - 0.1, y - 0.22, z - 0.08), (x + 0.24, y + 0.22, z + 0.24), color)
        case "cup":
            foot = right + [0.1, 0, 0]
            ends = np.array([foot, foot + [0, 0, 0.13]])
            return limb(ends, [0.03, 0.042], (0.6, 0.58, 0.52), "plain", 8)
    raise ValueError(f"unknown object to carry {name!r}; {hint(name, CARRIED)}")
