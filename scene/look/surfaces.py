"""What roads, sidewalks and the land beside them are made of: eight surfaces each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

Color = tuple[float, float, float]


class Surface(NamedTuple):
    """One kind of ground: its material and the range its colour (linear RGB) is drawn from."""

    name: str
    material: str
    dark: Color
    light: Color
    weight: float  # how often it is met, beside the others of its table


class Coat(NamedTuple):
    """The surface of one street."""

    name: str
    material: str
    color: Color


ROADS: tuple[Surface, ...] = (
    Surface("worn asphalt", "asphalt", (0.085, 0.086, 0.09), (0.15, 0.15, 0.152), 5),
    Surface("fresh asphalt", "fresh asphalt", (0.035, 0.036, 0.039), (0.065, 0.066, 0.07), 3),
    Surface("patched asphalt", "patched asphalt", (0.075, 0.076, 0.08), (0.13, 0.13, 0.132), 3),
    Surface("tarred asphalt", "tarred asphalt", (0.055, 0.056, 0.06), (0.10, 0.10, 0.104), 2),
    Surface("chippings", "chippings", (0.09, 0.086, 0.082), (0.16, 0.152, 0.142), 2),
    Surface("concrete slabs", "concrete road", (0.16, 0.155, 0.145), (0.26, 0.25, 0.235), 1),
    Surface("granite setts", "setts", (0.09, 0.088, 0.086), (0.17, 0.162, 0.152), 1),
    Surface("red asphalt", "asphalt", (0.10, 0.062, 0.052), (0.15, 0.088, 0.072), 0.7),
)
"""Carriageways."""

SIDEWALKS: tuple[Surface, ...] = (
    Surface("large slabs", "paving", (0.13, 0.128, 0.12), (0.26, 0.25, 0.232), 4),
    Surface("asphalt", "fresh asphalt", (0.06, 0.06, 0.062), (0.12, 0.12, 0.12), 3),
    Surface("flagstones", "flagstones", (0.14, 0.128, 0.105), (0.26, 0.235, 0.19), 2),
    Surface("brick pavers", "pavers", (0.13, 0.085, 0.065), (0.24, 0.15, 0.115), 1.5),
    Surface("grey pavers", "pavers", (0.12, 0.12, 0.118), (0.22, 0.22, 0.215), 2),
    Surface("herringbone brick", "herringbone", (0.14, 0.07, 0.05), (0.24, 0.12, 0.085), 1),
    Surface("concrete", "concrete", (0.16, 0.155, 0.145), (0.28, 0.27, 0.25), 2),
    Surface("cobbles", "cobbles", (0.09, 0.088, 0.084), (0.18, 0.172, 0.16), 0.7),
)
"""Footways."""

TERRAINS: tuple[Surface, ...] = (
    Surface("lawn", "grass", (0.040, 0.075, 0.016), (0.075, 0.125, 0.03), 4),
    Surface("long grass", "long grass", (0.05, 0.08, 0.02), (0.10, 0.13, 0.04), 3),
    Surface("earth", "earth", (0.09, 0.062, 0.042), (0.18, 0.13, 0.09), 1),
    Surface("dry grass", "grass", (0.12, 0.11, 0.045), (0.20, 0.175, 0.085), 2),
    Surface("fallen leaves", "fallen leaves", (0.09, 0.055, 0.022), (0.17, 0.10, 0.04), 1),
    Surface("gravel", "gravel", (0.16, 0.148, 0.125), (0.28, 0.26, 0.22), 1),
    Surface("meadow", "long grass", (0.09, 0.105, 0.03), (0.15, 0.16, 0.055), 2),
    Surface("plaza", "pavers", (0.15, 0.14, 0.125), (0.26, 0.245, 0.215), 1),
)
"""What lies beyond the sidewalk."""


ROAD_TONE, SIDEWALK_TONE = 0.78, 0.66
"""Factors on the colours of roads and sidewalks; see ``tone`` in ``assets/family.py``."""


def sample_coat(
    rng: np.random.Generator, surfaces: tuple[Surface, ...], share: float = 1.0, tone: float = 1.0
) -> Coat:
    """Draw one of the first ``share`` of ``surfaces``, at least one, and its colour times ``tone``."""
    known = surfaces[: max(1, round(share * len(surfaces)))]
    weights = np.array([s.weight for s in known])
    surface = known[int(rng.choice(len(known), p=weights / weights.sum()))]
    dark, light = np.array(surface.dark), np.array(surface.light)
    red, green, blue = tone * (dark + rng.random() * (light - dark)) * rng.uniform(0.97, 1.03, 3)
    return Coat(surface.name, surface.material, (float(red), float(green), float(blue)))
