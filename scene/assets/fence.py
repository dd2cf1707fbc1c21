"""Fence panels centred on y = 0: posts, rails and an infill, mostly see-through."""

from __future__ import annotations

from functools import partial
from itertools import cycle, pairwise
from typing import NamedTuple

import numpy as np

from scene.assets.family import FRONTAGE, Family, Size
from scene.assets.parts.draw import SEED, between, near, sampler, times
from scene.assets.parts.palette import (
    FENCE_BLACK,
    FENCE_GREEN,
    FENCE_TIMBER,
    FENCE_WHITE,
    GALVANISED,
    WEATHERED_TIMBER,
)
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Parts, Point, ignore, merge, shade
from scene.mesh.solids import box, loft, polygon, triangles, tube


class FenceParams(NamedTuple):
    """A panel: evenly spaced posts, horizontal rails, and one kind of infill."""

    length: float  # along x, m
    height: float  # m
    posts: int
    post_width: float  # m
    rails: tuple[float, ...]  # height of each rail, as a share of ``height``
    rail_size: float  # height of a rail's section, m
    infill: str  # see ``_INFILLS``
    pitch: float  # spacing of the infill's pieces, m
    gauge: float  # width of the infill's pieces, m
    color: Color
    material: str
    tip: str = ""  # of posts: "", "ball", "point" or "feet"
    second_color: Color = FENCE_WHITE  # of stripes, feet and reflectors
    seed: int = 0  # unevenness of boards and pickets


_IRON = FenceParams(3.5, 1.4, 2, 0.06, (0.1, 0.9), 0.04, "bars", 0.12, 0.022, FENCE_BLACK, "paint")
_WOOD = _IRON._replace(posts=3, post_width=0.1, rail_size=0.08, color=FENCE_TIMBER, material="wood",
                       rails=(0.25, 0.75), pitch=0.14, gauge=0.09)  # fmt: skip
_KINDS: dict[str, FenceParams] = {
    "spear railings": _IRON._replace(infill="spears", tip="ball", posts=2),
    "pickets": _WOOD._replace(height=1.0, infill="pickets", color=FENCE_WHITE, material="paint"),
    "chain link": _IRON._replace(height=2.0, rails=(0.97,), infill="diamonds", pitch=0.16,
                                 gauge=0.010, color=FENCE_GREEN, material="metal", posts=3),
    "guard rail": _IRON._replace(height=0.78, rails=(), infill="beam", posts=3, post_width=0.1,
                                 gauge=0.31, color=GALVANISED, material="metal"),
    "boards": _WOOD._replace(height=1.75, infill="boards", gauge=0.15, pitch=0.172),
    "pedestrian guard": _IRON._replace(height=1.05, rails=(0.14, 0.80, 0.97), color=GALVANISED, pitch=0.13,
                                       gauge=0.02, material="metal", posts=3),
    "rails": _WOOD._replace(height=1.15, infill="none", rails=(0.3, 0.6, 0.9), rail_size=0.12,
                            color=WEATHERED_TIMBER),
    "heras": _IRON._replace(height=2.0, rails=(0.03, 0.97), infill="grid", pitch=0.14, gauge=0.008,
                            color=GALVANISED, material="metal", tip="feet", post_width=0.045,
                            second_color=(0.30, 0.08, 0.02)),
    "bollard and chain": _IRON._replace(height=1.0, rails=(), infill="chain", posts=3,
                                        post_width=0.13, tip="ball"),
    "bow top": _IRON._replace(height=1.15, infill="bows", rails=(0.12, 0.72), color=FENCE_GREEN, pitch=0.2),
    "palisade": _IRON._replace(height=2.3, infill="pales", rails=(0.15, 0.85), pitch=0.155,
                               gauge=0.07, color=GALVANISED, material="metal", post_width=0.1),
    "barrier boards": _IRON._replace(height=1.05, rails=(), infill="stripes", posts=3, color=FENCE_WHITE,
                                     second_color=(0.48, 0.03, 0.02), pitch=0.35, post_width=0.05,
                                     tip="feet"),
    "trellis": _WOOD._replace(height=1.6, rails=(0.04, 0.96), infill="diamonds", pitch=0.22,
                              gauge=0.035),
    "cross rails": _IRON._replace(height=1.1, rails=(0.08, 0.95), infill="crosses", pitch=0.85,
                                  gauge=0.035, color=(0.10, 0.02, 0.018), posts=5, tip="ball"),
    "wires": _WOOD._replace(height=1.2, rails=(), infill="wires", pitch=0.2, gauge=0.012, posts=3,
                            post_width=0.12, color=WEATHERED_TIMBER, tip="point"),
    "hurdles": _WOOD._replace(height=1.1, infill="slats", rails=(), pitch=0.17, gauge=0.085, posts=3,
                              color=(0.09, 0.05, 0.03), tip="point"),
}  # fmt: skip


def _stations(p: FenceParams) -> np.ndarray:
    """Return x of the pieces of infill, evenly spaced between the ends."""
    count = max(2, round(p.length / p.pitch))
    return (np.arange(count) + 0.5) / count * p.length - p.length / 2


def _span(p: FenceParams) -> tuple[float, float]:
    """Return the heights of the lowest and the highest rail, or else of the panel."""
    rails = p.rails or (0.12, 0.98)
    return (rails[0] if len(rails) > 1 else 0.02) * p.height, rails[-1] * p.height


def _rod(p: FenceParams, a: Point, b: Point) -> Asset:
    return tube(a, b, p.gauge / 2, p.color, p.material, sides=4, caps=False)


def _bars(p: FenceParams) -> Parts:
    low, high = _span(p)
    return [_rod(p, (x, 0, low), (x, 0, high)) for x in _stations(p)]


def _spears(p: FenceParams) -> Parts:
    """Build bars that end in points over the top rail."""
    low, high = _span(p)
    yield from (_rod(p, (x, 0, low), (x, 0, high + 0.03)) for x in _stations(p))
    tip = partial(tube, end_radius=0.001, sides=4, caps=False)
    for x in _stations(p):
        yield tip((x, 0, high + 0.03), (x, 0, p.height), 0.9 * p.gauge, p.color, p.material)


def _bows(p: FenceParams) -> Parts:
    """Build hoops that join bars in pairs."""
    low, high = _span(p)
    turn, half = np.linspace(0, np.pi, 6), 0.4 * p.pitch
    arc = np.column_stack([half * np.cos(turn), high + (p.height - high) * np.sin(turn)]).tolist()
    for x in _stations(p):
        bow = [(x + across, 0.0, z) for across, z in arc]
        points = [(x + half, 0.0, low), *bow, (x - half, 0.0, low)]
        yield from (_rod(p, a, b) for a, b in pairwise(points))


def _boards(p: FenceParams) -> Parts:
    """Build upright planks in uneven tones, pointed for pickets and pales."""
    rng = np.random.default_rng(p.seed)
    point = {"pickets": 0.07, "pales": 0.12}.get(p.infill, 0.0)
    half, foot, y = p.gauge / 2, 0.05, -min(0.04, p.post_width / 2)
    for x in _stations(p):
        top = p.height - point - abs(rng.normal(0, 0.012))
        outline = [(x - half, foot), (x + half, foot), (x + half, top)]
        outline += [(x, top + point)] if point else []
        outline += [(x - half, top)]
        rings = [[(a, y + d, z) for a, z in outline] for d in (-0.018, 0.0)]
        plank = loft(np.array(rings), p.color, p.material)
        tone = rng.uniform(0.92, 1.05) if p.infill == "pales" else rng.uniform(0.72, 1.2)
        yield shade(plank, np.full(len(plank.color), tone))


def _wire_mesh(lines: list[tuple[np.ndarray, np.ndarray]], p: FenceParams) -> Parts:
    """Build thin flat wires between pairs of points, in the plane of the panel."""
    wires = []
    for a, b in lines:
        along = (b - a) / np.linalg.norm(b - a)
        side = np.array([-along[2], 0, along[0]]) * p.gauge / 2
        wires += [[a - side, b - side, b + side], [a - side, b + side, a + side]]
    return [triangles(np.array(wires), p.color, p.material)]


def _diamonds(p: FenceParams) -> Parts:
    """Build wires or laths in both directions at 45 degrees, cut off at the panel's edges."""
    low, high = _span(p)
    height, half = high - low, p.length / 2
    lines = []
    for start in np.arange(-half - height + p.pitch, half, p.pitch):
        x0, x1 = max(start, -half), min(start + height, half)
        a, b = np.array([x0, 0, low + x0 - start]), np.array([x1, 0, low + x1 - start])
        lines += [(a, b), (a * [-1, 1, 1], b * [-1, 1, 1])]
    return _wire_mesh(lines, p)


def _grid(p: FenceParams) -> Parts:
    """Build a welded mesh of upright and level wires."""
    low, high = _span(p)
    half = p.length / 2
    lines = [(np.array([x, 0, low]), np.array([x, 0, high])) for x in _stations(p)]
    for z in np.arange(low + p.pitch, high, 1.6 * p.pitch):
        lines.append((np.array([-half, 0, z]), np.array([half, 0, z])))
    return _wire_mesh(lines, p)


def _beam(p: FenceParams) -> Parts:
    """Build a corrugated steel band in front of the posts, with reflectors."""
    level = p.height - p.gauge * np.array([1, 0.82, 0.6, 0.5, 0.4, 0.18, 0])
    y = -p.post_width / 2 - np.array([0.01, 0.08, 0.08, 0.02, 0.08, 0.08, 0.01])
    half = p.length / 2
    rings = [np.column_stack([np.full(7, x), y, level]) for x in (-half, half)]
    yield loft(np.array(rings), p.color, p.material, closed=False, caps=False)
    for x in (-half / 2, half / 2):
        place = (x, -p.post_width / 2 - 0.03, p.height - 0.2)
        yield box((0.08, 0.01, 0.1), place, p.second_color, "metal")


def _chain(p: FenceParams) -> Parts:
    """Build chains that hang between the posts."""
    t = np.linspace(0, 1, 13)
    for a, b in pairwise(_post_xs(p)):
        sag = np.column_stack([a + t * (b - a), 0 * t, 0.86 * p.height - 1.1 * t * (1 - t)])
        for ends, thick in zip(pairwise(sag), cycle((0.018, 0.030))):
            yield tube(*ends, thick, p.color, p.material, sides=4, caps=False)


def _stripes(p: FenceParams) -> Parts:
    """Build two boards with slanting stripes in two colours."""
    y, half = -p.post_width / 2 - 0.012, p.length / 2
    for low, high in ((0.72, 0.95), (0.2, 0.38)):
        a, b = low * p.height, high * p.height
        yield box((p.length, 0.02, b - a), (0, y + 0.012, a), p.color, "paint")
        slant, width = b - a, p.pitch / 2
        for x in np.arange(-half, half - slant - width, p.pitch):
            corners = [(x, y, a), (x + width, y, a), (x + width + slant, y, b), (x + slant, y, b)]
            yield polygon(corners, p.second_color, "paint")


def _crosses(p: FenceParams) -> Parts:
    """Build a diagonal cross with a ring between every two posts."""
    low, high = _span(p)
    turn = np.linspace(0, 2 * np.pi, 11)
    circle = 0.16 * np.column_stack([np.cos(turn), 0 * turn, np.sin(turn)])
    for a, b in pairwise(_post_xs(p)):
        yield _rod(p, (a, 0, low), (b, 0, high))
        yield _rod(p, (a, 0, high), (b, 0, low))
        ring = [(a + b) / 2, 0, (low + high) / 2] + circle
        yield from (_rod(p, c, d) for c, d in pairwise(ring))


def _wires(p: FenceParams) -> Parts:
    """Build level wires from post to post."""
    half = p.length / 2
    levels = np.arange(0.25, p.height - 0.08, p.pitch)
    for z in levels.tolist():
        yield tube((-half, 0, z), (half, 0, z), p.gauge / 2, GALVANISED, "metal", sides=4)


def _slats(p: FenceParams) -> Parts:
    """Build level slats with gaps."""
    rng = np.random.default_rng(p.seed)
    levels = np.arange(0.1, p.height - p.gauge - 0.04, p.pitch)
    for z in levels.tolist():
        slat = box((p.length, 0.03, p.gauge), (0, -0.04, z), p.color, p.material)
        yield shade(slat, np.full(12, rng.uniform(0.75, 1.2)))


_INFILLS = {
    "none": lambda p: [], "bars": _bars, "spears": _spears, "bows": _bows, "pickets": _boards,
    "boards": _boards, "pales": _boards, "diamonds": _diamonds, "grid": _grid, "beam": _beam,
    "chain": _chain, "stripes": _stripes, "crosses": _crosses, "wires": _wires, "slats": _slats,
}  # fmt: skip


def _post_xs(p: FenceParams) -> list[float]:
    reach = (p.length - p.post_width) / 2
    return np.linspace(-reach, reach, p.posts).tolist()


def _post(p: FenceParams, x: float) -> Parts:
    """Build a post and its tip or foot."""
    w, h = p.post_width, p.height
    shaft = partial(tube, color=p.color, material=p.material)
    if p.tip == "ball":
        r = 0.5 * w
        yield shaft((x, 0, 0), (x, 0, h - 1.6 * r), r, end_radius=0.8 * r, sides=8)
        tiers = ((-1.6, 0.7), (-1.0, 1.15), (-0.4, 0.95), (0.0, 0.2))
        for (low, foot), (high, head) in pairwise(tiers):
            ends = (x, 0, h + low * r), (x, 0, h + high * r)
            yield shaft(*ends, foot * r, end_radius=head * r, sides=8, caps=False)
        return
    top = h - 0.08 if p.tip == "point" else h
    yield box((w, w, top), (x, 0, 0), p.color, p.material)
    if p.tip == "point":
        yield shaft((x, 0, top), (x, 0, h), 0.7 * w, end_radius=0.01, sides=4)
    if p.tip == "feet":
        yield box((0.16, 0.38, 0.12), (x, 0, 0), p.second_color, "rubber")


def fence(p: FenceParams) -> Asset:
    """Build the panel."""
    posts = [part for x in _post_xs(p) for part in _post(p, x)]
    thin = min(0.04, p.post_width / 2)
    levels = (share * p.height - p.rail_size / 2 for share in p.rails)
    rails = [box((p.length, thin, p.rail_size), (0, 0, z), p.color, p.material) for z in levels]
    panel = merge(*posts, *rails, *_INFILLS[p.infill](p))
    return ignore(panel) if p.infill == "beam" else panel  # Cityscapes: a guard rail is no fence


FAMILY = Family(
    "fence", TrainId.FENCE, tuple(_KINDS),
    sampler(_KINDS, length=between(3.2, 3.8), height=times(0.92, 1.07), pitch=times(0.95, 1.08),
            color=near(0.25), second_color=near(0.15), seed=SEED),
    fence,
    count=16, size=Size((0.5, 40), (0.3, 5)), tone=0.85, line=("fence", 0.6),
    facing="road", front="right", stage=FRONTAGE, in_rows=True,
)  # fmt: skip
