"""Rows along a roadside: panels end to end, and tiles side by side."""

from __future__ import annotations

import math

from scene.assets import catalogue
from scene.street.instances import length
from scene.street.lines import LAP
from scene.street.parked import clear
from scene.street.plot import TOUCHING, Plot


def facing_road(side: float) -> float:
    """The yaw of objects on a side that face the road."""
    return 0.0 if side > 0 else math.pi


def run(
    plot: Plot,
    family: str,
    ref: int | str | None,
    y: float,
    span: tuple[float, float],
    closed: list[tuple[float, float]],
) -> int:
    """Place panels of one kind end to end along the road, with gaps at ``closed``; returns their count.

    Args:
        plot: the street.
        family: family of the panels: fences, walls, hedges.
        ref: the panel.
        y: metres left of the centre line.
        span: start and end, metres along the road.
        closed: stretches without panels, start and end.
    """
    if ref is None:
        return 0
    pitch = length(family, ref) - LAP
    count = 0
    for k in range(int((span[1] - span[0]) / pitch)):
        x = span[0] + (k + 0.5) * pitch
        if clear(closed, x - pitch / 2, x + pitch / 2):
            yaw = facing_road(math.copysign(1, y))
            count += plot.put(family, ref, x, y, yaw, spare=TOUCHING)
    return count


def carpet(
    plot: Plot,
    family: str,
    ref: int | str | None,
    x: tuple[float, float],
    y: tuple[float, float],
    side: float,
) -> None:
    """Lay tiles of one kind over a rectangle, in metres along the road and from the centre line.

    The last tiles may extend further; side streets stay free.
    """
    if ref is None:
        return
    low, high = catalogue.bounds(family, ref)
    mouths = [(a - 3.5, a + 3.5) for a, s in plot.ground.side_streets if s == side]
    long, wide = 0.998 * (high - low)[:2]
    for row in range(math.ceil((y[1] - y[0]) / wide)):
        distance = y[0] + (row + 0.5) * wide
        # In a bend, lines along the road are longer or shorter than the road.
        pitch = long / (1 + distance * plot.street.params.bend / 1000)
        for k in range(math.ceil((x[1] - x[0]) / pitch)):
            place = x[0] + (k + 0.5) * pitch
            if clear(mouths, place - pitch / 2, place + pitch / 2):
                plot.lay(family, ref, float(place), float(side * distance), 0.0)
