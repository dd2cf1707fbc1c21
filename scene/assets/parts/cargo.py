"""Open and special loads of lorries: platforms, tubs, tanks, drums and cranes."""

from __future__ import annotations

from itertools import product

import numpy as np

from scene.assets.parts.lorry import TruckParams, bed, floor, sign
from scene.assets.parts.palette import AMBER, BLACK, GRAVEL, STEEL, TAILLAMP, TRIM, WHITE, darker
from scene.assets.parts.skin import cuboid, pair, revolve
from scene.assets.parts.vehicle import hoop, lettering, panel, panels, tank, walls
from scene.mesh.asset import Parts, Point, repaint, reshaped, translate
from scene.mesh.solids import block, loft, polygon, tube


def flatbed(p: TruckParams) -> Parts:
    """Build an open bed with pipes, planks or covered crates."""
    x, length, width = bed(p)
    low, half = floor(p), width / 2
    front, rear = x + length / 2, x - length / 2
    rng = np.random.default_rng(p.seed)
    yield cuboid((rear, front), half, (low, low + 0.14), p.body, "wood")
    yield cuboid((front - 0.08, front), half, (low, p.height + 0.4), STEEL, "metal")
    start = rear + 0.15
    while start < rear + p.fill * length:
        size = rng.uniform(0.7, 1.6)
        end = min(start + size, front - 0.2)
        top = low + 0.14 + rng.uniform(0.35, 1.0) * (p.height - low)
        half_width = rng.uniform(0.55, 0.95) * half
        kind = rng.integers(3)
        if kind == 0:  # pipes
            columns, levels = np.arange(-half_width, half_width, 0.24), ((0.0, 0.27), (0.1, 0.47))
            for y, (aside, up) in product(columns.tolist(), levels):
                ends = (start, y + aside, low + up), (end, y + aside, low + up)
                yield tube(*ends, 0.11, STEEL, "metal", sides=8)
        else:
            color = (WHITE, (0.16, 0.10, 0.06), p.cab, (0.25, 0.07, 0.03))[int(rng.integers(4))]
            material, high = "wood" if kind == 1 else "cloth", (low + 0.16, top)
            yield cuboid((start, end), half_width, high, color, material)
            for share in (0.3, 0.7):
                strap_x, strap = start + share * (end - start), (low + 0.16, top + 0.01)
                yield cuboid((strap_x - 0.03, strap_x + 0.03), half_width + 0.01, strap, AMBER)
        start = end + rng.uniform(0.05, 0.3)
    if p.fill < 0.75:  # drop sides
        for y in (half, -half):
            yield cuboid((rear, front), 0.02, (low + 0.1, low + 0.5), p.cab, "metal", at=y)


def _tub(
    x: float, length: float, half: float, low: float, high: float, slope: float
) -> list[np.ndarray]:
    """Return the lower and upper edge of an open body that widens upwards."""
    plan = np.array([(-0.5, -1, 0), (0.5, -1, 0), (0.5, 1, 0), (-0.5, 1, 0)])
    lower = plan * [length * (1 - slope), half - 0.1, 0] + [x, 0, low]
    return [lower, plan * [length, half, 0] + [x, 0, high]]


def tipper(p: TruckParams) -> Parts:
    """Build a tipping bed with a heap of gravel."""
    x, length, width = bed(p)
    low, half, high = floor(p), width / 2, p.height
    edge = _tub(x, length, half, low, high, 0.04)
    heap = edge[1] * [1, 0.9, 1] - [0, 0, 0.12]
    peak = (heap - [x, 0, 0]) * [0.4, 0.3, 1] + [x, 0, 0.6 * p.fill]
    yield loft(edge, p.body, "metal")
    yield loft([heap, peak], GRAVEL, "concrete")
    front = x + length / 2
    yield cuboid((front, front + 0.7), half, (high - 0.1, high), p.body)
    yield tube((front + 0.15, 0, low), (front + 0.1, 0, high), 0.1, STEEL, "metal")
    for share in np.linspace(0.04, 0.96, 7):  # ribs
        post = x + (share - 0.5) * length
        rib = (post - 0.05, half - 0.16, low), (post + 0.05, half + 0.03, high)
        yield pair(block(*rib, darker(p.body, 0.8), "metal"))
    rail = (x - length / 2, half - 0.06, high - 0.08), (front, half + 0.04, high)
    side = walls(length, width + 0.08, low, high, x=x)
    dark = darker(p.body, 0.6)
    ribs = [(u, u + 0.04) for u in (0.02, 0.3, 0.66, 0.94)]
    bars = [(v, v + 0.05) for v in (0.0, 0.5, 0.95)]
    yield panels(side.rear, ribs, [(0, 1)], dark, lift=0.04)
    yield panels(side.rear, [(0, 1)], bars, dark, lift=0.03)
    yield pair(block(*rail, p.body, "metal"))
    yield from sign(p._replace(band=None), side, (0.3, 0.7), (0.35, 0.7))


def tanker(p: TruckParams) -> Parts:
    """Build a tank with ladders, bands and manholes."""
    x, length, width = bed(p)
    low = floor(p)
    radius = (p.height - low) / 2
    middle = low + radius
    angle = np.arange(20) * np.pi / 10
    loop = np.column_stack([np.cos(angle) * 0.49 * width, np.sin(angle) * radius])
    top, reach = p.height, 0.4 * length
    ends = ((0.5, 0.55), (0.49, 0.8), (0.46, 0.97), (0.44, 1.0))
    yield tank(loop, x, middle, length, ends, p.body)
    yield cuboid((x - reach, x + reach), 0.3, (top - 0.04, top + 0.05), TRIM)
    yield cuboid((x - length / 2, x + length / 2), 0.5, (low - 0.1, low + 0.15), TRIM)
    back = x - length / 2 - 0.02
    for y, head in ((0.5, top), (0.8, top - 0.1)):
        yield tube((back, y, low), (back, y, head), 0.03, STEEL, sides=4)
    for share in (-0.3, -0.05, 0.2):  # bands round the tank and manholes on it
        span = x + (share - 0.008) * length, x + (share + 0.008) * length
        yield hoop(loop, span, middle, 1.012, p.band or STEEL)
        manhole_x = x + (share + 0.1) * length
        manhole = (manhole_x, 0, top - 0.1), (manhole_x, 0, top + 0.16)
        yield tube(*manhole, 0.25, STEEL, "metal", sides=10)
    side = walls(0.8 * length, width + 0.01, low + 0.6 * radius, low + 1.4 * radius, x=x)
    if p.letters is not None:
        for wall in side[:2]:
            yield lettering(wall, (0.2, 0.8), (0.2, 0.75), p.letters, p.seed)
    rear = walls(length + 0.02, width, low + 0.5 * radius, low + 1.5 * radius, x=x).rear
    yield panel(rear, (0.4, 0.6), (0.4, 0.6), AMBER)


def refuse(p: TruckParams) -> Parts:
    """Build a refuse body with a rear loader that reaches below its floor and leans out."""
    x, length, width = bed(p)
    low, half = floor(p), width / 2
    tail, split = x - length / 2, x - length / 2 + 1.5
    side = walls(x + length / 2 - split, width, low, p.height, x=(x + length / 2 + split) / 2)
    high, lip = p.height, tail + 0.7
    outline = [(split, 0.55), (split, high), (lip, high), (tail, 1.6), (tail + 0.15, 0.55)]
    rings = [np.array([(u, y, z) for u, z in outline]) for y in (half, -half)]
    slope = np.array([(tail, half, 1.6), (tail, -half, 1.6), (lip, -half, high), (lip, half, high)])
    yield cuboid((split, x + length / 2), half, (low, p.height - 0.15), p.body, "paint")
    yield loft(rings, darker(p.body, 0.8), "paint")
    yield panel(slope, (0.12, 0.88), (0.02, 0.45), BLACK)
    yield panel(slope, (0, 1), (0.62, 0.72), AMBER)
    yield from sign(p, side, (0.2, 0.8), (0.35, 0.65))
    for share in np.linspace(0.04, 0.96, 6):  # ribs
        post = split + share * (x + length / 2 - split)
        rib = (post - 0.05, half - 0.02, low), (post + 0.05, half + 0.05, p.height - 0.2)
        yield pair(block(*rib, darker(p.body, 0.75)))
    bar = (tail + 0.15, half + 0.03, 0.7), (tail + 0.5, half + 0.03, 2.2)
    lamp = (tail - 0.02, half - 0.3, 1.25), (tail + 0.1, half - 0.05, 1.5)
    yield pair(tube(*bar, 0.05, STEEL, "metal"))
    yield pair(block(*lamp, TAILLAMP, "lamp"))


def mixer(p: TruckParams) -> Parts:
    """Build a slanting drum with painted spirals, a hopper and a chute."""
    x, length, _ = bed(p)
    low, radius = floor(p), (p.height - floor(p)) / 2 - 0.1
    profile = [(0.3, 0.5), (0.72, 0.42), (1, 0.12), (1, -0.08), (0.62, -0.38), (0.42, -0.5)]
    drum = revolve([(radius * r, -length * 0.9 * y) for r, y in profile], p.body, "paint", sides=24)
    middle = drum.mesh.vertices[drum.mesh.faces].mean(axis=1)
    turn = np.arctan2(middle[:, 2], middle[:, 0]) + 2.5 * middle[:, 1]
    stripe = np.cos(turn) > 0.75  # a spiral of two bands
    drum = repaint(drum, stripe, p.band or WHITE, "paint")
    along, across, up = (drum.mesh.vertices[:, [1, 0, 2]] * [-1, 1, 1]).T
    cos, sin = np.cos(0.16), np.sin(0.16)
    turned = np.column_stack([along * cos + up * sin, across, up * cos - along * sin])
    rear = x - length / 2
    hopper = (rear + 0.6, 0, p.height - 0.75), (rear + 0.45, 0, p.height)
    near_x, far_x = rear + 0.5, rear - 0.1
    chute = [(near_x, 0.25, 1.9), (near_x, -0.25, 1.9), (far_x, -0.2, 1.2), (far_x, 0.2, 1.2)]
    yield translate(reshaped(drum, turned), (x, 0, low + radius + 0.25))
    yield cuboid((x + 0.32 * length, x + 0.42 * length), 0.5, (low, low + 1.1), p.cab)
    strut = (rear + 0.7, 0.8, low), (rear + 0.5, 0.3, p.height - 0.4)
    yield pair(tube(*strut, 0.06, p.cab, "metal"))
    yield loft([np.array(chute), np.array(chute) - [0, 0, 0.06]], STEEL, "metal")
    yield tube(*hopper, 0.3, p.cab, "paint", end_radius=0.6, sides=8)


def skip(p: TruckParams) -> Parts:
    """Build a skip between two lifting arms."""
    x, length, width = bed(p)
    low, half = floor(p), width / 2
    edge = _tub(x - 0.1 * length, 0.66 * length, half - 0.3, low + 0.2, p.height - 0.3, 0.45)
    heap = edge[1] * [1, 0.95, 1] - [0, 0, 0.1]
    peak = (heap - [x, 0, 0]) * [0.5, 0.4, 1] + [x, 0, 0.5 * p.fill]
    side = half - 0.12
    root, tip = (x - 0.05 * length, side, low + 0.2), (x - 0.38 * length, side, p.height)
    yield cuboid((x - length / 2, x + length / 2), half, (low, low + 0.16), TRIM, "metal")
    yield loft(edge, p.body, "metal")
    yield loft([heap, peak], (0.13, 0.10, 0.08), "concrete")
    yield pair(tube(root, tip, 0.12, p.cab, "paint", sides=4))
    yield pair(tube((root[0] + 0.28 * length, side, low + 0.2), root, 0.07, STEEL, "metal"))
    yield pair(tube(tip, (tip[0] + 0.1, half - 0.3, p.height - 0.4), 0.02, BLACK, sides=4))


def recovery(p: TruckParams) -> Parts:
    """Build a tilting platform with a crane behind the cab."""
    x, length, width = bed(p)
    low, half = floor(p), width / 2
    front, rear = x + length / 2, x - length / 2 + 0.5  # ahead of the ramp
    elbow = (front - 0.3, 0.0, p.height + 0.3)
    hook = (front - 0.3 - 0.45 * length * p.fill, 0.0, p.height + 0.1)
    tip = rear - 0.5
    ramp: list[Point] = [(rear, half, low), (rear, -half, low), (tip, -half, 0.6), (tip, half, 0.6)]
    yield cuboid((rear, front), half, (low - 0.05, low + 0.1), STEEL, "metal")
    yield pair(block((rear, half - 0.06, low), (front, half, low + 0.22), p.body, "metal"))
    yield cuboid((front - 0.05, front + 0.1), 0.7, (p.height - 0.35, p.height - 0.2), AMBER, "lamp")
    yield tube((front - 0.3, 0, low), elbow, 0.16, p.cab, "paint", sides=8)
    yield tube(elbow, hook, 0.11, p.cab, "paint", sides=6)
    yield tube(hook, (hook[0], 0, hook[2] - 0.7), 0.02, BLACK, sides=4)
    yield polygon(ramp, STEEL, "metal")
