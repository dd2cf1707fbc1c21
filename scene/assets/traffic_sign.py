"""Traffic sign plates that hang on a signpost at x = y = 0 and face the camera (-x).

A plate is a stack of convex shapes, each a little nearer to the camera: border, field, symbol.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.family import SIGN, Family, Size
from scene.assets.parts.palette import BLACK, BRIGHT_WHITE, GALVANISED
from scene.assets.parts.pictogram import Layer
from scene.assets.parts.sign_boards import Inks
from scene.assets.parts.sign_faces import FACES
from scene.assets.parts.skin import in_plane
from scene.assets.signpost import MAX_RADIUS, MIN_HEIGHT
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Parts, Point, merge, vary
from scene.mesh.solids import box, loft, polygon

LAYER = 0.006
"""Distance between the layers of a plate (metres)."""
LOWEST, HIGHEST = 1.25, 3.05
"""Lowest and highest point of a plate (metres)."""


class TrafficSignParams(NamedTuple):
    """A plate of several layers, and optionally a small plate below it."""

    centre: float  # height of the plate's centre, m
    radius: float  # size of the plate, m; its outlines are in this unit
    layers: tuple[Layer, ...]  # the first is the whole plate
    supplement: Color | None  # colour of the small plate below; None without one
    back: Color


def sample_traffic_sign(rng: np.random.Generator, kind: str) -> TrafficSignParams:
    """Draw a sign of one kind."""
    face = FACES[kind]
    layers = face.draw(Inks.sample(rng), rng)
    radius = float(rng.uniform(0.30, 0.44)) * face.size
    high = max(v for _, v in layers[0].outline) * radius
    low = min(v for _, v in layers[0].outline) * radius
    # The plate must be within reach of the shortest post.
    centre = float(rng.uniform(2.1, MIN_HEIGHT - 0.05))
    centre = float(np.clip(centre, LOWEST + 0.3 - low, HIGHEST - high))
    supplements = (None, None, BRIGHT_WHITE, (0.60, 0.36, 0.02), (0.015, 0.07, 0.30))
    below = supplements[rng.integers(len(supplements))] if face.supplement else None
    return TrafficSignParams(centre, radius, layers, below, vary(rng, GALVANISED, 0.2))


def _face(layer: Layer, p: TrafficSignParams, x: float) -> Asset:
    """Build a layer in the plane ``x``; the viewer's right is -y."""
    corners: list[Point] = [(x, -u * p.radius, p.centre + v * p.radius) for u, v in layer.outline]
    return polygon(corners, layer.color, "paint")


def _supplement(p: TrafficSignParams, color: Color, x: float, top: float) -> Parts:
    """Build a small plate with two rows of print."""
    r, is_dark = p.radius, max(color) < 0.5
    ink = (0.7, 0.7, 0.68) if is_dark else BLACK
    yield box((LAYER, 1.3 * r, 0.5 * r), (x, 0, top - 0.5 * r), color, "paint")
    for width, low in ((1.0, 0.22), (0.7, 0.40)):
        yield box((LAYER, width * r, 0.09 * r), (x - LAYER, 0, top - low * r), ink, "paint")


def traffic_sign(p: TrafficSignParams) -> Asset:
    """Build the sign."""
    back, plate = -MAX_RADIUS - LAYER, p.layers[0]
    faces = [_face(layer, p, back - LAYER * (layer.level + 1)) for layer in p.layers]
    rear = _face(Layer(plate.outline, p.back), p, back)
    outline = np.array([(-u * p.radius, p.centre + v * p.radius) for u, v in plate.outline])
    rim = [in_plane(x, outline) for x in (back, back - LAYER)]
    edge = loft(np.array(rim), p.back, "metal", caps=False)
    low, high = outline[:, 1].min(), outline[:, 1].max()
    width = 0.35 * float(np.ptp(outline[:, 0]))
    rails = [
        box((0.02, width, 0.035), (back + 0.004, 0, low + share * (high - low)), p.back, "metal")
        for share in (0.3, 0.65)
    ]
    extra = _supplement(p, p.supplement, back, low - 0.03) if p.supplement else []
    return merge(rear, *faces, edge, *rails, *extra)


FAMILY = Family(
    "traffic sign", TrainId.TRAFFIC_SIGN, tuple(FACES), sample_traffic_sign, traffic_sign,
    count=40, size=Size((0.2, 8), (0.15, 8)), tone=1.7, line=("pole", 0.35),
    facing="camera", front="back", stage=SIGN, mounted_on="signpost",
)  # fmt: skip
