"""People on foot: their build, gait and pose, their clothes, and what they carry."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.family import Family, Size
from scene.assets.parts.body import figure
from scene.assets.parts.carried import PRAM_HANDLE, carried
from scene.assets.parts.human import (
    ANKLE,
    FOREARM,
    HIP_HALF,
    SHIN,
    THIGH,
    UPPER_ARM,
    Body,
    Outfit,
    Pose,
    shoulders,
)
from scene.assets.parts.palette import pick
from scene.assets.parts.wardrobe import BRIGHT, CLOTHES, sample_outfit
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Point, merge, translate


class PersonParams(NamedTuple):
    """One person on foot."""

    body: Body
    outfit: Outfit
    gait: str  # "walk", "stand" or "run"
    phase: float  # of the step, in [0, 1): at 0 the left heel lands
    vigour: float  # of the step, 1 for a brisk walk
    arms: tuple[str, str]  # left and right, see ``_ARMS``
    stoop: float  # lean of the back, radians
    turn: float  # of the head, radians to the left
    carried: tuple[str, ...]  # see ``parts/carried.py``
    carried_color: Color
    second_color: Color


class _Kind(NamedTuple):
    """What all people of a kind have in common."""

    styles: tuple[str, ...]  # of clothes, see ``parts/wardrobe.py``; one is drawn
    gait: str = "walk"  # "walk", "stand", "run", or "any" of the first two
    arms: tuple[str, str] = ("swing", "swing")
    carried: tuple[str, ...] = ()
    is_child: bool = False
    is_old: bool = False
    may_wear_hat: bool = True


_KINDS: dict[str, _Kind] = {
    "walking in a jacket": _Kind(("jacket",)),
    "standing in a jumper": _Kind(("jumper",), "stand", ("hang", "hang")),
    "long coat": _Kind(("long coat",)),
    "skirt": _Kind(("skirt",)),
    "dress": _Kind(("dress",), "any", ("swing", "strap")),
    "puffer jacket": _Kind(("puffer",), "any", ("pocket", "pocket")),
    "suit with briefcase": _Kind(("suit",), "walk", ("swing", "carry"), ("briefcase",)),
    "shorts": _Kind(("t-shirt and shorts",)),
    "hood up": _Kind(("hood",), "any", ("pocket", "pocket")),
    "on the phone": _Kind(("jacket", "jumper", "short coat"), "any", ("swing", "phone")),
    "reading a phone": _Kind(("hoodie", "jumper", "puffer"), "stand", ("text", "text")),
    "backpack": _Kind(("jacket", "hoodie", "t-shirt"), "walk", ("strap", "strap"), ("backpack",)),
    "shopping bags": _Kind(
        ("short coat", "jumper", "jacket"), "any", ("carry", "carry"), ("shopping",)
    ),
    "suitcase": _Kind(("jacket", "short coat", "jumper"), "walk", ("swing", "pull"), ("suitcase",)),
    "shoulder bag": _Kind(
        ("jumper", "t-shirt", "short coat"), "walk", ("swing", "hang"), ("shoulder bag",)
    ),
    "umbrella": _Kind(("long coat", "short coat", "jacket"), "any", ("hang", "hold"), ("umbrella",)),
    "pushing a pram": _Kind(("jacket", "jumper", "short coat"), "walk", ("push", "push"), ("pram",)),
    "pushing a buggy": _Kind(("t-shirt", "puffer", "skirt"), "walk", ("push", "push"), ("buggy",)),
    "child": _Kind(("t-shirt and shorts", "dress", "hoodie", "jumper"), "any", is_child=True),
    "schoolchild": _Kind(("puffer", "jumper", "skirt"), "walk", ("swing", "strap"), ("backpack",),
                        is_child=True, may_wear_hat=False),
    "elderly with stick": _Kind(("short coat", "jacket"), "walk", ("hang", "stick"), ("stick",),
                               is_old=True),
    "jogger": _Kind(("sports",), "run", ("run", "run")),
    "workman": _Kind(("work",), "any", ("hang", "swing")),
    "headscarf": _Kind(("robe",), "any", ("hang", "hang"), ("handbag",)),
    "arms folded": _Kind(("jumper", "jacket", "suit"), "stand", ("folded", "folded")),
    "coffee": _Kind(("suit", "short coat", "hoodie"), "any", ("pocket", "cup"), ("cup",)),
    "carrying a box": _Kind(("t-shirt", "hoodie", "jumper"), "walk", ("lift", "lift"), ("box",)),
    "hands on hips": _Kind(("t-shirt", "sports", "jacket"), "stand", ("hip", "hip")),
}  # fmt: skip
STANDING: tuple[str, ...] = tuple(name for name, kind in _KINDS.items() if kind.gait == "stand")
WALKING: tuple[str, ...] = tuple(name for name, kind in _KINDS.items() if kind.gait == "walk")
"""Kinds that always stand, and kinds that always walk."""

# Position of the wrist relative to the shoulder, as shares of the height, and direction of the elbow, both as
# (forward, out, up). For "swing" and "run" they follow from the step.
_ARMS: dict[str, tuple[Point, Point]] = {
    "hang": ((0.02, 0.035, -0.312), (-1.0, 0.5, -0.2)),
    "carry": ((0.0, 0.035, -0.318), (-1.0, 0.4, -0.2)),
    "pull": ((-0.07, 0.05, -0.295), (-0.4, 0.8, -0.2)),
    "pocket": ((0.055, 0.012, -0.262), (-1.0, 0.7, -0.2)),
    "phone": ((0.045, -0.035, 0.085), (0.7, 0.7, -1.0)),
    "text": ((0.155, -0.055, -0.105), (-0.4, 0.5, -1.0)),
    "strap": ((0.085, -0.035, -0.115), (-0.5, 0.7, -1.0)),
    "hold": ((0.125, -0.03, -0.10), (-0.5, 0.5, -1.0)),
    "stick": ((0.10, 0.05, -0.27), (-1.0, 0.4, -0.2)),
    "folded": ((0.105, -0.145, -0.135), (-0.3, 1.0, -0.6)),
    "cup": ((0.14, -0.01, -0.13), (-0.5, 0.5, -1.0)),
    "lift": ((0.20, 0.0, -0.16), (-0.5, 0.5, -1.0)),
    "hip": ((0.03, 0.005, -0.215), (-0.5, 1.0, -0.2)),
}


def sample_person(rng: np.random.Generator, kind: str) -> PersonParams:
    """Draw a person of one kind: adults 1.46-1.95 m, children 0.95-1.4 m."""
    entry = _KINDS[kind]
    child, old = entry.is_child, entry.is_old
    curves = float(rng.choice([0.0, 0.2, 0.85, 1.0]))
    height = float(np.clip(rng.normal(1.77 - 0.13 * curves, 0.07), 1.52, 1.95))
    build = float(np.clip(rng.normal(1.06, 0.13), 0.85, 1.38))
    young = float(rng.uniform(0.95, 1.4))
    outfit, curves = sample_outfit(rng, str(rng.choice(entry.styles)), curves, old=old, child=child)
    if not entry.may_wear_hat:
        outfit = outfit._replace(hat="")
    gait = str(rng.choice(("walk", "stand"))) if entry.gait == "any" else entry.gait
    left, right = entry.arms
    sway = rng.uniform(0.55, 1.15) * (0.5 if old else 1.0)
    return PersonParams(
        body=Body(
            height=young if child else height - 0.06 * old,
            girth=0.95 if child else build,
            head=float(np.interp(young, [0.9, 1.4], [1.42, 1.15])) if child else 1.0,
            curves=0.2 * curves if child else curves,
            belly=0.0 if child else float(max(0.0, 0.16 * (build - 1.0))),
        ),
        outfit=outfit,
        gait=gait,
        phase=float(rng.random()),
        vigour=float(sway),
        arms=(right, left) if rng.random() < 0.5 and not entry.carried else (left, right),
        stoop=float(rng.uniform(0.22, 0.4)) if old else float(rng.uniform(-0.01, 0.06)),
        turn=float(rng.normal(0, 0.3)),
        carried=entry.carried,
        carried_color=pick(rng, CLOTHES + BRIGHT, 0.3),
        second_color=pick(rng, BRIGHT + CLOTHES, 0.3),
    )


def person(p: PersonParams) -> Asset:
    """Build the person, facing +x, the lowest shoe on the ground."""
    pose = _pose(p)
    walker = figure(p.body, p.outfit, pose)
    low = float(walker.mesh.vertices[:, 2].min())
    walker = translate(walker, (0, 0, -low))
    pose = _lifted(pose, -low)
    luggage = [carried(name, p.body, pose, p.carried_color, p.second_color) for name in p.carried]
    return merge(walker, *luggage)


def _lifted(pose: Pose, by: float) -> Pose:
    def up(point: Point) -> Point:
        return point[0], point[1], point[2] + by

    left, right = pose.hands
    return pose._replace(hip=up(pose.hip), hands=(up(left), up(right)))


def _bump(phase: float, peak: float, width: float) -> float:
    """Return a bell curve of height 1 around ``at`` on the circle of phases."""
    away = (phase - peak + 0.5) % 1 - 0.5
    return float(np.exp(-((away / width) ** 2)))


def _step(phase: float, vigour: float, run: bool) -> tuple[float, float, float]:
    """Return the angles of one leg at ``phase`` of its step: thigh forward, knee bent, toes down.

    The bell curves are fitted manually to those of gait analysis: the knee yields a little at the landing
    and folds as the leg swings through; the heel lands first and lifts first.
    """
    swing = (0.62 if run else 0.40) * vigour
    thigh = swing * np.cos(2 * np.pi * phase) + (0.22 if run else 0.07) * vigour
    fold = (1.75 if run else 1.02) * vigour
    knee = 0.09 + (0.45 if run else 0.2) * vigour * _bump(phase, 0.13, 0.09)
    knee += fold * _bump(phase, 0.71, 0.13)
    toes = 0.95 * vigour * _bump(phase, 0.60, 0.10) - 0.3 * vigour * _bump(phase, 0.0, 0.06)
    if run:
        toes += 0.7 * _bump(phase, 0.72, 0.12)
    return float(thigh), float(knee), float(toes)


def _legs(p: PersonParams) -> tuple[list[Point], list[float]]:
    """Return the ankles relative to the hips, and the pitch of the shoes."""
    h, ankles, toes = p.body.height, [], []
    for k, side in enumerate((1, -1)):
        if p.gait == "stand":
            # One leg carries the weight, the other rests a little ahead with a soft knee.
            ease = (0.02 + 0.16 * p.vigour) if (p.phase < 0.5) == (k == 0) else 0.02
            thigh, knee, pitch = ease, 1.6 * ease, 0.0
        else:
            thigh, knee, pitch = _step((p.phase + 0.5 * k) % 1, p.vigour, p.gait == "run")
        x = THIGH * np.sin(thigh) + SHIN * np.sin(thigh - knee)
        z = -THIGH * np.cos(thigh) - SHIN * np.cos(thigh - knee)
        spread = 0.05 + 0.03 * p.vigour if p.gait == "stand" else 0.75 * HIP_HALF
        ankles.append((float(x) * h, side * spread * h, float(z) * h))
        toes.append(pitch)
    return ankles, toes


def _pose(p: PersonParams) -> Pose:
    """Return the joints of the whole body; the shoulders turn against the hips."""
    h = p.body.height
    ankles, toes = _legs(p)
    hip = ANKLE * h - min(z for _, _, z in ankles)
    moving = p.gait != "stand"
    ahead = float(np.cos(2 * np.pi * p.phase)) * p.vigour if moving else 0.0
    pose = Pose(
        hip=(0.0, 0.0, hip),
        lean=p.stoop + (0.16 if p.gait == "run" else 0.02 * p.vigour),
        hands=((0, 0, 0), (0, 0, 0)),
        ankles=tuple((x, y, z + hip) for x, y, z in ankles),  # type: ignore[arg-type]
        toes=(toes[0], toes[1]),
        look=(0.42 if "text" in p.arms else 0.05) + 0.5 * p.stoop,
        turn=0.0 if "text" in p.arms else p.turn,
        twist=(0.3 if p.gait == "run" else 0.14) * ahead,
    )
    hands, elbows = [], []
    for k, shoulder in enumerate(shoulders(p.body, pose)):
        side = 1 - 2 * k
        wrist, elbow = _arm(p, p.arms[k], -ahead * side)
        x, y, z = shoulder + h * np.array([wrist[0], wrist[1] * side, wrist[2]])
        if p.arms[k] == "push":
            x, y, z = PRAM_HANDLE[0] - 0.05, 0.16 * side, PRAM_HANDLE[1]
        if p.arms[k] == "folded":
            z, x = z - 0.025 * h * k, x + 0.02 * h * k  # one forearm is in front of the other
        hands.append((float(x), float(y), float(z)))
        elbows.append(elbow)
    return pose._replace(hands=(hands[0], hands[1]), elbows=(elbows[0], elbows[1]))


def _arm(p: PersonParams, name: str, ahead: float) -> tuple[Point, Point]:
    """Return wrist and elbow direction as in ``_ARMS``; ``ahead`` is the phase of a swing, -1 to 1."""
    if name in _ARMS:
        return _ARMS[name]
    run = name == "run"
    if name == "push":
        return (0.2, 0.0, -0.2), (-0.6, 0.6, -1.0)
    angle = (0.65 if run else 0.42) * ahead + (-0.1 if run else 0.02)
    elbow = 1.6 if run else 0.22 + 0.18 * max(ahead, 0)
    x = UPPER_ARM * np.sin(angle) + FOREARM * np.sin(angle + elbow)
    z = -UPPER_ARM * np.cos(angle) - FOREARM * np.cos(angle + elbow)
    return (float(x), 0.03 + 0.01 * p.body.girth, float(z)), (-1.0, 0.35, -0.3)


FAMILY = Family(
    "person", TrainId.PERSON, tuple(_KINDS), sample_person, person,
    count=200, size=Size((0.6, 2.6), (0.6, 2.3)), tone=0.65, line=("person", 0.75),
    facing="either",
)  # fmt: skip
