"""Builds a dressed person around the bones: torso, limbs, hands, shoes, coat tails and skirts.

All lengths in the tables are shares of the standing height, so that the body scales as a whole.
"""

from __future__ import annotations

import math

import numpy as np

from scene.assets.parts.head import head
from scene.assets.parts.human import (
    ANKLE,
    FOREARM,
    HAND,
    HIP_HALF,
    SHIN,
    THIGH,
    TORSO,
    UPPER_ARM,
    Body,
    Outfit,
    Pose,
    bend,
    circles,
    limb,
    paint_bands,
    shoulders,
    skin,
    spine,
)
from scene.mesh.asset import Asset, Color, merge, repaint
from scene.mesh.mesh import circle, cross, unit

Bones = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Hip, knee and ankle, or shoulder, elbow and wrist, m."""

# For each position along the back (0 hip, 1 shoulder): forward offset of the middle, half depth and half
# width as shares of the height, then the additions of ``Body.curves`` to width and depth.
_TORSO = np.array([
    (-0.24, -0.004, 0.046, 0.060, 0.00, 0.000), (-0.10, -0.006, 0.064, 0.090, 0.06, 0.004),
    (0.08, -0.006, 0.066, 0.094, 0.06, 0.003), (0.25, 0.000, 0.060, 0.086, -0.06, -0.004),
    (0.40, 0.003, 0.058, 0.082, -0.12, -0.006), (0.56, 0.005, 0.062, 0.088, -0.10, 0.000),
    (0.70, 0.006, 0.067, 0.096, -0.08, 0.012), (0.83, 0.003, 0.062, 0.102, -0.10, 0.002),
    (0.93, -0.004, 0.053, 0.103, -0.10, -0.003), (1.00, -0.008, 0.045, 0.088, -0.10, 0.000),
    (1.06, -0.010, 0.036, 0.056, 0.00, 0.000), (1.13, -0.006, 0.031, 0.034, 0.00, 0.000),
])  # fmt: skip
_TORSO_SIDES = 16
_WAIST = 2  # first band of the top; the trousers are below


def _torso(body: Body, outfit: Outfit, pose: Pose) -> Asset:
    up, forward = spine(pose)
    h, across = body.height, np.array([0, 1.0, 0])
    t, offset, depth, width, w_curves, d_curves = _TORSO.T
    thick = outfit.padding * np.clip((t + 0.2) * 5, 0, 1) * np.clip((1.1 - t) * 8, 0, 1)
    if outfit.quilted:
        thick = thick * np.where(np.arange(len(t)) % 2, 1.0, 0.45)
    middle = np.exp(-(((t - 0.3) / 0.22) ** 2))
    depth = (depth + d_curves * body.curves) * body.girth**0.7 + thick + 0.5 * body.belly * middle
    width = (
        width * (1 + w_curves * body.curves) * body.girth**0.5 + thick + 0.3 * body.belly * middle
    )
    offset = offset + 0.5 * body.belly * middle + 0.4 * body.curves * np.maximum(d_curves, 0)
    share = np.clip(t, 0, 1)[:, None]
    turn = pose.twist * share
    ahead = np.cos(turn) * forward + np.sin(turn) * across
    aside = np.cos(turn) * across - np.sin(turn) * forward
    # Below the hips the body stays upright, however the back leans.
    axis = np.where(t[:, None] > 0, up, np.array([0, 0, 1.0]))
    centre = np.array(pose.hip) + h * (t[:, None] * TORSO * axis + offset[:, None] * ahead)
    angle = (np.arange(_TORSO_SIDES) + 0.5) * 2 * np.pi / _TORSO_SIDES
    # The section is slightly square, like a chest.
    cos, sin = (np.sign(f) * np.abs(f) ** 0.85 for f in (np.cos(angle), np.sin(angle)))
    rings = centre[:, None] + h * (
        (depth[:, None] * cos)[..., None] * ahead[:, None]
        + (width[:, None] * sin)[..., None] * aside[:, None]
    )
    return _colored(skin(rings, outfit.top), outfit)


def _colored(torso: Asset, outfit: Outfit) -> Asset:
    """Colour a torso: waistband, shirt front, stripes, bands and neck."""
    sides, bands = _TORSO_SIDES, len(_TORSO) - 1
    if outfit.accent is not None:
        for band in range(_WAIST, bands - 1, 2) if outfit.stripes else (2, 3, 4):
            torso = paint_bands(torso, sides, band, band + 1, outfit.accent)
    if outfit.bands is not None:
        for band in (3, 5):
            torso = paint_bands(torso, sides, band, band + 1, outfit.bands, "paint")
    if outfit.shirt is not None:
        # The front is around angle 0, between the last and the first side.
        faces = np.arange(2 * sides * bands).reshape(bands, sides, 2)
        torso = repaint(torso, faces[_WAIST:8, -1].ravel(), outfit.shirt, "cloth")
        torso = repaint(torso, faces[8:10, (-2, -1, 0)].ravel(), outfit.shirt, "cloth")
    lower_color = outfit.hem_color if outfit.hem_color is not None else outfit.legs
    torso = paint_bands(torso, sides, 0, _WAIST, lower_color if outfit.hem == 0 else outfit.top)
    if outfit.hem and outfit.hem_color is not None:
        torso = paint_bands(torso, sides, 0, _WAIST, outfit.hem_color)
    return paint_bands(torso, sides, bands - 1, bands, outfit.collar or outfit.skin)


# Positions of the rings along thigh (0 to 1) and shin (1 to 2), and radii of a bare leg and of slim trousers;
# the same for the arm.
_LEG_RINGS = np.array([0.0, 0.12, 0.4, 0.75, 0.95, 1.05, 1.22, 1.4, 1.65, 1.85, 2.0])
_LEG_BARE = np.array([46, 50, 46, 37, 32, 31, 33, 34, 27, 21, 21]) / 1000
_LEG_SLIM = np.array([48, 53, 49, 41, 37, 36, 37, 37, 33, 31, 32]) / 1000
_ARM_RINGS = np.array([-0.16, -0.1, 0.1, 0.3, 0.65, 0.93, 1.07, 1.3, 1.65, 1.97])
_ARM_BARE = np.array([10, 24, 31, 29, 26, 22, 22, 23, 19, 15]) / 1000
_ARM_SLEEVE = np.array([12, 26, 34, 33, 30, 27, 27, 27, 24, 22]) / 1000


def _on_bones(bones: Bones, positions: np.ndarray) -> np.ndarray:
    """Return points f64[n, 3] on two bones: 0 to 1 on the first, 1 to 2 on the second."""
    start, joint, end = bones
    upper = start + np.minimum(positions, 1)[:, None] * (joint - start)
    return upper + np.maximum(positions - 1, 0)[:, None] * (end - joint)


def _leg(body: Body, outfit: Outfit, joints: Bones) -> Asset:
    sides, covered = 10, 2 * outfit.trousers
    width = 1 + (outfit.width - 1) * np.clip(_LEG_RINGS - 0.3, 0, 1)
    radii = np.where(covered >= _LEG_RINGS, _LEG_SLIM * width, _LEG_BARE)
    radii = radii * body.height * body.girth**0.8 * (1 + 0.06 * body.curves * (_LEG_RINGS < 0.6))
    leg = skin(circles(_on_bones(joints, _LEG_RINGS), radii, sides), outfit.legs)
    bare = int((covered >= _LEG_RINGS).sum())
    return paint_bands(leg, sides, max(bare - 1, 0), len(_LEG_RINGS) - 1, outfit.skin, "skin")


def _arm(body: Body, outfit: Outfit, joints: Bones) -> Asset:
    sides, covered = 8, 2 * outfit.sleeves
    radii = np.where(covered >= _ARM_RINGS, _ARM_SLEEVE + 0.7 * outfit.padding, _ARM_BARE)
    if outfit.quilted:
        radii = radii * np.where(np.arange(len(radii)) % 2, 1.04, 0.92)
    arm = skin(
        circles(_on_bones(joints, _ARM_RINGS), radii * body.height * body.girth**0.7, sides),
        outfit.top,
    )
    if outfit.bands is not None:
        arm = paint_bands(arm, sides, 3, 4, outfit.bands, "paint")
    bare = int((covered >= _ARM_RINGS).sum())
    return paint_bands(arm, sides, max(bare - 1, 0), len(_ARM_RINGS) - 1, outfit.skin, "skin")


def _hand(
    wrist: np.ndarray, along: np.ndarray, across: np.ndarray, h: float, skin_: Color
) -> Asset:
    """Build a mitten whose thumb points to ``across``."""
    side = across - along * (across @ along)
    side /= max(math.sqrt(side.dot(side)), 1e-9)
    flat = cross(along, side)
    cos, sin = circle(6)[..., None]
    distance, width, depth = _PALM
    rings = wrist + h * (distance * along + width * cos * side + depth * sin * flat)
    tip = wrist + h * (0.055 * along + 0.035 * side)
    thumb = limb([wrist + 0.015 * h * along, tip], [0.010 * h, 0.006 * h], skin_, "skin", 5)
    return merge(skin(rings, skin_, "skin"), thumb)


# Along a hand from wrist to fingertips: distance, half width, half depth.
_PALM = np.array([
    (-0.006, 0.013, 0.011), (0.02, 0.023, 0.012), (0.05, 0.024, 0.012), (0.08, 0.019, 0.010),
    (HAND, 0.008, 0.005),
]).T[..., None, None]  # fmt: skip


# Along a shoe from heel to toe: x, half width, height of the upper, height of its ridge.
_SHOE = ((-0.042, 0.014, 0.030, 0.036), (-0.030, 0.021, 0.040, 0.052), (0.004, 0.022, 0.036, 0.054),
         (0.040, 0.025, 0.026, 0.036), (0.078, 0.027, 0.019, 0.024), (0.100, 0.020, 0.014, 0.018),
         (0.110, 0.010, 0.010, 0.012))  # fmt: skip
_SHOE_RINGS = np.array([
    [(x, y, z - ANKLE) for y, z in (
        (-w, 0.0), (w, 0.0), (w * 1.02, 0.012), (w * 0.9, high), (w * 0.4, ridge),
        (-w * 0.4, ridge), (-w * 0.9, high), (-w * 1.02, 0.012))]
    for x, w, high, ridge in _SHOE
])  # fmt: skip
_SOLE = np.arange(2 * 8 * (len(_SHOE) - 1)).reshape(-1, 8, 2)[:, (0, 1, 7)].ravel()


def _shoe(ankle: np.ndarray, h: float, pitch: float, splay: float, outfit: Outfit) -> Asset:
    """Build a shoe; its sole is the share ``ANKLE`` of the height below the ankle."""
    sin, cos = np.sin(pitch), np.cos(pitch)
    x, y, z = np.moveaxis(_SHOE_RINGS * h, -1, 0)
    x, z = x * cos + z * sin, z * cos - x * sin
    x, y = x * np.cos(splay) - y * np.sin(splay), y * np.cos(splay) + x * np.sin(splay)
    shoe = skin(ankle + np.stack([x, y, z], -1), outfit.shoes, "plain")
    return repaint(shoe, _SOLE, outfit.sole, "plain")


def _hem(body: Body, outfit: Outfit, pose: Pose, legs: list[Bones]) -> Asset:
    """Build a coat's tail or a skirt: a skin from the waist down around both legs in any pose."""
    h, hip = body.height, np.array(pose.hip)
    angle = (np.arange(12) + 0.5) * 2 * np.pi / 12
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    ahead, across, _ = np.eye(3)
    rings = []
    for share in np.linspace(-0.25, 1.0, 4 + round(4 * outfit.hem)):
        position = max(share, 0.0) * outfit.hem * 2
        points = np.concatenate([_on_bones(leg, np.array([position])) for leg in legs])
        loose = h * (0.016 + outfit.padding + 0.05 * (outfit.flare - 1) * max(share, 0) * 2)
        radius = h * float(np.interp(position, _LEG_RINGS, _LEG_SLIM)) * body.girth**0.8 + loose
        centre, half = points.mean(0), np.abs(points[0] - points[1]) / 2
        depth = max(half[0] + radius, 0.070 * h * body.girth**0.7)
        width = max(half[1] + radius, 0.094 * h * (1 - 0.12 * max(-share * 4, 0)) * body.girth**0.5)
        centre = np.array([centre[0], centre[1], hip[2] - share * outfit.hem * (THIGH + SHIN) * h])
        if share <= 0:
            centre = hip + np.array([0, 0, -0.3 * share * TORSO * h * 1.5])
        rings.append(centre + depth * cos * ahead + width * sin * across)
    return skin(np.array(rings), outfit.hem_color or outfit.top)


def figure(body: Body, outfit: Outfit, pose: Pose) -> Asset:
    """Build a dressed person in ``pose``."""
    h, hip = body.height, np.array(pose.hip)
    parts = [_torso(body, outfit, pose)]
    legs: list[Bones] = []
    for k, (side, shoulder) in enumerate(zip((1, -1), shoulders(body, pose), strict=True)):
        across = np.array([0, side, 0.0])
        top = hip + HIP_HALF * h * across
        ankle = np.array(pose.ankles[k])
        knee = bend(top, ankle, THIGH * h, SHIN * h, (1, 0.15 * side, 0.3))
        legs.append((top, knee, ankle))
        parts += [_leg(body, outfit, legs[-1]), _shoe(ankle, h, pose.toes[k], 0.12 * side, outfit)]
        wrist = np.array(pose.hands[k])
        x, y, z = pose.elbows[k]
        elbow = bend(shoulder, wrist, UPPER_ARM * h, FOREARM * h, (x, y * side, z))
        along = unit(wrist - elbow)
        parts.append(_arm(body, outfit, (shoulder, elbow, wrist)))
        parts.append(_hand(wrist, along, np.array([0.8, -0.6 * side, 0.2]), h, outfit.skin))
    if outfit.hem:
        parts.append(_hem(body, outfit, pose, legs))
    return merge(*parts, head(body, outfit, pose))
