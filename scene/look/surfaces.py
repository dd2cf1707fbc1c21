"""Surfaces of roads, sidewalks and the land next to them."""

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
    weight: float  # relative frequency in its table
    wear: float = 0.5  # age of the roads on which it is most frequent, 0 new .. 1 worn out


class Coat(NamedTuple):
    """The surface of one street."""

    name: str
    material: str
    color: Color


ROADS: tuple[Surface, ...] = (
    Surface("worn asphalt", "asphalt", (0.085, 0.086, 0.09), (0.15, 0.15, 0.152), 5, 0.5),
    Surface("fresh asphalt", "fresh asphalt", (0.035, 0.036, 0.039), (0.065, 0.066, 0.07), 3, 0.05),
    Surface(
        "patched asphalt", "patched asphalt", (0.075, 0.076, 0.08), (0.13, 0.13, 0.132), 3, 0.85
    ),
    Surface("tarred asphalt", "tarred asphalt", (0.055, 0.056, 0.06), (0.10, 0.10, 0.104), 2, 0.8),
    Surface("chippings", "chippings", (0.09, 0.086, 0.082), (0.16, 0.152, 0.142), 2),
    Surface("concrete slabs", "concrete road", (0.16, 0.155, 0.145), (0.26, 0.25, 0.235), 1),
    Surface("granite setts", "setts", (0.09, 0.088, 0.086), (0.17, 0.162, 0.152), 1),
    Surface("red asphalt", "asphalt", (0.10, 0.062, 0.052), (0.15, 0.088, 0.072), 0.7, 0.25),
)
"""Carriageways."""

SIDEWALKS: tuple[Surface, ...] = (
    Surface("large slabs", "paving", (0.13, 0.128, 0.12), (0.26, 0.25, 0.232), 4),
    Surface("flagstones", "flagstones", (0.14, 0.128, 0.105), (0.26, 0.235, 0.19), 2),
    Surface("brick pavers", "pavers", (0.13, 0.085, 0.065), (0.24, 0.15, 0.115), 1.5),
    Surface("grey pavers", "pavers", (0.12, 0.12, 0.118), (0.22, 0.22, 0.215), 2),
    Surface("herringbone brick", "herringbone", (0.14, 0.07, 0.05), (0.24, 0.12, 0.085), 1),
    Surface("concrete", "concrete", (0.16, 0.155, 0.145), (0.28, 0.27, 0.25), 2),
    Surface("cobbles", "cobbles", (0.09, 0.088, 0.084), (0.18, 0.172, 0.16), 0.7),
)
"""Footways other than asphalt."""

ASPHALT: tuple[Surface, ...] = (
    Surface("even asphalt", "fresh asphalt", (0.82, 0.76, 0.67), (1.38, 1.28, 1.13), 3),
    Surface("patched asphalt", "mended asphalt", (0.77, 0.72, 0.63), (1.33, 1.24, 1.09), 3),
    Surface("chippings", "fine chippings", (0.92, 0.86, 0.75), (1.47, 1.37, 1.2), 1),
)
"""Asphalt footways; their colours are factors on the road's grey."""

VERGES: tuple[Surface, ...] = (
    Surface("mown grass", "grass", (0.040, 0.075, 0.016), (0.075, 0.125, 0.03), 4),
    Surface("rank grass", "long grass", (0.05, 0.08, 0.02), (0.12, 0.135, 0.045), 3),
    Surface("dry grass", "grass", (0.11, 0.10, 0.045), (0.19, 0.165, 0.085), 1.5),
    Surface("worn grass", "bare patches", (0.075, 0.085, 0.032), (0.13, 0.125, 0.055), 2),
    Surface("earth", "earth", (0.08, 0.058, 0.042), (0.17, 0.125, 0.09), 0.5),
    Surface("gravel", "gravel", (0.13, 0.112, 0.085), (0.23, 0.20, 0.155), 0.3),
    Surface("leaves on grass", "fallen leaves", (0.085, 0.065, 0.025), (0.15, 0.105, 0.045), 0.5),
)
"""Strips along a sidewalk."""

FORECOURTS: tuple[Surface, ...] = (
    Surface("slabs", "paving", (0.13, 0.128, 0.12), (0.26, 0.25, 0.232), 3),
    Surface("flagstones", "flagstones", (0.14, 0.128, 0.105), (0.26, 0.235, 0.19), 1.5),
    Surface("pavers", "pavers", (0.12, 0.105, 0.09), (0.23, 0.20, 0.17), 2),
    Surface("concrete", "concrete", (0.15, 0.145, 0.135), (0.27, 0.26, 0.24), 2),
    Surface("setts", "setts", (0.09, 0.086, 0.08), (0.17, 0.16, 0.148), 1),
)
"""Paving between a sidewalk and houses, where it differs from the sidewalk."""

DRIVES: tuple[Surface, ...] = (
    Surface("asphalt", "fresh asphalt", (0.07, 0.07, 0.07), (0.15, 0.148, 0.145), 3),
    Surface("pavers", "pavers", (0.13, 0.10, 0.085), (0.23, 0.175, 0.145), 1.5),
    Surface("setts", "setts", (0.10, 0.096, 0.09), (0.18, 0.17, 0.16), 1),
)
"""Driveways over a sidewalk."""

DUST = (0.15, 0.128, 0.10)
"""Linear colour of dust along a kerb."""
AGES = 0.33
"""Standard deviation of a road's age around that of its surface."""

TERRAINS: tuple[Surface, ...] = (
    Surface("lawn", "grass", (0.040, 0.075, 0.016), (0.075, 0.125, 0.03), 4),
    Surface("long grass", "long grass", (0.05, 0.08, 0.02), (0.10, 0.13, 0.04), 3),
    Surface("earth", "earth", (0.09, 0.062, 0.042), (0.18, 0.13, 0.09), 1),
    Surface("dry grass", "grass", (0.12, 0.11, 0.045), (0.20, 0.175, 0.085), 2),
    Surface("fallen leaves", "fallen leaves", (0.09, 0.055, 0.022), (0.17, 0.10, 0.04), 1),
    Surface("gravel", "gravel", (0.17, 0.148, 0.112), (0.29, 0.255, 0.20), 0.5),
    Surface("meadow", "long grass", (0.09, 0.105, 0.03), (0.15, 0.16, 0.055), 2),
)
"""Land beyond the sidewalk."""


ROAD_TONE, SIDEWALK_TONE = 0.78, 0.66
"""Factors on the colours of roads and sidewalks; see ``tone`` in ``assets/family.py``."""


def sample_coat(
    rng: np.random.Generator,
    surfaces: tuple[Surface, ...],
    share: float = 1.0,
    tone: float = 1.0,
    wear: float | None = None,
) -> Coat:
    """Draw one of the first ``share`` of ``surfaces``, at least one, and its colour times ``tone``.

    With ``wear``, the age of a road in [0, 1], surfaces of about this age are more likely.
    """
    choices = surfaces[: max(1, round(share * len(surfaces)))]
    weights = np.array([s.weight for s in choices], float)
    if wear is not None:
        weights *= np.exp(-0.5 * (np.array([s.wear - wear for s in choices]) / AGES) ** 2)
    surface = choices[int(rng.choice(len(choices), p=weights / weights.sum()))]
    dark, light = np.array(surface.dark), np.array(surface.light)
    red, green, blue = tone * (dark + rng.random() * (light - dark)) * rng.uniform(0.97, 1.03, 3)
    return Coat(surface.name, surface.material, (float(red), float(green), float(blue)))


def grey(color: tuple[float, float, float]) -> float:
    """The luminance of a linear colour."""
    return float(np.dot(color, (0.3, 0.59, 0.11)))


def asphalt_beside(rng: np.random.Generator, road: Coat) -> Coat:
    """Draw an asphalt sidewalk about as dark as a road."""
    return sample_coat(rng, ASPHALT, tone=grey(road.color))
