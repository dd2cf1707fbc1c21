"""People on foot: a jointed figure that stands or walks, in everyday clothes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, block, loft, merge, translate
from scene.assets._human import (
    ANKLE,
    CLOTHES,
    FOREARM,
    HAIRS,
    SHIN,
    THIGH,
    TORSO,
    UPPER_ARM,
    Outfit,
    Pose,
    figure,
    oval,
    sample_outfit,
)
from scene.assets._palette import pick


class PersonParams(NamedTuple):
    """One person on foot; metres."""

    height: float
    girth: float  # 1 for average
    head: float  # 1 for an adult
    stride: float  # m between the feet, along x
    outfit: Outfit
    hem: float  # share of the leg that a coat or skirt covers, 0 for none
    hem_color: Color
    flare: float  # width of the hem over that of the hips
    bag: str  # "", "hand" or "back"
    bag_color: Color


KINDS: tuple[str, ...] = (
    "standing", "walking", "with bag", "backpack", "coat", "skirt", "child",
)  # fmt: skip
"""What sets a person apart at a glance."""


def sample_person(rng: np.random.Generator, kind: str) -> PersonParams:
    """Draw a person: adults 1.52-1.92 m, children 1.0-1.4 m, clothes, gait."""
    child = kind == "child"
    height = rng.uniform(1.0, 1.4) if child else float(np.clip(rng.normal(1.71, 0.09), 1.52, 1.92))
    outfit = sample_outfit(rng)
    if child:
        outfit = outfit._replace(hair=pick(rng, HAIRS[:-1]))  # not grey
    hem, hem_color, flare = 0.0, outfit.top, 1.1
    if kind == "coat":
        hem, flare = rng.uniform(0.35, 0.6), 1.15
        outfit = outfit._replace(short_sleeves=False)
    elif kind == "skirt":
        hem, flare, hem_color = (
            rng.uniform(0.4, 0.75),
            rng.uniform(1.2, 1.6),
            pick(rng, CLOTHES, 0.3),
        )
        outfit = outfit._replace(
            long_hair=True, legs=outfit.skin if rng.random() < 0.6 else outfit.legs
        )
    still = kind == "standing" or rng.random() < 0.15
    return PersonParams(
        height=height,
        girth=rng.uniform(0.9, 1.2),
        head=rng.uniform(1.2, 1.3) if child else rng.uniform(0.97, 1.05),
        stride=rng.uniform(0.0, 0.06)
        if still
        else rng.uniform(0.22, 0.3 if hem else 0.42) * height,
        outfit=outfit,
        hem=hem,
        hem_color=hem_color,
        flare=flare,
        bag={"with bag": "hand", "backpack": "back"}.get(kind, ""),
        bag_color=pick(rng, CLOTHES, 0.4),
    )


def person(params: PersonParams) -> Asset:
    """The person of ``params``, walking towards +x."""
    p = params
    pose = _pose(p)
    parts = [figure(p.height, p.girth, p.head, p.outfit, pose)]
    if p.hem:
        parts.append(_hem(p, pose))
    if p.bag:
        parts.append(_bag(p, pose))
    body = merge(*parts)
    return translate(body, (0, 0, -float(body.mesh.vertices[:, 2].min())))


def _pose(p: PersonParams) -> Pose:
    """Left foot ahead, right arm ahead; the hips sink as the feet part."""
    h, half = p.height, p.stride / 2
    leg = (THIGH + SHIN) * h
    hip = ANKLE * h + float(np.sqrt(leg**2 - half**2)) - 0.003 * h
    lift = 0.25 * half  # the heel behind leaves the ground
    reach = 0.965 * (UPPER_ARM + FOREARM) * h
    swing = 0.75 * half
    shoulder = hip + TORSO * h
    out = 0.135 * h * p.girth**0.5
    drop = shoulder - float(np.sqrt(max(reach**2 - swing**2, 0.01)))
    lean = 0.04 + 0.1 * p.stride
    return Pose(
        hip=(0, 0, hip),
        lean=lean,
        hands=(
            (lean * TORSO * h - swing, out, drop),
            (lean * TORSO * h + swing + 0.02, -out, drop),
        ),
        ankles=((half, 0.045 * h, ANKLE * h), (-half, -0.045 * h, ANKLE * h + lift)),
        toes=(-0.2 * half, 1.6 * half),
    )


def _hem(p: PersonParams, pose: Pose) -> Asset:
    """A coat's tail or a skirt: a skin from the waist down over the legs."""
    waist = pose.hip[2] + 0.05 * p.height
    low = pose.hip[2] * (1 - p.hem)
    deep = 0.07 * p.height * p.girth
    wide = 0.095 * p.height * p.girth**0.5
    stretched = max(1.2 * deep * p.flare, p.stride / 2 * p.hem + 0.1 * p.height)  # over both legs
    forward = np.array([1.0, 0, 0])
    rings = [
        oval(np.array([0.01, 0, waist]), forward, 0.95 * deep, 0.95 * wide),
        oval(np.array([0, 0, pose.hip[2] - 0.05]), forward, 1.3 * deep, 1.15 * wide),
        oval(np.array([0, 0, low]), forward, stretched, 1.1 * wide * p.flare),
    ]
    return loft(rings, p.hem_color, "cloth", caps=False)


def _bag(p: PersonParams, pose: Pose) -> Asset:
    h = p.height
    if p.bag == "back":
        x, z = -0.075 * h * p.girth, pose.hip[2]
        low, high = (x - 0.10 * h, -0.085 * h, z + 0.05 * h), (x + 0.01, 0.085 * h, z + 0.30 * h)
        return block(low, high, p.bag_color, "cloth")
    x, y, z = pose.hands[1]
    size = 0.11 * h
    low, high = (x - size, y - 0.06, z - 0.26 * h), (x + size, y + 0.04, z - 0.06 * h)
    return block(low, high, p.bag_color, "cloth")
