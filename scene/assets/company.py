"""People on benches and people with dogs (class person; dogs and benches have no class)."""

from __future__ import annotations

import math
from itertools import product
from typing import NamedTuple

import numpy as np

from scene.assets import person
from scene.assets.family import Family, Size
from scene.assets.parts.body import figure
from scene.assets.parts.human import ANKLE, Pose, limb
from scene.assets.parts.palette import BLACK, STEEL, pick
from scene.assets.person import PersonParams, sample_person
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Parts, Point, ignore, merge, translate
from scene.mesh.solids import box, ellipsoid

BENCH = 0.62
"""Length of a bench per person, along y (metres)."""
SEAT = 0.44
"""Height of a bench's seat (metres)."""
COATS: tuple[Color, ...] = (
    (0.02, 0.018, 0.016), (0.10, 0.055, 0.028), (0.24, 0.16, 0.085), (0.34, 0.32, 0.29),
    (0.05, 0.045, 0.042), (0.20, 0.08, 0.03),
)  # fmt: skip
WOODS: tuple[Color, ...] = ((0.16, 0.10, 0.06), (0.10, 0.10, 0.098), (0.05, 0.10, 0.065))


class Dog(NamedTuple):
    """A walking dog."""

    height: float  # of the shoulders, m
    build: float  # girth relative to a slim dog
    coat: Color
    ears: float  # 1 standing, -1 hanging
    place: tuple[float, float]  # of its middle, from its owner, m
    step: float  # of the legs, radians


class CompanyParams(NamedTuple):
    """A person, sitting or with dogs."""

    person: PersonParams
    lean: float  # of a sitting person's back, radians
    hands: tuple[Point, Point] | None  # of a sitting person, from the hips, m; None if walking
    stretch: float  # from the hips forward to the feet, m
    wood: Color
    dogs: tuple[Dog, ...]


_LAP: tuple[Point, Point] = ((0.26, 0.07, 0.10), (0.26, -0.07, 0.10))
_SITTING: dict[str, tuple[str, tuple[float, float], tuple[Point, Point]]] = {
    "sitting upright": ("standing in a jumper", (-0.12, 0.05), _LAP),
    "sitting with a phone": ("reading a phone", (0.05, 0.2), ((0.30, 0.05, 0.27), (0.30, -0.04, 0.27))),
    "sitting, arms folded": ("arms folded", (-0.12, 0.0), ((0.19, -0.06, 0.26), (0.21, 0.06, 0.23))),
    "sitting, leaning on the knees": (
        "hands on hips", (0.45, 0.7), ((0.45, 0.06, 0.19), (0.45, -0.06, 0.19)),
    ),
}  # fmt: skip
_WALKING: dict[str, tuple[str, tuple[float, float], int]] = {
    "with a small dog": ("walking in a jacket", (0.22, 0.34), 1),
    "with a large dog": ("puffer jacket", (0.48, 0.68), 1),
    "with two dogs": ("hood up", (0.28, 0.55), 2),
}
SITTING, WALKING = tuple(_SITTING), tuple(_WALKING)


def sample_company(rng: np.random.Generator, kind: str) -> CompanyParams:
    """Draw a person of one kind."""
    name, _, detail = _SITTING[kind] if kind in _SITTING else _WALKING[kind]
    walker = sample_person(rng, name)
    wood, stretch = pick(rng, WOODS, 0.3), float(rng.uniform(0.36, 0.56))
    if isinstance(detail, tuple):
        walker = walker._replace(outfit=walker.outfit._replace(hem=min(walker.outfit.hem, 0.2)))
        lean = float(rng.uniform(*_SITTING[kind][1]))
        return CompanyParams(walker, lean, detail, stretch, wood, ())
    dogs = tuple(_sample_dog(rng, _WALKING[kind][1], k) for k in range(detail))
    return CompanyParams(walker, 0.0, None, stretch, wood, dogs)


def _sample_dog(rng: np.random.Generator, heights: tuple[float, float], k: int) -> Dog:
    place = float(rng.uniform(0.6, 1.1)), float(rng.uniform(0.3, 0.55)) * (1 if k else -1)
    return Dog(
        float(rng.uniform(*heights)), float(rng.uniform(0.85, 1.3)), pick(rng, COATS, 0.3),
        float(rng.choice([1.0, -1.0])), place, float(rng.uniform(-0.4, 0.4)),
    )  # fmt: skip


def company(p: CompanyParams) -> Asset:
    """Build the person, facing +x, with a piece of bench or with dogs."""
    if p.hands is not None:
        return merge(_sitter(p, p.hands), ignore(merge(*_bench(p.wood))))
    dogs = (ignore(merge(_dog_body(dog), _lead(dog))) for dog in p.dogs)
    return merge(person.person(p.person), *dogs)


def _sitter(p: CompanyParams, hands: tuple[Point, Point]) -> Asset:
    """Build the person on the seat, the lowest shoe on the ground."""
    h = p.person.body.height
    hip = (0.0, 0.0, SEAT + 0.055 * h)
    ankles = [(p.stretch * h / 1.75 + 0.03 * s, 0.075 * s * h, ANKLE * h) for s in (1, -1)]
    wrists = [(x * h / 1.75, y, hip[2] + z * h / 1.75) for x, y, z in hands]
    pose = Pose(
        hip=hip, lean=p.lean, hands=(wrists[0], wrists[1]), ankles=(ankles[0], ankles[1]),
        elbows=((-0.6, 0.6, -0.8), (-0.6, 0.6, -0.8)), look=0.15 + 0.5 * max(p.lean, 0.0),
        turn=p.person.turn,
    )  # fmt: skip
    sitter = figure(p.person.body, p.person.outfit, pose)
    return translate(sitter, (0, 0, -float(sitter.mesh.vertices[:, 2].min())))


def _bench(wood: Color) -> Parts:
    """Build slats of seat and back, and two legs."""
    for x in (-0.16, -0.04, 0.08):
        yield box((0.09, BENCH, 0.035), (x, 0, SEAT - 0.035), wood, "wood")
    for z in (0.58, 0.74):
        yield box((0.03, BENCH, 0.1), (-0.25, 0, z), wood, "wood")
    for (x, high), y in product(((-0.29, 0.84), (0.1, SEAT - 0.03)), (-0.27, 0.27)):
        yield box((0.05, 0.04, high), (x, y, 0), STEEL, "metal")


def _dog_body(dog: Dog) -> Asset:
    """Build the dog at its place."""
    h, b, coat = dog.height, dog.build, dog.coat
    trunk = ((-0.55, 0.82), (-0.5, 0.80), (-0.2, 0.80), (0.15, 0.76), (0.4, 0.80), (0.47, 0.86))
    points = np.array([(x * h, 0, z * h) for x, z in trunk])
    girth = [0.05, 0.14, 0.15, 0.19, 0.17, 0.10]
    parts = [limb(points, [h * b * r for r in girth], coat, "cloth")]
    neck = np.array([(0.40 * h, 0, 0.86 * h), (0.58 * h, 0, 1.08 * h)])
    parts.append(limb(neck, [0.12 * h * b, 0.09 * h], coat, "cloth"))
    parts.append(ellipsoid((0.63 * h, 0, 1.12 * h), (0.15 * h, 0.11 * h, 0.11 * h), coat, "cloth"))
    nose = np.array([(0.70 * h, 0, 1.09 * h), (0.86 * h, 0, 1.05 * h)])
    parts.append(limb(nose, [0.065 * h, 0.04 * h], coat, "cloth", 6))
    for side in (1, -1):
        ear = np.array([(0.57 * h, 0.075 * side * h, 1.19 * h),
                        (0.55 * h, 0.11 * side * h, (1.19 + 0.13 * dog.ears) * h)])  # fmt: skip
        parts.append(limb(ear, [0.05 * h, 0.015 * h], coat, "cloth", 5))
        for leg_x, turn in ((0.34, dog.step * side), (-0.42, -dog.step * side)):
            hip = np.array([leg_x * h, 0.09 * side * h * b, 0.72 * h])
            foot = np.array([(leg_x + 0.6 * math.sin(turn)) * h, 0.09 * side * h * b, 0.03 * h])
            knee = (hip + foot) / 2 + [0.05 * h * (1 if leg_x > 0 else -1), 0, 0]
            radii = [0.09 * h, 0.05 * h, 0.04 * h]
            parts.append(limb([hip, knee, foot], radii, coat, "cloth", 6))
    tail = np.array([(-0.54 * h, 0, 0.86 * h), (-0.75 * h, 0, 1.0 * h), (-0.85 * h, 0, 1.2 * h)])
    parts.append(limb(tail, [0.045 * h, 0.03 * h, 0.015 * h], coat, "cloth", 5))
    body = merge(*parts)
    low = float(body.mesh.vertices[:, 2].min())
    return translate(body, (*dog.place, -low))


def _lead(dog: Dog) -> Asset:
    """Build a lead from the owner's hand to the dog's neck."""
    x, y = dog.place
    side = math.copysign(1.0, y)
    points = np.array([(0.05, 0.28 * side, 0.78), (0.5 * x, 0.5 * (y + 0.28 * side), 0.5),
                       (x + 0.5 * dog.height, y, 0.95 * dog.height)])  # fmt: skip
    return limb(points, [0.008, 0.008, 0.008], BLACK, "cloth", 4)


FAMILY = Family(
    "company", TrainId.PERSON, (*_SITTING, *_WALKING), sample_company, company,
    count=42, size=Size((0.4, 3), (0.6, 2.3)), tone=person.FAMILY.tone, line=None,
)  # fmt: skip
