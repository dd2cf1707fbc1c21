"""Bicycles: two wheels with thin spokes, a frame of tubes, a handlebar, a saddle and pedals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.assets.family import ROAD, Family, Size
from scene.assets.parts.draw import between, maybe, near, sample_fields, times
from scene.assets.parts.palette import BLACK, HEADLAMP, STEEL, TAILLAMP, TYRE, WICKER
from scene.assets.parts.skin import cuboid
from scene.assets.parts.vehicle import card, mudguard, rod
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Parts, Point, merge
from scene.mesh.solids import block, polygon, ring, tube

SADDLE: Point = (-0.28, 0.0, 0.95)
"""Top of the saddle, m."""
BAR: Point = (0.30, 0.25, 1.00)
"""Left grip, m; the right one is its mirror image."""
CRANK: Point = (-0.08, 0.0, 0.29)
"""Middle of the crank, m."""
CRANK_LENGTH = 0.17
"""Distance from the crank's middle to a pedal, m; the left pedal is down and forward."""
CRANK_ANGLE = -1.2
"""Angle of the left pedal, radians up from straight ahead."""
PEDAL_Y = 0.13
"""Distance of the left pedal from the middle, m."""


class BicycleParams(NamedTuple):
    """One bicycle; metres."""

    wheel_radius: float
    tyre: float  # thickness
    wheelbase: float
    tube: float  # radius of the frame's tubes
    step: float  # m that the top tube drops at its rear end
    bar: str  # "flat", "swept" or "drop"
    mudguards: bool
    basket: bool
    rack: bool
    load: str = ""  # on the rack: "panniers", "child seat", "box" or ""
    bottle: bool = False
    chaincase: bool = False
    second_color: Color = (0.3, 0.3, 0.3)  # of fork, bags and rims
    rise: float = 0.0  # m added to the head tube
    color: Color = BLACK
    tyre_color: Color = TYRE
    saddle_color: Color = BLACK


_KINDS: dict[str, BicycleParams] = {
    "city": BicycleParams(0.345, 0.046, 1.08, 0.020, 0.05, "swept", True, False, True),
    "racing": BicycleParams(0.340, 0.036, 1.00, 0.019, 0.02, "drop", False, False, False),
    "mountain": BicycleParams(0.350, 0.060, 1.10, 0.027, 0.16, "flat", False, False, False),
    "step-through": BicycleParams(0.340, 0.046, 1.10, 0.022, 0.42, "swept", True, True, True),
    "folding": BicycleParams(0.255, 0.048, 1.02, 0.026, 0.44, "flat", True, False, True),
    "touring": BicycleParams(0.348, 0.042, 1.06, 0.019, 0.08, "drop", True, False, True),
    "delivery": BicycleParams(0.335, 0.050, 1.10, 0.024, 0.30, "flat", True, True, True, "box"),
}

_GUARDS = tuple(np.linspace(0.5, 3.2, 9)), tuple(np.linspace(0.4, 2.6, 8))
"""Angles of the rear and the front mudguard, radians up from straight ahead."""

_PAINTS: tuple[Color, ...] = (
    BLACK, BLACK, (0.035, 0.035, 0.04), (0.05, 0.05, 0.055), (0.24, 0.015, 0.015), (0.02, 0.06, 0.2),
    (0.02, 0.09, 0.045), (0.20, 0.21, 0.22), (0.45, 0.45, 0.43), (0.36, 0.15, 0.015), (0.07, 0.20, 0.22),
    (0.13, 0.02, 0.10),
)  # fmt: skip
_TYRES: tuple[Color, ...] = (TYRE, TYRE, TYRE, (0.10, 0.06, 0.03), (0.30, 0.26, 0.18))
_LOADS = ("", "", "panniers", "child seat", "box")
_SADDLES: tuple[Color, ...] = (BLACK, (0.12, 0.06, 0.03))


def sample_bicycle(rng: np.random.Generator, kind: str) -> BicycleParams:
    """Draw a bicycle of one frame type: wheel size, paint, basket and rack."""
    model = _KINDS[kind]
    load = _LOADS[int(rng.integers(len(_LOADS)))] if model.rack else ""
    return sample_fields(
        rng, model, wheel_radius=times(0.95, 1.03), wheelbase=times(0.97, 1.04), tyre=times(0.95, 1.2),
        tube=times(0.9, 1.25), step=times(0.7, 1.1), mudguards=model.mudguards and maybe(0.8),
        basket=maybe(0.8 if model.basket else 0.25 if model.mudguards else 0.0),
        rack=model.rack and (bool(load) or maybe(0.7)), load=model.load or load,
        bottle=not model.mudguards and maybe(0.6), chaincase=model.mudguards and maybe(0.5),
        rise=between(-0.02, 0.04), color=near(0.25, *_PAINTS), second_color=near(0.15, *_PAINTS, STEEL),
        tyre_color=near(0.15, *_TYRES), saddle_color=near(0.15, *_SADDLES),
    )  # fmt: skip


def bicycle(p: BicycleParams) -> Asset:
    """Build the bicycle, facing +x."""
    parts = [_wheel(p, x) for x in (-p.wheelbase / 2, p.wheelbase / 2)]
    return merge(*parts, *_frame(p), *_handlebar(p), *_drive(p), *_fittings(p))


def _wheel(p: BicycleParams, x: float) -> Asset:
    """Build tyre, rim, bright spokes as crossed blades, and the hub."""
    hub = (x, 0.0, p.wheel_radius)
    radius = p.wheel_radius - p.tyre / 2
    rim = radius - 0.5 * p.tyre - 0.006
    color = STEEL if max(p.second_color) < 0.1 else p.second_color
    parts = [
        ring(hub, radius, p.tyre, p.tyre_color, "rubber", sides=24),
        ring(hub, rim, 0.018, color, "metal", sides=24),
        tube((x, -0.04, hub[2]), (x, 0.04, hub[2]), 0.03, STEEL, "metal", sides=8),
    ]
    for k, angle in enumerate(np.arange(9) * np.pi / 9 + 0.3):
        along = radius * np.array([np.cos(angle), 0, np.sin(angle)])
        half_width = 0.0035 * np.array([-np.sin(angle), 0, np.cos(angle)])
        lean = np.array([0, 0.012 if k % 2 else -0.012, 0])  # spokes cross from flange to flange
        head = [along - half_width + lean, along + half_width + lean]
        foot = [-along + half_width - lean, -along - half_width - lean]
        parts.append(polygon(np.array(head + foot) + hub, STEEL, "metal"))
    return merge(*parts)


def _steering(p: BicycleParams) -> tuple[Point, Point, Point]:
    """Return the front hub and the foot and top of the head tube, on one line."""
    hub = (p.wheelbase / 2, 0.0, p.wheel_radius)
    foot = (hub[0] - 0.13, 0.0, p.wheel_radius * 2 + 0.04)
    top = max(foot[2] + 0.17, 0.86) + p.rise
    return hub, foot, (foot[0] - 0.06 - 0.3 * (top - foot[2] - 0.17), 0.0, top)


def _frame(p: BicycleParams) -> Parts:
    """Build the diamond: down, top and seat tube, stays and fork."""
    hub, foot, head = _steering(p)
    seat = _on_seat_tube(0.80)
    joint = _on_seat_tube(0.80 - 1.2 * p.step)
    front = head if p.step < 0.3 else foot
    yield rod(CRANK, foot, 1.15 * p.tube, p.color, "paint")
    yield rod(joint, (front[0], 0.0, front[2] - 0.02), p.tube, p.color, "paint")
    yield rod(CRANK, seat, p.tube, p.color, "paint")
    yield rod(seat, SADDLE, 0.8 * p.tube, STEEL)
    yield rod(foot, head, 1.2 * p.tube, p.color, "paint")
    for y in (p.tyre / 2 + 0.02, -p.tyre / 2 - 0.02):
        rear = (-p.wheelbase / 2, y, p.wheel_radius)
        yield rod((CRANK[0], 0.6 * y, CRANK[2]), rear, 0.7 * p.tube, p.color, "paint")
        yield rod((seat[0], 0.6 * y, seat[2] - 0.04), rear, 0.6 * p.tube, p.color, "paint")
        yield rod((foot[0], y, foot[2]), (hub[0], y, hub[2]), 0.7 * p.tube, p.second_color, "paint")


def _on_seat_tube(share: float) -> Point:
    """Return the point at ``share`` of the way from the crank to the saddle."""
    (x0, y0, z0), (x1, y1, z1) = CRANK, SADDLE
    return x0 + share * (x1 - x0), y0 + share * (y1 - y0), z0 + share * (z1 - z0)


def _handlebar(p: BicycleParams) -> Parts:
    """Build stem, bar and grips; the hands hold it at ``BAR``."""
    _, _, head = _steering(p)
    x, y, z = BAR
    clamp = (head[0] - 0.01, 0.0, z - 0.01) if p.bar != "drop" else (x - 0.03, 0.0, z - 0.02)
    yield rod(head, clamp, 0.9 * p.tube, STEEL)
    for side in (1, -1):
        if p.bar == "drop":
            bend, hook = (x + 0.01, side * (y - 0.03), z), (x + 0.11, side * (y - 0.03), z - 0.05)
            end = (x - 0.02, side * (y - 0.03), z - 0.14)
            lines = [(clamp, bend, STEEL), (bend, hook, BLACK), (hook, end, BLACK)]
        else:
            back = 0.12 if p.bar == "swept" else 0.02
            knee = (clamp[0], side * 0.14, z)
            lines = [(clamp, knee, STEEL), (knee, (x - back, side * (y + 0.05), z), BLACK)]
        yield from (rod(a, b, 0.015, color) for a, b, color in lines)


def _drive(p: BicycleParams) -> Parts:
    """Build saddle, chainring, chain, cranks and pedals."""
    x, _, z = SADDLE
    tip, tail = x + 0.13, x - 0.13
    outline = [(tip, -0.025, z), (tip, 0.025, z), (tail, 0.075, z), (tail, -0.075, z)]
    yield polygon(outline, p.saddle_color)
    yield polygon([(tip, 0, z), (tail, 0.075, z), (tail, 0, z - 0.07), (x, 0, z - 0.05)], BLACK)
    yield polygon([(tip, 0, z), (tail, -0.075, z), (tail, 0, z - 0.07), (x, 0, z - 0.05)], BLACK)
    turn = (np.arange(8) / 8 - 0.25) * 2 * np.pi
    sprocket = 0.085 * np.column_stack([np.cos(turn), np.zeros(8), np.sin(turn)])
    yield polygon(np.array([CRANK[0], -0.045, CRANK[2]]) + sprocket, STEEL, "metal")
    rear = -p.wheelbase / 2
    low, high = (rear, -0.05, p.wheel_radius - 0.02), (CRANK[0], -0.05, CRANK[2] + 0.07)
    chain = [low, (CRANK[0], -0.05, CRANK[2] - 0.07), high, (rear, -0.05, p.wheel_radius + 0.02)]
    if p.chaincase:
        yield polygon(np.array(chain) + [0, -0.02, 0], p.color, "paint")
    for a, b in ((chain[0], chain[1]), (chain[3], chain[2])):
        yield rod(a, b, 0.008, TYRE)
    for x, y, z in pedals():
        side = np.sign(y)
        yield rod((CRANK[0], side * 0.06, CRANK[2]), (x, side * 0.07, z), 0.014, STEEL)
        yield cuboid((x - 0.05, x + 0.05), 0.05, (z - 0.012, z + 0.012), BLACK, at=y)


def pedals() -> tuple[Point, Point]:
    """Return the middle of the left and of the right pedal, m."""
    x, _, z = CRANK
    ahead, up = CRANK_LENGTH * np.cos(CRANK_ANGLE), CRANK_LENGTH * np.sin(CRANK_ANGLE)
    return (x + ahead, PEDAL_Y, z + up), (x - ahead, -PEDAL_Y, z - up)


def _fittings(p: BicycleParams) -> Parts:
    """Build mudguards, rack, bottle and loads."""
    rear, front = -p.wheelbase / 2, p.wheelbase / 2
    top = 2 * p.wheel_radius + 0.07
    if p.mudguards:
        for x, angles in ((rear, _GUARDS[0]), (front, _GUARDS[1])):
            hub = (x, 0.0, p.wheel_radius)
            yield mudguard(hub, p.wheel_radius + 0.02, 0.06, angles, p.color)
    if p.rack:
        yield cuboid((rear - 0.17, rear + 0.2), 0.06, (top, top + 0.02), BLACK)
        yield rod((rear - 0.1, 0.0, top), (rear, 0.0, p.wheel_radius), 0.012, BLACK)
        yield card((rear - 0.18, 0.0, top - 0.025), 0.06, 0.05, TAILLAMP, "lamp")
    if p.bottle:
        low, high = (_on_down_tube(p, share) for share in (0.4, 0.75))
        yield tube(low, high, 0.036, p.second_color, sides=8)
    yield from _front_load(p)
    yield from _rear_load(p)


def _on_down_tube(p: BicycleParams, share: float) -> Point:
    """Return the point above the down tube at ``share`` of the way from crank to head."""
    (x0, _, z0), (x1, _, z1) = CRANK, _steering(p)[1]
    return x0 + share * (x1 - x0) - 0.03, 0.0, z0 + share * (z1 - z0) + 0.06


def _front_load(p: BicycleParams) -> Parts:
    """Build a basket of wires or wicker, or only a lamp."""
    x = _steering(p)[1][0] + 0.03
    top = max(2 * p.wheel_radius + 0.1, 0.7)
    lamp = tube(
        (x - 0.04, 0.0, top + 0.02), (x + 0.1, 0.0, top + 0.02), 0.04, HEADLAMP, "lamp", sides=8
    )
    if not p.basket:
        head = _steering(p)[2]
        bracket = rod((head[0], 0.0, head[2] - 0.06), (x, 0.0, top + 0.02), 0.01, BLACK)
        yield from [lamp, bracket] if p.mudguards else []
        return
    low, high = (x, -0.17, top + 0.03), (x + 0.27, 0.17, top + 0.23)
    if p.tube > 0.022:
        yield block(low, high, WICKER, "wood")
        return
    (back, right_y, foot), (ahead, left_y, rim) = low, high
    yield block(low, (ahead, left_y, foot + 0.01), BLACK, "metal")
    for z in np.linspace(foot, rim, 4):
        ends = [((back, y, z), (ahead, y, z)) for y in (right_y, left_y)]
        ends += [((x, right_y, z), (x, left_y, z)) for x in (back, ahead)]
        yield from (rod(a, b, 0.006, BLACK) for a, b in ends)
    upright = [(ahead, y) for y in np.linspace(right_y, left_y, 6)]
    upright += [(x, y) for x in np.linspace(back, ahead, 5) for y in (right_y, left_y)]
    yield from (rod((x, y, foot), (x, y, rim), 0.005, BLACK) for x, y in upright)


def _rear_load(p: BicycleParams) -> Parts:
    """Build bags at the sides of the rack, or a child's seat or a box on it."""
    rear, top = -p.wheelbase / 2, 2 * p.wheel_radius + 0.08
    if p.load == "panniers":
        along, up = (rear - 0.16, rear + 0.16), (top - 0.36, top)
        for y in (0.15, -0.15):
            yield cuboid(along, 0.06, up, p.second_color, "cloth", at=y)
    if p.load == "child seat":
        yield cuboid((rear - 0.12, rear + 0.16), 0.15, (top, top + 0.08), BLACK)
        yield cuboid((rear - 0.18, rear - 0.12), 0.15, (top, top + 0.36), p.second_color)
        for y in (0.15, -0.15):
            yield cuboid((rear - 0.15, rear + 0.1), 0.02, (top, top + 0.2), BLACK, at=y)
    if p.load == "box":
        high = min(top + 0.36, 1.1)
        yield cuboid((rear - 0.24, rear + 0.16), 0.19, (top + 0.02, high), p.second_color)


FAMILY = Family(
    "bicycle", TrainId.BICYCLE, tuple(_KINDS), sample_bicycle, bicycle,
    count=18, size=Size((1.0, 2.8), (0.6, 1.6)), tone=0.4, line=("bicycle", 0.7),
    facing="either", stage=ROAD._replace(azimuth=-62),
)  # fmt: skip
