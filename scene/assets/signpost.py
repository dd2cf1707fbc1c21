"""Posts that carry traffic signs and lights (class pole), standing at x = y = 0.

``MAX_RADIUS`` and ``MIN_HEIGHT`` are the agreement with the signs and lights that hang on them: any
sign fits any post.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, merge, tube, vary

KINDS: tuple[str, ...] = ("steel", "painted", "ringed", "striped", "concrete")

MAX_RADIUS = 0.06
"""No post is thicker (metres); plates hang just in front of x = -MAX_RADIUS."""
MIN_HEIGHT = 2.5
"""No post is shorter (metres)."""
MAX_HEIGHT = 4.0
"""No post is taller (metres)."""


class SignpostParams(NamedTuple):
    """A round post: one shaft in bands of two colours, with a foot, rings and a cap."""

    height: float  # m
    radius: float  # m
    bands: int  # equal lengths of alternating colour
    color: Color
    second_color: Color  # of every other band and of the rings
    rings: int  # collars around the shaft
    foot: float  # height of a thicker foot, m; 0 for none
    material: str


def sample_signpost(rng: np.random.Generator, kind: str) -> SignpostParams:
    """Draw a post of one of ``KINDS``."""
    height = float(rng.uniform(MIN_HEIGHT, MAX_HEIGHT))
    radius = float(rng.uniform(0.035, MAX_RADIUS))
    steel = vary(rng, (0.30, 0.31, 0.32), 0.2)
    plain = SignpostParams(height, radius, 1, steel, steel, 0, 0.0, "metal")
    match kind:
        case "steel":
            return plain
        case "painted":
            paints = ((0.12, 0.13, 0.14), (0.04, 0.10, 0.06), (0.03, 0.03, 0.04), (0.22, 0.22, 0.2))
            paint = vary(rng, paints[rng.integers(len(paints))])
            return plain._replace(color=paint, second_color=paint, foot=0.5, material="paint")
        case "ringed":
            black, gold = vary(rng, (0.02, 0.02, 0.025)), vary(rng, (0.35, 0.24, 0.06))
            return plain._replace(
                color=black, second_color=gold, rings=3, foot=0.35, material="paint"
            )
        case "striped":
            white, other = vary(rng, (0.6, 0.6, 0.58)), ((0.45, 0.03, 0.02), (0.03, 0.03, 0.03))
            return plain._replace(
                bands=int(rng.integers(4, 7)), color=other[rng.integers(2)], second_color=white,
                material="paint",
            )  # fmt: skip
        case "concrete":
            grey = vary(rng, (0.33, 0.31, 0.28))
            return plain._replace(
                radius=MAX_RADIUS, color=grey, second_color=grey, material="concrete"
            )
    raise ValueError(f"unknown kind of signpost {kind!r}; known: {', '.join(KINDS)}")


def signpost(params: SignpostParams) -> Asset:
    """Build the post."""
    p = params
    levels = np.linspace(0, p.height, p.bands + 1)
    shaft = [
        tube((0, 0, low), (0, 0, high), p.radius, (p.color, p.second_color)[band % 2], p.material,
             sides=4 if p.bands > 1 else 8, caps=False)
        for band, (low, high) in enumerate(pairwise(levels))
    ]  # fmt: skip
    cap = tube(
        (0, 0, p.height - 0.03), (0, 0, p.height), p.radius, p.second_color, p.material,
        end_radius=0.4 * p.radius, sides=4, caps=False,
    )  # fmt: skip
    collars = [
        tube((0, 0, z - 0.06), (0, 0, z + 0.06), 1.15 * p.radius, p.second_color, p.material,
             sides=4, caps=False)
        for z in np.linspace(0.3, 0.9, p.rings + 2)[1:-1] * p.height
    ]  # fmt: skip
    parts = [*shaft, cap, *collars]
    if p.foot:
        foot = tube((0, 0, 0), (0, 0, p.foot), 1.5 * p.radius, p.color, p.material,
                    end_radius=p.radius, sides=5, caps=False)  # fmt: skip
        parts.append(foot)
    return merge(*parts)
