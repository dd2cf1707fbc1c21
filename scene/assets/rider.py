"""Riders of bicycles and motorcycles, without the machine, seated where it has its saddle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets import bicycle, motorcycle
from scene.assets.family import ROAD, Family, Size
from scene.assets.parts.body import figure
from scene.assets.parts.carried import backpack
from scene.assets.parts.human import ANKLE, Body, Outfit, Pose
from scene.assets.parts.palette import BLACK, REFLECTING, SILVER, WHITE, pick
from scene.assets.parts.wardrobe import BRIGHT, CLOTHES, HI_VIS, TROUSERS, sample_outfit
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Point, merge


class RiderParams(NamedTuple):
    """One rider; metres and radians."""

    mount: str  # "bicycle" or "motorcycle"
    body: Body
    lean: float  # of the back, forward from upright
    turn: float  # of the head to the left
    outfit: Outfit
    bag: Color | None  # colour of a backpack; None without one
    bag_size: float = 1.0


class _Kind(NamedTuple):
    """What all riders of a kind have in common."""

    mount: str
    style: str  # of the clothes, see ``parts/wardrobe.py``
    lean: tuple[float, float]
    hats: tuple[str, ...]  # one is drawn; "" for none
    bag_size: float = 0.0  # 0 without one


_KINDS: dict[str, _Kind] = {
    "cyclist upright": _Kind("bicycle", "jacket", (0.34, 0.58), ("", "", "beanie", "cap")),
    "cyclist racing": _Kind("bicycle", "sports", (0.88, 1.08), ("cycle helmet",)),
    "cyclist in hi-vis": _Kind("bicycle", "work", (0.48, 0.72), ("cycle helmet",)),
    "cyclist with backpack": _Kind("bicycle", "hoodie", (0.5, 0.76), ("cycle helmet", ""), 1.0),
    "cyclist in a skirt": _Kind("bicycle", "skirt", (0.28, 0.46), ("", "cycle helmet")),
    "cyclist in shorts": _Kind("bicycle", "t-shirt and shorts", (0.58, 0.84), ("cycle helmet", "")),
    "courier": _Kind("bicycle", "puffer", (0.46, 0.7), ("cycle helmet", "hood"), 1.7),
    "motorcyclist upright": _Kind("motorcycle", "jacket", (0.15, 0.28), ("full helmet",)),
    "motorcyclist sports": _Kind("motorcycle", "jacket", (0.7, 0.9), ("full helmet",)),
    "motorcyclist in hi-vis": _Kind("motorcycle", "work", (0.18, 0.34), ("full helmet",)),
    "scooter rider": _Kind("motorcycle", "short coat", (0.08, 0.20), ("open helmet",)),
    "scooter courier": _Kind("motorcycle", "puffer", (0.08, 0.2), ("open helmet",), 1.6),
}
MOUNT: dict[str, str] = {name: kind.mount for name, kind in _KINDS.items()}
"""The family of the machine under each kind of rider."""

_LEATHERS: tuple[Color, ...] = ((0.012, 0.012, 0.013), (0.033, 0.033, 0.035), (0.046, 0.026, 0.016))
_HELMETS: tuple[Color, ...] = (
    BLACK, WHITE, (0.35, 0.02, 0.02), (0.03, 0.09, 0.30),
    SILVER, (0.45, 0.40, 0.03),
)  # fmt: skip


def sample_rider(rng: np.random.Generator, kind: str) -> RiderParams:
    """Draw a rider of one kind: size, how far the back leans, clothes and helmet."""
    entry = _KINDS[kind]
    outfit, curves = sample_outfit(rng, entry.style, float(rng.choice([0.0, 0.1, 0.9])))
    outfit = outfit._replace(hat=str(rng.choice(entry.hats)), hat_color=pick(rng, _HELMETS))
    if outfit.hat == "hood":
        outfit = outfit._replace(hat_color=outfit.top)
    if entry.style != "skirt":
        outfit = outfit._replace(hem=0.0)
    if entry.mount == "motorcycle":
        outfit = outfit._replace(sleeves=1.0, trousers=1.0, padding=max(outfit.padding, 0.010))
        if entry.style == "jacket":
            suit = pick(rng, _LEATHERS, 0.4)
            stripe = pick(rng, BRIGHT) if rng.random() < 0.5 else None
            outfit = outfit._replace(
                top=suit, legs=pick(rng, _LEATHERS, 0.4), accent=stripe, shirt=None, stripes=False
            )
    if entry.style == "work":
        outfit = outfit._replace(top=HI_VIS[int(rng.random() < 0.2)], bands=REFLECTING)
        if rng.random() < 0.8:
            outfit = outfit._replace(legs=pick(rng, TROUSERS, 0.3))
    return RiderParams(
        mount=entry.mount,
        body=Body(
            height=float(rng.uniform(1.64, 1.86) - 0.04 * curves),
            girth=float(rng.uniform(0.9, 1.15)),
            curves=curves,
        ),
        lean=float(rng.uniform(*entry.lean)),
        turn=float(rng.normal(0, 0.15)),
        outfit=outfit,
        bag=pick(rng, BRIGHT + CLOTHES, 0.3) if entry.bag_size else None,
        bag_size=entry.bag_size or 1.0,
    )


def rider(p: RiderParams) -> Asset:
    """Build the rider, facing +x, seated on the saddle of a machine at the origin."""
    pose = _pose(p)
    person = figure(p.body, p.outfit, pose)
    return person if p.bag is None else merge(person, backpack(p.body, pose, p.bag, p.bag_size))


def _pose(p: RiderParams) -> Pose:
    """Return the joints: seat on the saddle, hands on the bar, shoes on the pedals or rests."""
    h = p.body.height
    if p.mount == "bicycle":
        saddle, bar, feet = bicycle.SADDLE, bicycle.BAR, bicycle.pedals()
        toes = (0.25, 0.1)
    else:
        saddle, bar = motorcycle.SADDLE, motorcycle.BAR
        x, y, z = motorcycle.FOOT
        feet, toes = ((x, y, z), (x, -y, z)), (0.1, 0.1)
    hands: list[Point] = [(bar[0] - 0.05, side * bar[1], bar[2] + 0.04) for side in (1, -1)]
    ankles: list[Point] = [(x - 0.05, y, z + ANKLE * h + 0.02) for x, y, z in feet]
    elbow = (-0.5, 1.0, -0.8)
    return Pose(
        hip=(saddle[0], 0.0, saddle[2] + 0.062 * h),
        lean=p.lean,
        hands=(hands[0], hands[1]),
        ankles=(ankles[0], ankles[1]),
        toes=toes,
        elbows=(elbow, elbow),
        look=0.5 * p.lean,
        turn=p.turn,
    )


FAMILY = Family(
    "rider", TrainId.RIDER, tuple(MOUNT), sample_rider, rider,
    count=30, size=Size((0.6, 2.6), (0.6, 2.3)), tone=0.55, line=("person", 0.25),
    facing="either", stage=ROAD._replace(azimuth=-50), mounted_on=MOUNT,
)  # fmt: skip
