"""Roofs over a rectangular plan: x from -width / 2 to width / 2, y from 0 to depth."""

from __future__ import annotations

from scene.asset import Asset, Color, Point, box, merge, polygon, translate, tube

OVERHANG = 0.35
"""How far a pitched roof reaches beyond the walls (metres)."""


def pitched(
    plan: tuple[float, float],
    eaves: float,
    rise: float,
    style: str,
    color: Color,
    end: tuple[Color, str],
) -> Asset:
    """Two slopes and two ends about a ridge.

    Args:
        plan: width (x) and depth (y), metres.
        eaves: height of the walls, metres.
        rise: of the ridge above them, metres.
        style: "gable" (ridge along x), "front gable" (along y) or "hip" (along x, ends sloping).
        color: of the roof.
        end: colour and material of the walls, which close a gable.
    """
    along_y, hipped = style == "front gable", style == "hip"
    length, span = reversed(plan) if along_y else plan
    reach, half = length / 2 + OVERHANG, span / 2 + OVERHANG
    low = eaves - rise * OVERHANG / (span / 2)  # the slopes go on beyond the walls
    top = eaves + rise
    inset = min(span / 2, 0.4 * length) if hipped else 0.0

    def at(along: float, across: float, z: float) -> Point:
        """From (along the ridge, across it) to (x, y)."""
        x, y = (across, along) if along_y else (along, across)
        return x, y + plan[1] / 2, z

    ridge = [at(s * (reach - inset), 0, top) for s in (-1, 1)]
    slopes = [
        polygon([at(-reach, s * half, low), at(reach, s * half, low), *ridge[::-1]], color, "roof")
        for s in (-1, 1)
    ]
    if hipped:
        ends = [
            polygon([at(s * reach, -half, low), at(s * reach, half, low), peak], color, "roof")
            for s, peak in zip((-1, 1), ridge, strict=True)
        ]
    else:
        gable = [(-span / 2, eaves), (span / 2, eaves), (0.0, top)]
        ends = [polygon([at(s * length / 2, v, z) for v, z in gable], *end) for s in (-1, 1)]
    return merge(*slopes, *ends)


def flat(
    plan: tuple[float, float], eaves: float, rise: float, cornice: Color, parapet: tuple[Color, str]
) -> Asset:
    """A parapet on a cornice that stands out by 15 cm."""
    width, depth = plan
    ledge = 0.2
    return merge(
        box((width + 0.3, depth + 0.3, ledge), (0, depth / 2, eaves), cornice, "concrete"),
        box((width, depth, rise - ledge), (0, depth / 2, eaves + ledge), *parapet),
    )


def chimney(base: Point, height: float, color: Color) -> Asset:
    """A stack of bricks with two pots."""
    stack = box((0.9, 0.7, height), (0, 0, 0), color, "brick")
    pots = [
        tube((x, 0, height), (x, 0, height + 0.4), 0.13, (0.3, 0.12, 0.06), "brick", sides=4)
        for x in (-0.22, 0.22)
    ]
    return translate(merge(stack, *pots), base)
