"""Posts that carry traffic signs and lights (class pole), standing at x = y = 0.

Signs and lights rely on ``MAX_RADIUS`` and ``MIN_HEIGHT``, so that any of them fits any post.
"""

from __future__ import annotations

from functools import partial
from itertools import cycle, pairwise, product
from typing import NamedTuple

import numpy as np

from scene.assets.family import Family, Size
from scene.assets.parts.draw import SameAs, near, sample_fields, times
from scene.assets.parts.palette import (
    GOLD,
    POST_BLACK,
    POST_GREEN,
    POST_GREY,
    POST_RED,
    POST_STEEL,
    POST_TIMBER,
    POST_YELLOW,
    WHITE,
)
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Parts, merge
from scene.mesh.solids import box, polygon, tube, turned

MAX_RADIUS = 0.06
"""Largest radius of a post (metres); plates hang just in front of x = -MAX_RADIUS."""
MIN_HEIGHT = 2.5
"""Smallest height of a post (metres)."""
MAX_HEIGHT = 4.0
"""Largest height of a post (metres)."""


class SignpostParams(NamedTuple):
    """A post: a shaft in bands of two colours, with a foot, rings, a cap and something attached to it."""

    height: float  # m
    radius: float  # m
    sides: int  # of the section
    bands: int  # equal lengths of alternating colour
    color: Color
    second_color: Color  # of every other band, of the rings and of the cap
    rings: int = 0  # collars around the shaft
    foot: float = 0.0  # height of a thicker foot, m; 0 for none
    cap: str = "flat"  # "flat", "ball" or "point"
    extra: str = ""  # see ``_EXTRAS``
    material: str = "metal"


_KINDS: dict[str, SignpostParams] = {
    "steel": SignpostParams(3.0, 0.042, 12, 1, POST_STEEL, POST_STEEL),
    "painted": SignpostParams(3.2, 0.045, 12, 1, POST_GREY, POST_GREY, foot=0.5),
    "ringed": SignpostParams(3.4, 0.05, 12, 1, POST_BLACK, GOLD, 3, 0.35, "ball", "", "paint"),
    "striped": SignpostParams(2.8, 0.045, 12, 7, POST_RED, WHITE, material="paint"),
    "concrete": SignpostParams(3.1, 0.06, 6, 1, (0.30, 0.28, 0.25), (0.30, 0.28, 0.25),
                               material="concrete"),
    "square": SignpostParams(2.7, 0.055, 4, 1, (0.10, 0.105, 0.11), POST_BLACK, extra="plate"),
    "timber": SignpostParams(2.6, 0.06, 4, 1, POST_TIMBER, POST_TIMBER, cap="point", material="wood"),
    "litter bin": SignpostParams(2.9, 0.045, 12, 1, POST_STEEL, POST_BLACK, foot=0.3, extra="bin"),
    "push button": SignpostParams(3.6, 0.057, 12, 1, POST_BLACK, POST_GREY, 1, 0.0, "flat", "button"),
    "signal pole": SignpostParams(3.9, 0.058, 12, 1, POST_BLACK, WHITE, foot=0.9, extra="band",
                                  material="paint"),
    "twin": SignpostParams(2.8, 0.038, 12, 1, POST_STEEL, POST_STEEL, extra="twin"),
    "mast arm": SignpostParams(4.0, 0.06, 12, 1, (0.12, 0.125, 0.13), POST_STEEL, foot=1.2, extra="arm"),
    "fluted": SignpostParams(3.3, 0.055, 8, 1, POST_GREEN, POST_GREEN, 4, 0.8, "point", "", "paint"),
    "hoop guard": SignpostParams(2.9, 0.042, 12, 1, POST_GREY, POST_STEEL, extra="hoop"),
    "solar": SignpostParams(3.7, 0.045, 12, 1, POST_STEEL, POST_GREY, extra="solar"),
    "beacon": SignpostParams(3.0, 0.05, 12, 9, POST_BLACK, WHITE, extra="beacon", material="paint"),
}  # fmt: skip


def sample_signpost(rng: np.random.Generator, kind: str) -> SignpostParams:
    """Draw a post of one kind."""
    post = _KINDS[kind]
    top = MAX_HEIGHT - (0.45 if post.extra in ("beacon", "solar") else 0.0)
    post = sample_fields(
        rng, post, color=near(0.25), height=times(0.94, 1.08), radius=times(0.92, 1.08),
        second_color=SameAs("color") if post.color == post.second_color else near(0.15),
    )  # fmt: skip
    height = float(np.clip(post.height, MIN_HEIGHT, top))
    return post._replace(height=height, radius=min(post.radius, MAX_RADIUS))


def _bin(p: SignpostParams) -> Parts:
    """Build a round litter bin next to the post."""
    foot, rim, lid = ((0, 0.24, z) for z in (0.45, 1.0, 1.06))
    yield tube(foot, rim, 0.16, p.second_color, "paint", end_radius=0.19, sides=12)
    yield tube(rim, lid, 0.2, GOLD, "paint", sides=12)
    yield box((0.04, 0.1, 0.3), (0, 0.08, 0.55), p.color)


def _button(p: SignpostParams) -> Parts:
    """Build the yellow box with the button of a pedestrian crossing."""
    yield box((0.14, 0.17, 0.32), (-0.09, 0, 0.90), POST_YELLOW, "paint")
    yield box((0.01, 0.1, 0.1), (-0.165, 0, 1.07), POST_BLACK)
    yield box((0.02, 0.05, 0.05), (-0.165, 0, 0.96), (0.5, 0.5, 0.5), "metal")


def _band(p: SignpostParams) -> Parts:
    """Build two bands around the lower shaft."""
    r = 1.04 * p.radius
    for z in (1.05, 1.5):
        yield tube((0, 0, z), (0, 0, z + 0.22), r, p.second_color, "paint", sides=12, caps=False)


def _twin(p: SignpostParams) -> Parts:
    """Build a second shaft, and bars between the two."""
    y = 0.42
    yield tube((0, y, 0), (0, y, p.height), p.radius, p.color, p.material, sides=12)
    for z in (1.6, p.height - 0.3):
        yield box((0.03, y, 0.05), (0, y / 2, z), p.color, p.material)


def _arm(p: SignpostParams) -> Parts:
    """Build an arm over the road at the top, with a stay."""
    z = p.height - 0.08
    yield tube((0, 0, z), (0, -2.2, z), 0.045, p.color, p.material, end_radius=0.03, sides=8)
    yield tube((0, 0, z - 0.7), (0, -0.9, z), 0.02, p.color, p.material, sides=6)


def _hoop(p: SignpostParams) -> Parts:
    """Build a bent rail that keeps cars off the post."""
    turn = np.linspace(0, np.pi, 9)
    bow = np.column_stack([0.36 * np.cos(turn), 0.62 + 0.25 * np.sin(turn)]).tolist()
    for (y0, z0), (y1, z1) in pairwise([(0.36, 0.0), *bow, (-0.36, 0.0)]):
        ends = (0.14, y0, z0), (0.14, y1, z1)
        yield tube(*ends, 0.028, p.second_color, "metal", sides=8, caps=False)


def _solar(p: SignpostParams) -> Parts:
    """Build a tilted solar panel over a battery box."""
    z = p.height
    panel = [(-0.2, -0.3, z), (-0.2, 0.3, z), (0.22, 0.3, z + 0.32), (0.22, -0.3, z + 0.32)]
    frame = [(x + 0.02, y * 1.06, w - 0.03) for x, y, w in panel]
    yield polygon(panel, (0.01, 0.015, 0.04), "glass")
    yield polygon(frame, WHITE, "metal")
    yield box((0.2, 0.26, 0.34), (0.17, 0, z - 0.6), POST_STEEL, "metal")


def _beacon(p: SignpostParams) -> Parts:
    """Build the amber globe of a crossing."""
    level = np.linspace(-0.95, 1.0, 8) * np.pi / 2
    globe = [(p.height + 0.19 + 0.17 * np.sin(a), max(0.17 * np.cos(a), 0.005)) for a in level]
    yield turned(globe, (0.75, 0.30, 0.02), "lamp", 12)


def _plate(p: SignpostParams) -> Parts:
    """Build a flange with bolts at the foot."""
    yield box((0.3, 0.3, 0.02), (0, 0, 0), p.color, "metal")
    for x, y in product((0.11, -0.11), repeat=2):
        yield box((0.03, 0.03, 0.05), (x, y, 0.02), POST_STEEL, "metal")


_EXTRAS = {
    "bin": _bin, "button": _button, "band": _band, "twin": _twin, "arm": _arm, "hoop": _hoop,
    "solar": _solar, "beacon": _beacon, "plate": _plate,
}  # fmt: skip


def signpost(p: SignpostParams) -> Asset:
    """Build the post."""
    around = partial(turned, material=p.material, sides=p.sides, phase=0.5)
    r, top = p.radius, p.height
    bands = zip(pairwise(np.linspace(0, top, p.bands + 1)), cycle((p.color, p.second_color)))
    parts = [around([(low, r), (high, r)], color) for (low, high), color in bands]
    if p.cap == "ball":
        ball = [(top - 0.02 + 0.07 * k, b * r) for k, b in enumerate((1.0, 0.5, 1.15, 1.15, 0.3))]
        parts.append(around([(min(z, MAX_HEIGHT), b) for z, b in ball], p.second_color))
    elif p.cap == "point":
        tip = [(top - 0.12, 1.1 * r), (top - 0.08, 1.1 * r), (top, 0.1 * r)]
        parts.append(around(tip, p.color))
    for z in np.linspace(0.25, 0.95, p.rings + 2)[1:-1] * top:
        ring = [(z - 0.05, r), (z, 1.15 * r), (z + 0.05, r)]
        parts.append(around(ring, p.second_color))
    if p.foot:
        outline = ((0.0, 1.9), (0.06, 1.9), (0.1, 1.5), (0.85 * p.foot, 1.4), (p.foot, 1.0))
        parts.append(around([(z, factor * r) for z, factor in outline], p.color))
    return merge(*parts, *(_EXTRAS[p.extra](p) if p.extra else ()))


FAMILY = Family(
    "signpost", TrainId.POLE, tuple(_KINDS), sample_signpost, signpost,
    count=16, size=Size((0.8, 12), (0.8, 12)), tone=2.1, line=None,
)  # fmt: skip
