"""Colours that several assets share, as linear albedos, and functions that pick one of a few."""

from __future__ import annotations

import numpy as np

from scene.mesh.asset import Color, vary

# Used all over.
BLACK: Color = (0.02, 0.02, 0.02)
ANTHRACITE: Color = (0.03, 0.032, 0.035)
WHITE: Color = (0.62, 0.62, 0.60)
OFF_WHITE: Color = (0.60, 0.60, 0.58)
BRIGHT_WHITE: Color = (0.72, 0.72, 0.70)
STEEL: Color = (0.30, 0.30, 0.31)
GALVANISED: Color = (0.20, 0.205, 0.21)
GOLD: Color = (0.35, 0.24, 0.06)
AMBER: Color = (0.65, 0.22, 0.02)

# Vehicles.
TRIM: Color = (0.035, 0.035, 0.037)  # bare plastic
TYRE: Color = (0.02, 0.02, 0.021)
GLASS: Color = (0.022, 0.027, 0.03)
CHROME: Color = (0.42, 0.43, 0.44)
PLATE: Color = (0.68, 0.68, 0.64)
PLATE_YELLOW: Color = (0.62, 0.42, 0.03)  # rear number plates in Britain, and beacons
BLACK_PAINT: Color = (0.018, 0.018, 0.02)  # of cars, motorcycles and shop fronts
SILVER: Color = (0.30, 0.31, 0.32)
VAN_WHITE: Color = (0.64, 0.64, 0.62)
DUST: Color = (0.085, 0.078, 0.068)  # of the road, on the sills of cars

# Lamps, and the lights of vehicles and signals.
GLOW: Color = (0.62, 0.60, 0.52)  # glass of a lamp by day
HEADLAMP: Color = (0.75, 0.76, 0.74)
TAILLAMP: Color = (0.30, 0.012, 0.012)
LENS: Color = (0.24, 0.25, 0.26)
TAILLAMP_LENS: Color = (0.46, 0.016, 0.014)
REFLECTOR: Color = (0.88, 0.88, 0.86)
LIGHT_RED: Color = (0.95, 0.05, 0.03)
LIGHT_AMBER: Color = (0.98, 0.45, 0.03)
LIGHT_GREEN: Color = (0.05, 0.95, 0.45)
LIGHT_WHITE: Color = (0.95, 0.95, 0.92)

# Buildings, walls and the ground.
BRICK: Color = (0.17, 0.085, 0.06)
YELLOW_BRICK: Color = (0.27, 0.22, 0.15)
PALE_STONE: Color = (0.30, 0.29, 0.27)
RUBBLE: Color = (0.24, 0.22, 0.18)
CREAM_RENDER: Color = (0.52, 0.49, 0.43)
PANEL_CONCRETE: Color = (0.25, 0.245, 0.235)
WINDOW: Color = (0.012, 0.014, 0.016)
GUTTER: Color = (0.03, 0.03, 0.03)
RAILING_IRON: Color = (0.016, 0.017, 0.019)
SCAFFOLD_STEEL: Color = (0.24, 0.245, 0.25)
BOARDS: Color = (0.20, 0.145, 0.085)
IVY: Color = (0.052, 0.070, 0.036)
GRAVEL: Color = (0.16, 0.13, 0.10)

# Street furniture.
SIGNAL_BLACK: Color = (0.012, 0.013, 0.014)
SIGNAL_YELLOW: Color = (0.55, 0.33, 0.02)
LAMP_IRON: Color = (0.018, 0.019, 0.021)
LAMP_STEEL: Color = (0.055, 0.058, 0.060)
LAMP_GREEN: Color = (0.012, 0.045, 0.028)
LAMP_CONCRETE: Color = (0.24, 0.23, 0.21)
LAMP_TIMBER: Color = (0.075, 0.052, 0.036)
POST_BLACK: Color = (0.016, 0.017, 0.018)
POST_STEEL: Color = (0.09, 0.093, 0.096)
POST_GREY: Color = (0.055, 0.058, 0.062)
POST_GREEN: Color = (0.012, 0.05, 0.028)
POST_RED: Color = (0.42, 0.025, 0.02)
POST_YELLOW: Color = (0.58, 0.36, 0.02)
POST_TIMBER: Color = (0.10, 0.068, 0.042)
BOLLARD_RED: Color = (0.42, 0.03, 0.025)
BOLLARD_BLUE: Color = (0.02, 0.08, 0.32)
FENCE_BLACK: Color = (0.014, 0.015, 0.016)
FENCE_GREEN: Color = (0.010, 0.040, 0.024)
FENCE_WHITE: Color = (0.62, 0.62, 0.59)
FENCE_TIMBER: Color = (0.13, 0.085, 0.05)
WEATHERED_TIMBER: Color = (0.16, 0.14, 0.115)
SHELTER_WHITE: Color = (0.55, 0.55, 0.52)
SHELTER_TIMBER: Color = (0.14, 0.095, 0.06)
SLAB_WHITE: Color = (0.56, 0.56, 0.53)  # road paint

# What people wear and carry.
WHITE_SOLE: Color = (0.55, 0.55, 0.53)
REFLECTING: Color = (0.62, 0.63, 0.62)
WICKER: Color = (0.10, 0.065, 0.035)

# Share of cars by colour, and its linear albedo. The shares are between those of new cars in the 2020s (by
# Axalta, half of them are black, white or grey) and those of cars on the roads twenty years earlier, more of
# which were silver, blue, red or green.
_CAR_PAINTS: tuple[tuple[float, Color], ...] = (
    (0.19, (0.010, 0.010, 0.012)),  # black
    (0.13, (0.055, 0.058, 0.062)),  # dark grey
    (0.09, (0.17, 0.175, 0.18)),  # grey
    (0.18, (0.40, 0.41, 0.42)),  # silver
    (0.17, BRIGHT_WHITE),  # white
    (0.08, (0.014, 0.028, 0.085)),  # dark blue
    (0.03, (0.045, 0.12, 0.28)),  # light blue
    (0.05, (0.27, 0.018, 0.018)),  # red
    (0.02, (0.085, 0.012, 0.014)),  # dark red
    (0.02, (0.014, 0.050, 0.030)),  # green
    (0.03, (0.30, 0.26, 0.19)),  # beige
    (0.01, (0.50, 0.32, 0.025)),  # yellow
)


def pick(rng: np.random.Generator, colors: tuple[Color, ...], spread: float = 0.15) -> Color:
    """Pick one of ``colors`` at random and return a colour near it."""
    return vary(rng, colors[rng.integers(len(colors))], spread)


def car_paint(rng: np.random.Generator) -> Color:
    """Draw a car's paint, each colour as often as it is seen on roads."""
    shares = np.array([share for share, _ in _CAR_PAINTS])
    return vary(rng, _CAR_PAINTS[rng.choice(len(shares), p=shares / shares.sum())][1])


def blend(one: Color, other: Color, share: float) -> Color:
    """Return a colour ``share`` of the way from one to the other."""
    red, green, blue = ((1 - share) * x + share * y for x, y in zip(one, other, strict=True))
    return red, green, blue


def darker(color: Color, share: float = 0.6) -> Color:
    """Return a colour at ``share`` of its brightness."""
    return share * color[0], share * color[1], share * color[2]
