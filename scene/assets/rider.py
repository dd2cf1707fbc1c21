"""Riders: the human on a bicycle or a motorcycle, seated where the machine has its saddle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, Point, block, merge, transform
from scene.assets import bicycle, motorcycle
from scene.assets._human import ANKLE, TORSO, Outfit, Pose, figure, sample_outfit, spine
from scene.assets._palette import pick


class RiderParams(NamedTuple):
    """One rider; metres and radians."""

    mount: str  # "bicycle" or "motorcycle"
    height: float  # standing
    girth: float  # 1 for average
    lean: float  # of the back, forward from upright
    outfit: Outfit
    backpack: Color | None


MOUNT: dict[str, str] = {
    "cyclist upright": "bicycle",
    "cyclist racing": "bicycle",
    "motorcyclist upright": "motorcycle",
    "motorcyclist sports": "motorcycle",
    "cyclist with backpack": "bicycle",
    "scooter rider": "motorcycle",
}
"""The family of the machine under each kind of rider."""
KINDS: tuple[str, ...] = tuple(MOUNT)
"""How a rider sits and on what."""

_LEANS: dict[str, tuple[float, float]] = {
    "cyclist upright": (0.30, 0.45),
    "cyclist racing": (0.80, 0.98),
    "cyclist with backpack": (0.40, 0.60),
    "motorcyclist upright": (0.15, 0.28),
    "motorcyclist sports": (0.62, 0.80),
    "scooter rider": (0.08, 0.20),
}
_JERSEYS: tuple[Color, ...] = (
    (0.40, 0.02, 0.02),
    (0.03, 0.16, 0.45),
    (0.45, 0.50, 0.03),
    (0.55, 0.55, 0.53),
    (0.02, 0.02, 0.02),
    (0.50, 0.17, 0.02),
)
_LEATHERS: tuple[Color, ...] = ((0.018, 0.018, 0.02), (0.05, 0.05, 0.053), (0.07, 0.04, 0.025))
_HELMETS: tuple[Color, ...] = (
    (0.02, 0.02, 0.02),
    (0.62, 0.62, 0.60),
    (0.35, 0.02, 0.02),
    (0.03, 0.09, 0.30),
    (0.30, 0.31, 0.32),
)


def sample_rider(rng: np.random.Generator, kind: str) -> RiderParams:
    """Draw a rider of one kind: size, how far the back leans, clothes and helmet."""
    outfit = sample_outfit(rng)
    helmet = pick(rng, _HELMETS)
    if MOUNT[kind] == "motorcycle":
        scooter = kind == "scooter rider"
        outfit = outfit._replace(helmet=helmet, visor=not scooter, short_sleeves=False)
        if not scooter:
            outfit = outfit._replace(top=pick(rng, _LEATHERS, 0.4), legs=pick(rng, _LEATHERS, 0.4))
    elif kind == "cyclist racing":
        outfit = outfit._replace(
            top=pick(rng, _JERSEYS), legs=(0.02, 0.02, 0.02), helmet=helmet, short_sleeves=True
        )
    elif rng.random() < 0.5:
        outfit = outfit._replace(helmet=helmet)
    return RiderParams(
        mount=MOUNT[kind],
        height=rng.uniform(1.62, 1.86),
        girth=rng.uniform(0.95, 1.15),
        lean=rng.uniform(*_LEANS[kind]),
        outfit=outfit,
        backpack=pick(rng, _JERSEYS) if kind == "cyclist with backpack" else None,
    )


def rider(params: RiderParams) -> Asset:
    """The rider of ``params``, facing +x, where the machine of the same pose has its saddle."""
    p = params
    pose = _pose(p)
    body = figure(p.height, p.girth, 1.0, p.outfit, pose)
    return body if p.backpack is None else merge(body, _backpack(p, pose, p.backpack))


def _pose(p: RiderParams) -> Pose:
    h = p.height
    if p.mount == "bicycle":
        saddle, bar, feet = bicycle.SADDLE, bicycle.BAR, bicycle.pedals()
        toes = (0.25, 0.1)
    else:
        saddle, bar = motorcycle.SADDLE, motorcycle.BAR
        x, y, z = motorcycle.FOOT
        feet, toes = ((x, y, z), (x, -y, z)), (0.1, 0.1)
    hands: list[Point] = [(bar[0] - 0.05, side * bar[1], bar[2] + 0.04) for side in (1, -1)]
    ankles: list[Point] = [(x - 0.05, y, z + ANKLE * h + 0.02) for x, y, z in feet]
    return Pose(
        hip=(saddle[0], 0.0, saddle[2] + 0.055 * h),
        lean=p.lean,
        hands=(hands[0], hands[1]),
        ankles=(ankles[0], ankles[1]),
        toes=toes,
        elbows=(-0.5, 1.0, -0.8),
        look=0.55 * p.lean,
    )


def _backpack(p: RiderParams, pose: Pose, color: Color) -> Asset:
    """A bag on the back, its sides along the spine."""
    up, forward = spine(pose)
    hip, h = np.array(pose.hip), p.height
    bag = block((-0.10 * h, -0.085 * h, 0.0), (0.0, 0.085 * h, 0.22 * h), color, "cloth")
    turn = np.eye(4)
    turn[:3, 0], turn[:3, 2] = forward, up
    turn[:3, 3] = hip + 0.25 * TORSO * h * up - 0.06 * h * p.girth * forward
    return transform(bag, turn)
