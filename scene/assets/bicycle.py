"""Bicycles: two wheels with thin spokes, a frame of tubes, handlebar, saddle and pedals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, Point, block, merge, polygon, ring
from scene.assets._palette import BLACK, HEADLAMP, STEEL, TAILLAMP, TYRE, pick
from scene.assets._vehicle import card, circle, mudguard, rod

SADDLE: Point = (-0.28, 0.0, 0.95)
"""Top of the saddle, m."""
BAR: Point = (0.30, 0.25, 1.00)
"""Left grip, m; the right one is its mirror image."""
CRANK: Point = (-0.08, 0.0, 0.29)
"""Middle of the crank, m."""
CRANK_LENGTH = 0.17
"""From the crank's middle to a pedal, m; the left pedal is down and forward."""
CRANK_ANGLE = -1.2
"""Of the left pedal, radians up from straight ahead."""
PEDAL_Y = 0.13
"""Of the left pedal, m."""


class BicycleParams(NamedTuple):
    """One bicycle; metres."""

    wheel_radius: float
    tyre: float  # thickness
    wheelbase: float
    tube: float  # radius of the frame's tubes
    step: float  # how far the top tube drops at its rear end
    bar: str  # "flat", "swept" or "drop"
    mudguards: bool
    basket: bool
    rack: bool
    color: Color = (0.02, 0.02, 0.02)
    tyre_color: Color = TYRE
    saddle_color: Color = BLACK


_MODELS: dict[str, BicycleParams] = {
    "city": BicycleParams(0.345, 0.040, 1.08, 0.018, 0.05, "swept", True, False, True),
    "racing": BicycleParams(0.340, 0.034, 1.00, 0.017, 0.02, "drop", False, False, False),
    "mountain": BicycleParams(0.350, 0.052, 1.10, 0.024, 0.16, "flat", False, False, False),
    "step-through": BicycleParams(0.340, 0.042, 1.10, 0.020, 0.42, "swept", True, True, True),
}
KINDS: tuple[str, ...] = tuple(_MODELS)
"""Frame types."""

_PAINTS: tuple[Color, ...] = (
    BLACK,
    (0.05, 0.05, 0.055),
    (0.33, 0.02, 0.02),
    (0.03, 0.09, 0.26),
    (0.03, 0.14, 0.07),
    (0.30, 0.31, 0.32),
    (0.62, 0.62, 0.60),
    (0.42, 0.20, 0.02),
    (0.10, 0.28, 0.30),
)
_WICKER: Color = (0.10, 0.065, 0.035)
_SADDLES: tuple[Color, ...] = (BLACK, (0.12, 0.06, 0.03))


def sample_bicycle(rng: np.random.Generator, kind: str) -> BicycleParams:
    """Draw a bicycle of one frame type: wheel size, paint, basket and rack."""
    model = _MODELS[kind]
    return model._replace(
        wheel_radius=model.wheel_radius * rng.uniform(0.96, 1.02),
        wheelbase=model.wheelbase * rng.uniform(0.98, 1.02),
        tyre=model.tyre * rng.uniform(1.0, 1.1),
        basket=model.basket and bool(rng.random() < 0.7),
        rack=model.rack and bool(rng.random() < 0.8),
        color=pick(rng, _PAINTS, 0.25),
        saddle_color=pick(rng, _SADDLES),
    )


def bicycle(params: BicycleParams) -> Asset:
    """The bicycle of ``params``, rolling towards +x."""
    p = params
    parts = [_wheel(p, x) for x in (-p.wheelbase / 2, p.wheelbase / 2)]
    return merge(*parts, *_frame(p), *_handlebar(p), *_drive(p), *_fittings(p))


def _wheel(p: BicycleParams, x: float) -> Asset:
    """Tyre, bright spokes as crossed blades, and the hub."""
    hub = (x, 0.0, p.wheel_radius)
    radius = p.wheel_radius - p.tyre / 2
    parts = [ring(hub, radius, p.tyre, p.tyre_color, "rubber", sides=12)]
    for angle in np.arange(3) * np.pi / 3 + 0.3:
        along = radius * np.array([np.cos(angle), 0, np.sin(angle)])
        across = 0.005 * np.array([-np.sin(angle), 0, np.cos(angle)])
        corners = [along - across, along + across, -along + across, -along - across]
        parts.append(polygon(np.array(corners) + hub, STEEL, "metal"))
    return merge(*parts)


def _steering(p: BicycleParams) -> tuple[Point, Point, Point]:
    """Front hub, foot of the head tube and its top, on one line."""
    hub = (p.wheelbase / 2, 0.0, p.wheel_radius)
    foot = (hub[0] - 0.13, 0.0, p.wheel_radius * 2 + 0.04)
    return hub, foot, (foot[0] - 0.06, 0.0, foot[2] + 0.17)


def _frame(p: BicycleParams) -> list[Asset]:
    """The diamond: down, top and seat tube, stays and fork."""
    hub, foot, head = _steering(p)
    seat = _on_seat_tube(0.80)
    joint = _on_seat_tube(0.80 - 1.2 * p.step)
    front = head if p.step < 0.3 else foot
    parts = [
        rod(CRANK, foot, 1.15 * p.tube, p.color, "paint"),
        rod(joint, (front[0], 0.0, front[2] - 0.02), p.tube, p.color, "paint"),
        rod(CRANK, seat, p.tube, p.color, "paint"),
        rod(seat, SADDLE, 0.8 * p.tube, STEEL),
        rod(foot, head, 1.2 * p.tube, p.color, "paint"),
    ]
    for y in (p.tyre / 2 + 0.02, -p.tyre / 2 - 0.02):
        rear = (-p.wheelbase / 2, y, p.wheel_radius)
        parts += [
            rod((CRANK[0], 0.6 * y, CRANK[2]), rear, 0.7 * p.tube, p.color, "paint"),
            rod((seat[0], 0.6 * y, seat[2] - 0.04), rear, 0.6 * p.tube, p.color, "paint"),
            rod((foot[0], y, foot[2]), (hub[0], y, hub[2]), 0.7 * p.tube, p.color, "paint"),
        ]
    return parts


def _on_seat_tube(share: float) -> Point:
    """The point at ``share`` of the way from the crank to the saddle."""
    (x0, y0, z0), (x1, y1, z1) = CRANK, SADDLE
    return x0 + share * (x1 - x0), y0 + share * (y1 - y0), z0 + share * (z1 - z0)


def _handlebar(p: BicycleParams) -> list[Asset]:
    """Stem, bar and grips; the hands hold it at ``BAR``."""
    _, _, head = _steering(p)
    x, y, z = BAR
    clamp = (head[0] - 0.01, 0.0, z - 0.01) if p.bar != "drop" else (x - 0.03, 0.0, z - 0.02)
    parts = [rod(head, clamp, 0.9 * p.tube, STEEL)]
    for side in (1, -1):
        if p.bar == "drop":
            bend, hook = (x + 0.01, side * (y - 0.03), z), (x + 0.11, side * (y - 0.03), z - 0.05)
            end = (x - 0.02, side * (y - 0.03), z - 0.14)
            lines = [(clamp, bend, STEEL), (bend, hook, BLACK), (hook, end, BLACK)]
        else:
            back = 0.12 if p.bar == "swept" else 0.02
            knee = (clamp[0], side * 0.14, z)
            lines = [(clamp, knee, STEEL), (knee, (x - back, side * (y + 0.05), z), BLACK)]
        parts += [rod(a, b, 0.015, color) for a, b, color in lines]
    return parts


def _drive(p: BicycleParams) -> list[Asset]:
    """Saddle, chainring, chain, cranks and pedals."""
    x, _, z = SADDLE
    tip, tail = x + 0.13, x - 0.13
    outline = [(tip, -0.025, z), (tip, 0.025, z), (tail, 0.075, z), (tail, -0.075, z)]
    parts = [
        polygon(outline, p.saddle_color),
        polygon([(tip, 0, z), (tail, 0.075, z), (tail, 0, z - 0.07), (x, 0, z - 0.05)], BLACK),
        polygon([(tip, 0, z), (tail, -0.075, z), (tail, 0, z - 0.07), (x, 0, z - 0.05)], BLACK),
    ]
    sprocket = circle((CRANK[0], -0.045, CRANK[2]), 0.085, 8)
    parts.append(polygon(sprocket, STEEL, "metal"))
    rear = -p.wheelbase / 2
    low, high = (rear, -0.05, p.wheel_radius - 0.02), (CRANK[0], -0.05, CRANK[2] + 0.07)
    chain = [low, (CRANK[0], -0.05, CRANK[2] - 0.07), high, (rear, -0.05, p.wheel_radius + 0.02)]
    parts.append(polygon(chain, BLACK if p.mudguards else STEEL, "metal"))
    for pedal in pedals():
        side = np.sign(pedal[1])
        start = (CRANK[0], side * 0.06, CRANK[2])
        parts.append(rod(start, (pedal[0], side * 0.07, pedal[2]), 0.014, STEEL))
        low = (pedal[0] - 0.05, pedal[1] - 0.05, pedal[2] - 0.012)
        high = (pedal[0] + 0.05, pedal[1] + 0.05, pedal[2] + 0.012)
        parts.append(block(low, high, BLACK))
    return parts


def pedals() -> tuple[Point, Point]:
    """Middle of the left and of the right pedal, m."""
    x, _, z = CRANK
    ahead, up = CRANK_LENGTH * np.cos(CRANK_ANGLE), CRANK_LENGTH * np.sin(CRANK_ANGLE)
    return (x + ahead, PEDAL_Y, z + up), (x - ahead, -PEDAL_Y, z - up)


def _fittings(p: BicycleParams) -> list[Asset]:
    """Mudguards, rack, basket and lamps."""
    parts = []
    rear, front = -p.wheelbase / 2, p.wheelbase / 2
    top = 2 * p.wheel_radius + 0.07
    if p.mudguards:
        for x, angles in ((rear, (0.6, 1.5, 2.3, 3.1)), (front, (0.5, 1.5, 2.4))):
            hub = (x, 0.0, p.wheel_radius)
            parts.append(mudguard(hub, p.wheel_radius + 0.02, 0.06, angles, p.color))
    if p.rack:
        parts.append(block((rear - 0.17, -0.06, top), (rear + 0.2, 0.06, top + 0.02), BLACK))
        parts.append(rod((rear - 0.1, 0.0, top), (rear, 0.0, p.wheel_radius), 0.012, BLACK))
        parts.append(card((rear - 0.18, 0.0, top - 0.025), 0.06, 0.05, TAILLAMP, "lamp"))
    x = front - 0.1
    if p.basket:
        low, high = (x, -0.16, top + 0.03), (x + 0.26, 0.16, top + 0.23)
        parts.append(block(low, high, _WICKER))
    elif p.mudguards:
        low, high = (x, -0.03, top + 0.01), (x + 0.06, 0.03, top + 0.08)
        parts.append(block(low, high, HEADLAMP, "lamp"))
    return parts
