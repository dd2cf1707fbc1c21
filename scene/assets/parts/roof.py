"""Roofs, chimneys and towers of buildings; x from -width / 2 to width / 2, y from 0 to depth."""

from __future__ import annotations

from itertools import product

from scene.assets.parts.facade import Finish, upright
from scene.assets.parts.palette import GUTTER, WINDOW
from scene.mesh.asset import Asset, Color, Parts, Point, merge, translate
from scene.mesh.solids import block, box, polygon, tube

OVERHANG = 0.35
"""Overhang of a pitched roof beyond the walls (metres)."""


def pitched_roof(
    plan: tuple[float, float], eaves: float, rise: float, style: str, color: Color, end: Finish
) -> Parts:
    """Build two slopes and two ends around a ridge.

    Args:
        plan: width (x) and depth (y), metres.
        eaves: height of the walls, metres.
        rise: height of the ridge above the walls, metres.
        style: "gable" (ridge along x), "front gable" (along y) or "hip" (along x, ends sloping).
        color: of the roof.
        end: colour and material of a gable's wall.
    """
    along_y, hipped = style == "front gable", style == "hip"
    length, span = reversed(plan) if along_y else plan
    reach, half = length / 2 + OVERHANG, span / 2 + OVERHANG
    low = eaves - rise * OVERHANG / (span / 2)  # the slopes continue beyond the walls
    top = eaves + rise
    inset = min(span / 2, 0.4 * length) if hipped else 0.0

    def at(along: float, across: float, z: float) -> Point:
        """Convert from coordinates along and across the ridge."""
        x, y = (across, along) if along_y else (along, across)
        return x, y + plan[1] / 2, z

    ridge = [at(s * (reach - inset), 0, top) for s in (-1, 1)]
    for y in (-half, half):
        yield polygon([at(-reach, y, low), at(reach, y, low), *ridge[::-1]], color, "roof")
    gable = [(-span / 2, eaves), (span / 2, eaves), (0.0, top)]
    for s, peak in zip((-1, 1), ridge, strict=True):
        if hipped:
            foot = [at(s * reach, y, low) for y in (-half, half)]
            yield polygon([*foot, peak], color, "roof")
        else:
            yield polygon([at(s * length / 2, y, z) for y, z in gable], *end)
    if not along_y:
        for y in (plan[1] / 2 - half, plan[1] / 2 + half):
            yield block((-reach, y - 0.07, low - 0.16), (reach, y + 0.07, low + 0.02), GUTTER)


def flat_roof(
    plan: tuple[float, float], eaves: float, rise: float, cornice: Color, parapet: Finish
) -> Parts:
    """Build a parapet on a cornice that protrudes by 15 cm."""
    (width, depth), ledge = plan, 0.2
    yield box((width + 0.3, depth + 0.3, ledge), (0, depth / 2, eaves), cornice, "concrete")
    yield box((width, depth, rise - ledge), (0, depth / 2, eaves + ledge), *parapet)


def chimney(base: Point, height: float, color: Color) -> Asset:
    """Build a stack of bricks with two pots."""
    stack = box((0.9, 0.7, height), (0, 0, 0), color, "brick")
    pots = [
        tube((x, 0, height), (x, 0, height + 0.4), 0.13, (0.3, 0.12, 0.06), "brick", sides=4)
        for x in (-0.22, 0.22)
    ]
    return translate(merge(stack, *pots), base)


def dormer(x: float, slope: tuple[float, float], frame: Color, color: Color) -> Parts:
    """Build a window under a small gable in the front slope.

    Args:
        x: of its middle (metres).
        slope: distance behind the facade and height of the foot of its front (metres).
        frame: colour of its face.
        color: of its sides and roof.
    """
    y, foot = slope
    half, wall, back = 0.65, 1.15, 2.2
    yield block((x - half, y, foot - 0.3), (x + half, y + back, foot + wall), color, "roof")
    yield polygon(upright(x - half, x + half, foot - 0.3, foot + wall, y - 0.04), frame, "paint")
    for a, b in ((x - 0.48, x - 0.04), (x + 0.04, x + 0.48)):
        yield polygon(upright(a, b, foot + 0.15, foot + wall - 0.1, y - 0.08), WINDOW, "glass")
    top, eave, front = foot + wall + 0.6, foot + wall - 0.05, y - 0.25
    for s in (-1, 1):
        edge = x + s * (half + 0.15)
        roof = [(edge, front, eave), (x, front, top), (x, y + back, top), (edge, y + back, eave)]
        yield polygon(roof, color, "roof")
    gable = [(x - half, y - 0.04, eave), (x + half, y - 0.04, eave), (x, y - 0.04, top - 0.05)]
    yield polygon(gable, frame, "paint")


def steeple(
    centre: tuple[float, float], side: float, height: float, spire: float,
    wall: Finish, color: Color,
) -> Parts:  # fmt: skip
    """Build a square tower with bell openings and battlements, and a spire if ``spire`` is above 0."""
    (x, y), half = centre, side / 2
    yield box((side, side, height), (x, y, 0), *wall)
    low, high = height - 3.0, height - 0.9
    for level, tall in ((low, high - low), (0.45 * height, 1.6)):
        bell = upright(x - 0.16 * side, x + 0.16 * side, level, level + tall, y - half - 0.04)
        yield polygon(bell, WINDOW, "plain")
    for z in (0.4 * height, height - 0.5):
        yield box((side + 0.25, side + 0.25, 0.2), (x, y, z), *wall)
    inset = half - 0.25
    for dx, dy in product((-inset, inset), repeat=2):
        yield box((0.45, 0.45, 1.0), (x + dx, y + dy, height), *wall)
    if spire:
        ends = (x, y, height), (x, y, height + spire)
        yield tube(*ends, 0.62 * side, color, "roof", end_radius=0.02, sides=8, caps=False)


def plant_room(plan: tuple[float, float], base: float, color: Color) -> Parts:
    """Build the machinery on a flat roof: a lift room, a cooler, a pipe."""
    width, depth = plan
    yield box((0.35 * width, 0.35 * depth, 1.9), (0.12 * width, 0.55 * depth, base), color, "metal")
    yield box((1.3, 1.0, 1.0), (-0.28 * width, 0.35 * depth, base), (0.3, 0.3, 0.3), "metal")
    x, y = -0.1 * width, 0.5 * depth
    yield tube((x, y, base), (x, y, base + 2.4), 0.1, GUTTER)
