"""Bushes (class vegetation): lumpy bodies of leaves with loose leaves around them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import trimesh

from scene.asset import Asset, Color, merge, shade, solid, vary
from scene.assets._foliage import GREENS, clump, directions, leaf_cards

KINDS: tuple[str, ...] = ("hedge", "round", "ivy", "tall")


class BushParams(NamedTuple):
    """A box of leaves, or lumps of leaves on the ground."""

    length: float  # along x, m
    width: float  # along y, m
    height: float  # m
    lumps: int  # blobs side by side; 0 for a clipped box
    cards: int  # loose leaves on the surface
    card: float  # size of a loose leaf, m
    color: Color
    seed: int


def sample_bush(rng: np.random.Generator, kind: str) -> BushParams:
    """Draw a bush of one of ``KINDS``."""
    size = float(rng.uniform(0.8, 1.6))
    round_ = BushParams(
        length=size, width=size, height=size * float(rng.uniform(0.7, 0.95)), lumps=3, cards=60,
        card=0.22, color=vary(rng, GREENS[rng.integers(len(GREENS))], 0.3),
        seed=int(rng.integers(2**31)),
    )  # fmt: skip
    match kind:
        case "round":
            return round_
        case "hedge":
            return round_._replace(
                length=float(rng.uniform(2.5, 4.0)), width=float(rng.uniform(0.6, 1.0)),
                height=float(rng.uniform(0.9, 1.9)), lumps=0, cards=55, card=0.2,
            )  # fmt: skip
        case "ivy":
            return round_._replace(
                length=float(rng.uniform(1.8, 3.0)), width=0.6, height=float(rng.uniform(0.6, 1.2)),
                lumps=4, cards=65, card=0.3, color=vary(rng, (0.03, 0.055, 0.02), 0.3),
            )  # fmt: skip
        case "tall":
            return round_._replace(
                length=float(rng.uniform(1.0, 1.6)), width=float(rng.uniform(0.9, 1.3)),
                height=float(rng.uniform(1.8, 2.4)), lumps=4, cards=65, card=0.28,
            )  # fmt: skip
    raise ValueError(f"unknown kind of bush {kind!r}; known: {', '.join(KINDS)}")


def _hedge(rng: np.random.Generator, params: BushParams) -> Asset:
    """A clipped box whose faces are uneven: rings around the length, closed at both ends."""
    p = params
    outline = np.array([[-1, 0], [-1, 0.55], [-0.85, 1], [0.85, 1], [1, 0.55], [1, 0]])
    stations, n = 8, len(outline)
    vertices = np.empty((stations, n, 3))
    vertices[..., 0] = np.linspace(-p.length / 2, p.length / 2, stations)[:, None]
    vertices[..., 1:] = outline * [p.width / 2, p.height]
    uneven = rng.normal(0, 0.06, vertices.shape)
    uneven[:, [0, -1], 2] = 0
    ring, edge = np.mgrid[0 : stations - 1, 0 : n - 1].reshape(2, -1) * [[n], [1]]
    a = ring + edge
    fan = np.column_stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)])
    faces = [np.column_stack([a, a + 1, a + n + 1]), np.column_stack([a, a + n + 1, a + n])]
    faces += [fan, fan + (stations - 1) * n]
    body = solid((vertices + uneven).reshape(-1, 3), np.concatenate(faces), p.color, "foliage")
    return shade(body, rng.uniform(0.7, 1.3, len(body.color)))


def _lumps(rng: np.random.Generator, params: BushParams) -> list[Asset]:
    """Blobs side by side, the first the highest."""
    p = params
    blobs = []
    for i in range(p.lumps):
        share = 1.0 if i == 0 else float(rng.uniform(0.5, 0.85))
        along, across = rng.uniform(-0.3, 0.3, 2) * (i > 0)
        centre = (float(along) * p.length, float(across) * p.width, 0.45 * share * p.height)
        radii = (0.34 * p.length, 0.4 * p.width, 0.5 * share * p.height)
        blobs.append(clump(rng, centre, radii, p.color))
    return blobs


def _surface_points(rng: np.random.Generator, params: BushParams) -> np.ndarray:
    """Points [cards, 3] on the upper surface of the bush."""
    p = params
    unit = directions(rng, p.cards)
    unit[:, 2] = np.abs(unit[:, 2])
    if not p.lumps:
        unit /= np.abs(unit).max(axis=1, keepdims=True)
        unit[:, 0] = rng.uniform(-1, 1, p.cards)
    return unit * [p.length / 2, p.width / 2, p.height - p.card / 2]


def bush(params: BushParams) -> Asset:
    """Build the bush."""
    rng = np.random.default_rng(params.seed)
    body = _lumps(rng, params) if params.lumps else [_hedge(rng, params)]
    cards = leaf_cards(rng, _surface_points(rng, params), params.card, params.color)
    whole = merge(*body, cards)
    # What would be below the ground lies on it.
    vertices = np.maximum(whole.mesh.vertices, [-np.inf, -np.inf, 0])
    mesh = trimesh.Trimesh(vertices, whole.mesh.faces, process=False)
    return whole._replace(mesh=mesh)
