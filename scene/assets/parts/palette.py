"""Colours that things share, as linear albedos, and how to draw from a few of them."""

from __future__ import annotations

import numpy as np

from scene.mesh.asset import Color, vary

BLACK: Color = (0.02, 0.02, 0.02)
TRIM: Color = (0.035, 0.035, 0.037)
TYRE: Color = (0.02, 0.02, 0.021)
GLASS: Color = (0.022, 0.027, 0.03)
STEEL: Color = (0.30, 0.30, 0.31)
HEADLAMP: Color = (0.75, 0.76, 0.74)
TAILLAMP: Color = (0.30, 0.012, 0.012)
PLATE: Color = (0.68, 0.68, 0.64)
PLATE_REAR: Color = (0.62, 0.42, 0.03)
CHROME: Color = (0.42, 0.43, 0.44)
AMBER: Color = (0.65, 0.22, 0.02)
WHITE: Color = (0.62, 0.62, 0.60)
GALVANISED: Color = (0.20, 0.205, 0.21)
BRICK: Color = (0.17, 0.085, 0.06)
PALE_STONE: Color = (0.30, 0.29, 0.27)
BOARDS: Color = (0.20, 0.145, 0.085)

# Share of cars by colour, and its linear albedo: between the new ones of the 2020s (BASF and Axalta report
# half of them black, white or grey) and those on the roads twenty years before, of which more were silver,
# blue, red or green.
_CAR_PAINTS: tuple[tuple[float, Color], ...] = (
    (0.19, (0.010, 0.010, 0.012)),  # black
    (0.13, (0.055, 0.058, 0.062)),  # dark grey
    (0.09, (0.17, 0.175, 0.18)),  # grey
    (0.18, (0.40, 0.41, 0.42)),  # silver
    (0.17, (0.72, 0.72, 0.70)),  # white
    (0.08, (0.014, 0.028, 0.085)),  # dark blue
    (0.03, (0.045, 0.12, 0.28)),  # light blue
    (0.05, (0.27, 0.018, 0.018)),  # red
    (0.02, (0.085, 0.012, 0.014)),  # dark red
    (0.02, (0.014, 0.050, 0.030)),  # green
    (0.03, (0.30, 0.26, 0.19)),  # beige
    (0.01, (0.50, 0.32, 0.025)),  # yellow
)


def pick(rng: np.random.Generator, colors: tuple[Color, ...], spread: float = 0.15) -> Color:
    """One of ``colors``, each as likely, and a colour near it."""
    return vary(rng, colors[rng.integers(len(colors))], spread)


def car_paint(rng: np.random.Generator) -> Color:
    """A paint drawn as often as cars wear it."""
    shares = np.array([share for share, _ in _CAR_PAINTS])
    return vary(rng, _CAR_PAINTS[rng.choice(len(shares), p=shares / shares.sum())][1])


def darker(color: Color, share: float = 0.6) -> Color:
    """``share`` of a colour."""
    return share * color[0], share * color[1], share * color[2]
