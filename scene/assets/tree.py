"""Trees: wood that forks from the trunk down to twigs, and leaves in tufts at its ends.

A tree grows by generations: limbs leave the trunk, branches the limbs, shoots the branches and twigs the
shoots. The length of the limbs by height (the crown's outline), their angle and their bend determine the
species, the share of shoots with a tuft of leaves the season.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from scene.assets.family import Family, Size
from scene.assets.parts.draw import between, near, sample_fields
from scene.assets.parts.foliage import AUTUMNS, GREENS, leaf_cards, slivers, tubes, tufts
from scene.assets.parts.palette import BLACK, IVY, pick
from scene.classes import TrainId
from scene.mesh.asset import Asset, Color, Parts, merge, reshaped, translate, vary
from scene.mesh.solids import tube

GOLDEN = 2.399963
"""The golden angle (radians): consecutive limbs turned by it around the trunk never line up."""
SHOOT, TWIG = 0.07, 0.05
"""Width of shoots and of the thinnest twigs (metres): each stands for a bundle of real ones."""
DENSE = 12
"""Tufts with at least this many leaves are opaque."""
YOUNG = 1.35
"""Brightness of young wood, relative to the trunk's bark."""
REACH = 7.5
"""Largest distance of a twig from the foot in x or y (metres)."""
TOP = 0.985
"""Share of the height that the wood reaches, so that the leaves end at the height."""


class TreeParams(NamedTuple):
    """A trunk, four generations of wood, and leaves."""

    height: float  # m
    trunk: float  # height of the first limb, m
    radius: float  # of the trunk at the foot, m
    crown: float  # length of the longest limb, m
    outline: str  # of the crown, see ``_OUTLINES``
    leader: float  # share of the height that the trunk reaches
    limbs: int  # number of limbs
    angle: float  # between limb and trunk, degrees
    lift: float  # bend of limbs and branches, up above 0, down below
    forks: tuple[int, int, int]  # branches of a limb, shoots of a branch, twigs of a shoot
    leafy: float  # share of the shoots with a tuft
    leaves_per_tuft: int
    tuft: float  # radius of a tuft, m
    leaf: float  # size of a leaf, m
    leaf_color: Color
    bark_color: Color
    staked: bool  # a young tree between two stakes
    ivy: int  # leaves of ivy around the trunk
    seed: int


class _Kind(NamedTuple):
    """What distinguishes a kind of tree."""

    leafy: bool
    fields: dict[str, Any] = {}  # values and rules, drawn in this order
    rusty: bool = False  # autumn colours


_IN_LEAF, _BARE = True, False
_OF_HEIGHT = ("trunk", "crown", "radius")
"""Fields given as shares of the height in the table, except for a staked tree's radius, in metres."""
_KINDS: dict[str, _Kind] = {
    "bare lime": _Kind(_BARE),
    "plane": _Kind(_IN_LEAF, dict(
        crown=0.38, angle=58.0, leader=0.8, bark_color=near(0.2, (0.16, 0.15, 0.12)), tuft=0.5)),
    "half bare": _Kind(_BARE, dict(
        forks=(5, 4, 2), leafy=between(0.25, 0.4), leaves_per_tuft=7, tuft=0.35, leaf=0.17), rusty=True),
    "conifer": _Kind(_IN_LEAF, dict(
        trunk=0.08, crown=0.24, radius=0.015, outline="cone", leader=1.0, limbs=38, angle=92.0,
        lift=-0.05, forks=(4, 0, 0), leafy=1.0, leaves_per_tuft=15, tuft=0.36, leaf=0.26,
        leaf_color=near(0.25, (0.055, 0.072, 0.052)))),
    "bare broad": _Kind(_BARE, dict(
        trunk=0.2, crown=between(0.42, 0.5), radius=0.034, outline="vase", leader=0.6, limbs=11,
        angle=62.0, lift=0.2, forks=(7, 7, 5))),
    "poplar": _Kind(_IN_LEAF, dict(
        height=between(10, 13.8), trunk=0.1, crown=0.19, radius=0.018, outline="column",
        leader=0.97, limbs=24, angle=20.0, lift=0.1, forks=(4, 2, 0), tuft=0.36, leaves_per_tuft=15)),
    "pollard": _Kind(_BARE, dict(
        height=between(5, 7.5), trunk=0.5, crown=0.2, radius=0.04, outline="top", leader=0.62,
        limbs=9, angle=65.0, lift=0.25, forks=(9, 4, 0),
        bark_color=near(0.2, (0.10, 0.085, 0.065)))),
    "willow": _Kind(_IN_LEAF, dict(
        height=between(6.5, 9.5), trunk=0.28, crown=0.5, radius=0.035, outline="vase", leader=0.6,
        limbs=12, angle=40.0, lift=-0.35, forks=(7, 5, 0), leafy=1.0, leaves_per_tuft=6, tuft=0.26, leaf=0.15,
        leaf_color=near(0.2, (0.22, 0.215, 0.085)))),
    "young": _Kind(_IN_LEAF, dict(
        height=between(4.2, 6), trunk=0.42, crown=0.2, radius=0.05, limbs=9, leaves_per_tuft=9,
        forks=(4, 2, 0), tuft=0.25, leaf=0.14, staked=True)),
    "birch": _Kind(_BARE, dict(
        trunk=0.25, crown=0.25, radius=0.013, angle=36.0, lift=-0.12, leader=1.0, limbs=18,
        forks=(5, 5, 2), leafy=0.3, leaves_per_tuft=5, leaf=0.12, leaf_color=near(0.25, (0.22, 0.18, 0.04)),
        bark_color=near(0.1, (0.42, 0.41, 0.38)))),
    "spreading": _Kind(_IN_LEAF, dict(
        height=between(5.5, 7.5), trunk=0.28, crown=0.62, radius=0.03, outline="vase", leader=0.62,
        limbs=11, angle=66.0, lift=0.1, tuft=0.5, leaves_per_tuft=20)),
    "bare poplar": _Kind(_BARE, dict(
        height=between(10.5, 14), trunk=0.14, crown=0.2, radius=0.018, outline="column",
        leader=0.97, limbs=24, angle=16.0, lift=0.12, forks=(5, 4, 2))),
    "autumn": _Kind(_IN_LEAF, dict(leafy=0.7, angle=45.0), rusty=True),
    "ivied": _Kind(_BARE, dict(ivy=1100, leaf_color=IVY, leaf=0.22, limbs=12, forks=(5, 5, 3))),
    "pine": _Kind(_IN_LEAF, dict(
        trunk=0.55, crown=0.26, outline="top", leader=0.92, limbs=12, angle=78.0, lift=0.1,
        forks=(5, 3, 0), leafy=0.8, leaves_per_tuft=14, tuft=0.36, leaf=0.2,
        bark_color=near(0.2, (0.20, 0.09, 0.045)),
        leaf_color=near(0.25, (0.075, 0.095, 0.062)))),
    "young bare": _Kind(_BARE, dict(
        height=between(4.5, 6.5), trunk=0.4, crown=0.2, radius=0.045, limbs=9, angle=38.0,
        forks=(4, 4, 2), staked=True)),
    "cypress": _Kind(_IN_LEAF, dict(
        height=between(5, 9), trunk=0.05, crown=0.16, radius=0.016, outline="column", leader=0.97,
        limbs=30, angle=14.0, forks=(4, 2, 0), leafy=1.0, leaves_per_tuft=11, tuft=0.28, leaf=0.21,
        leaf_color=near(0.25, (0.050, 0.066, 0.046)))),
    "bare vase": _Kind(_BARE, dict(
        height=between(6.5, 9.5), trunk=0.2, crown=0.62, radius=0.026, outline="vase", leader=0.32,
        limbs=8, angle=28.0, lift=0.04, forks=(7, 5, 4),
        bark_color=near(0.25, (0.085, 0.050, 0.042)))),
}  # fmt: skip


def sample_tree(rng: np.random.Generator, kind: str) -> TreeParams:
    """Draw a tree of one kind."""
    entry = _KINDS[kind]
    height = float(rng.uniform(9, 15))
    green, rust = pick(rng, GREENS, 0.25), pick(rng, AUTUMNS, 0.25)
    bark = vary(rng, (0.105, 0.085, 0.070), 0.35)
    p = TreeParams(
        height=height, trunk=height * float(rng.uniform(0.18, 0.28)), radius=0.021 * height,
        crown=height * float(rng.uniform(0.32, 0.40)), outline="oval", leader=0.9, limbs=15,
        angle=float(rng.uniform(42, 58)), lift=0.16, forks=(6, 6, 5), leafy=0.0, leaves_per_tuft=0, tuft=0.3,
        leaf=0.2, leaf_color=rust if entry.rusty else green, bark_color=bark, staked=False, ivy=0,
        seed=int(rng.integers(2**31)),
    )  # fmt: skip
    share = float(rng.uniform(0.85, 1.0))
    if entry.leafy:
        p = p._replace(forks=(5, 3, 0), leafy=share, leaves_per_tuft=20, tuft=0.6, leaf=0.29)
    p = sample_fields(rng, p, **entry.fields)
    names = [n for n in _OF_HEIGHT if n in entry.fields and not (n == "radius" and p.staked)]
    return p._replace(**{name: getattr(p, name) * p.height for name in names})


_OUTLINES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "oval": lambda level: np.sqrt(np.clip(1 - (1.5 * level - 0.55) ** 2, 0.06, 1)),
    "cone": lambda level: 1.05 - 0.95 * level,
    "column": lambda level: 0.85 - 0.45 * level**2,
    "vase": lambda level: 1.0 - 0.35 * level,
    "top": lambda level: 0.75 + 0.25 * level,
}
"""Outlines of crowns: length of limbs by level (0 foot .. 1 top), as a share of the longest."""


class _Wood(NamedTuple):
    """One generation of branches."""

    lines: np.ndarray  # f64[n, points, 3]
    radius: np.ndarray  # f64[n, points]

    @property
    def length(self) -> np.ndarray:
        return np.linalg.norm(np.diff(self.lines, axis=1), axis=2).sum(1)


def _grow(
    rng: np.random.Generator, start: np.ndarray, heading: np.ndarray, length: np.ndarray,
    radius: np.ndarray, lift: float, points: int,
) -> _Wood:  # fmt: skip
    """Grow branches from ``start`` f64[n, 3] that wander off their ``heading`` and bend by ``lift``."""
    lines = [start]
    step = (length / (points - 1))[:, None]
    for _ in range(points - 1):
        heading = heading + rng.normal(0, 0.16, heading.shape) + [0, 0, lift]
        heading /= np.linalg.norm(heading, axis=1, keepdims=True)
        lines.append(lines[-1] + step * heading)
    taper = np.linspace(1, 0.3, points)
    return _Wood(np.stack(lines, 1), radius[:, None] * taper)


def _fork(
    rng: np.random.Generator, parents: _Wood, children: int, lift: float, points: int
) -> _Wood:
    """Grow ``children`` branches along the outer part of each parent; the first continues from its tip."""
    n, last_point = len(parents.lines), parents.lines.shape[1] - 1
    share = 1 - (np.arange(children) + rng.uniform(0, 0.8, (n, children))) / children * 0.75
    share[:, 0] = 1.0
    position = np.minimum(share * last_point, last_point - 1e-6)
    knot, fraction = position.astype(int), (position % 1)[..., None]
    parent = np.arange(n)[:, None]
    low, high = parents.lines[parent, knot], parents.lines[parent, knot + 1]
    along = high - low
    along /= np.linalg.norm(along, axis=2, keepdims=True).clip(1e-9)
    side = np.cross(along, rng.normal(size=along.shape))
    side /= np.linalg.norm(side, axis=2, keepdims=True).clip(1e-9)
    divergence = np.where(share == 1, rng.uniform(0.1, 0.35, share.shape),
                   rng.uniform(0.55, 1.15, share.shape))[..., None]  # fmt: skip
    heading = np.cos(divergence) * along + np.sin(divergence) * side
    length = parents.length[:, None] * rng.uniform(0.38, 0.62, share.shape)
    radius = 0.62 * parents.radius[parent, knot]
    start = low + fraction * along * np.linalg.norm(high - low, axis=2, keepdims=True)
    flat = (start.reshape(-1, 3), heading.reshape(-1, 3), length.ravel(), radius.ravel())
    return _grow(rng, *flat, lift, points)


def _trunk(rng: np.random.Generator, p: TreeParams) -> _Wood:
    """Grow a trunk that leans and wanders a little, with a flare at the foot."""
    points = 9
    level = np.linspace(0, p.leader, points)
    wander = np.cumsum(rng.normal(0, 0.012 * p.height, (points, 2)), 0) * level[:, None]
    line = np.column_stack([wander, level * p.height * TOP])
    share = np.linspace(0, 1, points)
    taper = 1 - 0.85 * share**1.3 if p.leader > 0.7 else 1 - 0.4 * share
    taper[0] = 1.35
    return _Wood(line[None], p.radius * taper[None])


def _limbs(rng: np.random.Generator, p: TreeParams, trunk: _Wood) -> _Wood:
    """Grow limbs around the trunk, from the lowest to the tip of the leader."""
    level = np.linspace(0, 1, p.limbs) ** 0.9
    top = p.leader * p.height * TOP
    foot = min(p.trunk, 0.9 * top)
    z = foot + (0.98 * top - foot) * level
    line, thickness = trunk.lines[0], trunk.radius[0]
    start = np.column_stack([np.interp(z, line[:, 2], line[:, k]) for k in (0, 1)] + [z])
    turn = GOLDEN * np.arange(p.limbs) + rng.uniform(0, 2 * np.pi) + rng.normal(0, 0.2, p.limbs)
    tilt = np.radians(p.angle * (1.1 - 0.35 * level) * rng.uniform(0.85, 1.15, p.limbs))
    heading = np.column_stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn),
                               np.cos(tilt)])  # fmt: skip
    length = p.crown * _OUTLINES[p.outline](level) * rng.uniform(0.8, 1.1, p.limbs)
    radius = np.minimum(0.5 * np.interp(z, line[:, 2], thickness), 0.045 * length + 0.01)
    return _grow(rng, start, heading, length, radius, p.lift, 4 if p.limbs > 16 else 5)


def _ivy(rng: np.random.Generator, p: TreeParams, trunk: _Wood) -> Asset:
    """Build leaves around the lower trunk, denser near the ground."""
    z = 0.1 + rng.random(p.ivy) ** 1.4 * 0.55 * p.height
    turn, distance = rng.uniform(0, 2 * np.pi, p.ivy), 2.2 * p.radius * rng.uniform(0.6, 1.3, p.ivy)
    line = trunk.lines[0]
    x, y = (np.interp(z, line[:, 2], line[:, k]) for k in (0, 1))
    leaves = np.column_stack([x + distance * np.cos(turn), y + distance * np.sin(turn), z])
    return leaf_cards(rng, leaves, p.leaf, IVY)


def _stakes(p: TreeParams) -> Parts:
    """Build two posts next to a young tree and the strap that ties it to them."""
    wood, side = (0.22, 0.15, 0.085), 0.28
    post = tube((0, 0, 0), (0, 0, 1.3), 0.04, wood, "wood", sides=6)
    yield translate(post, (0, -side, 0))
    yield translate(post, (0, side, 0))
    yield tube((0, -side, 1.15), (0, side, 1.15), 0.025, BLACK, "rubber", sides=4)


def tree(p: TreeParams) -> Asset:
    """Build the tree."""
    rng = np.random.default_rng(p.seed)
    trunk = _trunk(rng, p)
    limbs = _limbs(rng, p, trunk)
    # Trunk and limbs are round; branches and thinner wood need fewer faces.
    generations = [limbs]
    for children, points in zip(p.forks, (3, 3, 2), strict=True):
        if children:
            generations.append(_fork(rng, generations[-1], children, p.lift, points))
    wood = [tubes(*trunk, 8, p.bark_color), tubes(*limbs, 5, p.bark_color)]
    if len(generations) > 1:
        branches = generations[1]
        wood.append(tubes(branches.lines, np.maximum(branches.radius, 0.015), 3, p.bark_color))
    for thin, width in zip(generations[2:], (SHOOT, TWIG), strict=False):
        red, green, blue = p.bark_color
        color = (YOUNG * red, YOUNG * green, YOUNG * blue)
        wood.append(slivers(rng, thin.lines[:, 0], thin.lines[:, -1], width, color))
    leaves = []
    if p.leafy:
        carriers = generations[min(2, len(generations) - 1)].lines
        tufted_shoots = carriers[rng.random(len(carriers)) < p.leafy]
        centres = tufted_shoots[:, -1] + rng.uniform(0, 0.4, (len(tufted_shoots), 1)) * (
            tufted_shoots[:, -2] - tufted_shoots[:, -1]
        )
        radii = p.tuft * rng.uniform(0.7, 1.3, len(centres))
        # No light passes through the middle of a dense tuft: two large dark leaves fill it.
        inner = np.repeat(centres, 2 if p.leaves_per_tuft >= DENSE else 0, axis=0)
        leaves = [
            tufts(rng, centres, radii, p.leaves_per_tuft, p.leaf, p.leaf_color),
            leaf_cards(rng, inner, p.tuft, p.leaf_color, 0.6),
        ]
    if p.ivy:
        leaves.append(_ivy(rng, p, trunk))
    merged = merge(*wood, *leaves, *(_stakes(p) if p.staked else []))
    return _fitted(merged, p)


def _fitted(asset: Asset, p: TreeParams) -> Asset:
    """Squeeze the tree to its height and to ``REACH``, and lift what is below the ground."""
    vertices = asset.mesh.vertices.copy()
    z = vertices[:, 2]
    high = z.max()
    if high > p.height:
        above = z > p.trunk
        squeeze = (p.height - p.trunk) / (high - p.trunk)
        z[above] = p.trunk + (z[above] - p.trunk) * squeeze
    np.maximum(z, 0, out=z)
    vertices[:, :2] *= min(1.0, REACH / np.abs(vertices[:, :2]).max())
    return reshaped(asset, vertices)


FAMILY = Family(
    "tree", TrainId.VEGETATION, tuple(_KINDS), sample_tree, tree,
    count=24, size=Size((1.5, 40), (1.5, 40)), tone=1.6, line=("tree", 0.7),
)  # fmt: skip
