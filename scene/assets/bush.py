"""Bushes (class vegetation): clipped hedges, loose shrubs, climbers, planted beds and tall grass."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from scene.assets.family import Family, Size
from scene.assets.parts.draw import between, near, sample_fields
from scene.assets.parts.foliage import AUTUMNS, GREENS, directions, leaf_cards, slivers, tufts
from scene.assets.parts.palette import IVY, pick
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, merge, reshaped, shade, solid
from scene.mesh.solids import box, triangles

PETALS: tuple[Color, ...] = (
    (0.55, 0.05, 0.06), (0.60, 0.45, 0.05), (0.50, 0.12, 0.35), (0.62, 0.60, 0.55),
)  # fmt: skip


class BushParams(NamedTuple):
    """A body of one ``form`` and what grows on it."""

    form: str  # see ``_FORMS``
    length: float  # along x, m
    width: float  # along y, m
    height: float  # m
    parts: int  # mounds, stems or blades
    leaves: int  # loose leaves on the surface
    leaf: float  # size of a leaf, m
    color: Color
    bloom: Color  # of petals, or of the wood of stems
    blooms: int  # petals on the surface
    seed: int


_KINDS: dict[str, dict[str, Any]] = {
    "hedge": {},
    "round": {},
    "ivy": dict(
        length=between(2.4, 3.8), width=0.7, height=between(1.2, 2.2), parts=7, leaves=1300,
        leaf=0.15, color=near(0.3, IVY),
    ),
    "tall": dict(
        length=between(0.9, 1.4), width=between(0.9, 1.2), height=between(1.8, 2.4), parts=7,
        leaves=1100,
    ),
    "bare": dict(
        form="stems", parts=130, leaves=0, height=between(1.2, 2.1),
        bloom=near(0.35, (0.13, 0.06, 0.04)),
    ),
    "beech hedge": dict(color=near(0.3, *AUTUMNS[1:]), height=between(1.5, 2.3)),
    "planter": dict(
        form="trough", length=between(1.2, 2.2), width=between(0.5, 0.8), height=between(0.8, 1.2),
        parts=4, leaves=500, blooms=120,
    ),
    "grass": dict(
        form="blades", length=between(1.0, 2.6), width=between(0.6, 1.2), height=between(0.7, 1.3),
        parts=900, leaves=0, color=near(0.3, (0.21, 0.19, 0.085)),
    ),
    "flowers": dict(
        length=between(1.8, 3.4), width=between(0.8, 1.3), height=between(0.4, 0.7), parts=9,
        leaves=700, leaf=0.09, blooms=420,
    ),
    "box balls": dict(
        length=between(2.0, 3.4), width=0.9, height=between(0.7, 1.0), parts=3, leaves=1200,
        leaf=0.06, color=near(0.25, (0.065, 0.085, 0.04)),
    ),
    "laurel": dict(
        length=between(2.0, 3.2), width=between(1.0, 1.6), height=between(1.3, 2.0), parts=8,
        leaf=0.19, color=near(0.2, (0.085, 0.11, 0.05)),
    ),
    "bramble": dict(
        form="stems", length=between(1.8, 3.2), width=between(1.0, 1.8), height=between(0.8, 1.4),
        parts=110, leaves=420, leaf=0.12, bloom=near(0.2, (0.11, 0.05, 0.04)),
    ),
}  # fmt: skip
"""Values and rules by which a kind differs from a round bush or a hedge."""


def sample_bush(rng: np.random.Generator, kind: str) -> BushParams:
    """Draw a bush of one kind."""
    size = float(rng.uniform(0.9, 1.7))
    round_bush = BushParams(
        form="mounds", length=size, width=size, height=size * float(rng.uniform(0.7, 0.95)), parts=5,
        leaves=900, leaf=0.11, color=pick(rng, GREENS, 0.3), bloom=pick(rng, PETALS, 0.2), blooms=0,
        seed=int(rng.integers(2**31)),
    )  # fmt: skip
    hedge = sample_fields(
        rng, round_bush, form="box", length=between(2.8, 4.2), width=between(0.6, 1.0),
        height=between(0.9, 1.9), parts=0, leaves=1500, leaf=0.1,
    )  # fmt: skip
    return sample_fields(rng, hedge if "hedge" in kind else round_bush, **_KINDS[kind])


def _box(rng: np.random.Generator, p: BushParams) -> tuple[Asset, np.ndarray]:
    """Build a clipped box with uneven faces; return it with points f64[n, 3] on its surface."""
    outline = np.array([[-1, 0], [-1.02, 0.5], [-0.97, 0.93], [-0.8, 1], [0.8, 1], [0.97, 0.93],
                        [1.02, 0.5], [1, 0]])  # fmt: skip
    stations, n = 12, len(outline)
    vertices = np.empty((stations, n, 3))
    vertices[..., 0] = np.linspace(-p.length / 2, p.length / 2, stations)[:, None]
    vertices[..., 1:] = outline * [p.width / 2, 0.97 * p.height]
    uneven = rng.normal(0, 0.035, vertices.shape)
    uneven[:, [0, -1], 2] = 0
    ring, edge = np.mgrid[0 : stations - 1, 0 : n - 1].reshape(2, -1) * [[n], [1]]
    a = ring + edge
    fan = np.column_stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)])
    faces = [np.column_stack([a, a + 1, a + n + 1]), np.column_stack([a, a + n + 1, a + n])]
    faces += [fan, fan + (stations - 1) * n]
    body = solid((vertices + uneven).reshape(-1, 3), np.concatenate(faces), p.color, "foliage")
    unit = directions(rng, p.leaves)
    unit[:, 2] = np.abs(unit[:, 2])
    unit /= np.abs(unit).max(axis=1, keepdims=True)
    ends = np.abs(unit[:, 0]) == 1
    unit[~ends, 0] = rng.uniform(-1, 1, (~ends).sum())
    return (
        shade(body, rng.uniform(0.45, 0.75, len(body.color))),
        unit * [p.length / 2, p.width / 2, p.height - p.leaf / 2],
    )


def _mounds(rng: np.random.Generator, p: BushParams, foot: float = 0.0) -> tuple[Asset, np.ndarray]:
    """Build dark lumps side by side; return them with points on and under their surface."""
    mounds = p.parts
    along = (np.linspace(-1, 1, mounds) if mounds > 1 else np.zeros(1)) * (1 - 1 / mounds) * 0.9
    share = rng.uniform(0.65, 1.0, mounds)
    share[mounds // 2] = 1.0
    height = (p.height - foot) * share
    radii = np.column_stack([np.full(mounds, max(0.62 * p.length / mounds, 0.3 * p.width)),
                             np.full(mounds, 0.42 * p.width), 0.5 * height])  # fmt: skip
    radii[:, 0] = np.minimum(radii[:, 0], 0.5 * p.length)
    sideways = rng.uniform(-0.12, 0.12, mounds) * p.width
    centres = np.column_stack(
        [along * (p.length / 2 - radii[:, 0]).clip(0), sideways, foot + 0.5 * height]
    )
    points_per_mound = -(-p.leaves // mounds)
    unit = directions(rng, mounds * points_per_mound) * rng.uniform(
        0.8, 1.0, (mounds * points_per_mound, 1)
    )
    points = np.repeat(centres, points_per_mound, 0) + unit * np.repeat(radii, points_per_mound, 0)
    core = directions(rng, mounds * 60)
    lumps = leaf_cards(
        rng, np.repeat(centres, 60, 0) + 0.6 * core * np.repeat(radii, 60, 0), 0.5 * p.width / 1.6,
        p.color, 0.5,
    )  # fmt: skip
    return lumps, points


def _trough(rng: np.random.Generator, p: BushParams) -> tuple[Asset, np.ndarray]:
    """Build mounds planted in a trough; return them with points as ``_mounds`` does."""
    high = 0.45 * p.height
    lumps, points = _mounds(rng, p, high - 0.05)
    trough = box((p.length, p.width, high), (0, 0, 0), (0.20, 0.18, 0.15), "concrete")
    return merge(trough, lumps), points


def _stems(rng: np.random.Generator, p: BushParams) -> tuple[Asset, np.ndarray]:
    """Build stems that spread from the ground, with side twigs; return them with points for leaves."""
    half = np.array([p.length, p.width]) / 2
    foot = np.column_stack([rng.uniform(-0.45, 0.45, (p.parts, 2)) * half, np.zeros(p.parts)])
    tip = directions(rng, p.parts) * [0.9 * half[0], 0.9 * half[1], 0]
    tip[:, 2] = p.height * rng.uniform(0.55, 1.0, p.parts)
    share = rng.uniform(0.3, 0.9, (3 * p.parts, 1))
    knots = np.repeat(foot, 3, 0) * (1 - share) + np.repeat(tip, 3, 0) * share
    side = knots + directions(rng, len(knots)) * 0.3 + [0, 0, 0.12]
    side = np.clip(side, [-half[0], -half[1], 0.05], [half[0], half[1], p.height])
    wood = merge(slivers(rng, foot, tip, 0.05, p.bloom), slivers(rng, knots, side, 0.022, p.bloom))
    points = side[rng.integers(len(side), size=p.leaves)]
    return wood, points


def _blades(rng: np.random.Generator, p: BushParams) -> tuple[Asset, np.ndarray]:
    """Build blades of tall grass that lean outwards, in uneven tones; return them without points."""
    half = np.array([p.length, p.width]) / 2
    foot = np.column_stack([rng.uniform(-0.75, 0.75, (p.parts, 2)) * half, np.zeros(p.parts)])
    lean = np.clip(foot[:, :2] + rng.normal(0, 0.16, (p.parts, 2)), -half, half)
    tip = np.column_stack([lean, p.height * rng.uniform(0.5, 1.0, p.parts)])
    side = directions(rng, p.parts) * [0.025, 0.025, 0]
    blades = triangles(np.stack([foot - side, foot + side, tip], 1), p.color, "foliage")
    return shade(blades, rng.uniform(0.4, 1.6, p.parts)), np.empty((0, 3))


_FORMS: dict[str, Callable[[np.random.Generator, BushParams], tuple[Asset, np.ndarray]]] = {
    "box": _box, "mounds": _mounds, "trough": _trough, "stems": _stems, "blades": _blades,
}  # fmt: skip


def bush(p: BushParams) -> Asset:
    """Build the bush."""
    rng = np.random.default_rng(p.seed)
    body, points = _FORMS[p.form](rng, p)
    parts = [body]
    if len(points):
        # Leaves low on the body are in its own shadow.
        tone = 0.55 + 0.75 * np.clip(points[:, 2] / p.height, 0, 1)
        parts.append(leaf_cards(rng, points, p.leaf, p.color, tone))
    if p.blooms:
        high = points[np.argsort(points[:, 2])[-len(points) // 2 :]]
        tuft_centres = high[rng.integers(len(high), size=p.blooms // 4)]
        parts.append(tufts(rng, tuft_centres + [0, 0, 0.04], 0.08, 4, 0.09, p.bloom))
    merged = merge(*parts)
    # Lift what is below the ground.
    return reshaped(merged, np.maximum(merged.mesh.vertices, [-np.inf, -np.inf, 0]))


FAMILY = Family(
    "bush", TrainId.VEGETATION, tuple(_KINDS), sample_bush, bush,
    count=16, size=Size((0.2, 12), (0.15, 5)), tone=1.4, line=("tree", 0.3),
)  # fmt: skip
