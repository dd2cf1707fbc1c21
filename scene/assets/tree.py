"""Trees: a recursively branching skeleton, and leaves as ragged clumps and loose cards.

``clump`` and ``leaf_cards`` also make the bushes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import trimesh

from scene.asset import Asset, Color, Point, merge, shade, solid, triangles, tube, vary

KINDS: tuple[str, ...] = (
    "round", "poplar", "bare", "spreading", "conifer", "half bare", "young",
)  # fmt: skip

GREENS: tuple[Color, ...] = (
    (0.04, 0.08, 0.02), (0.06, 0.10, 0.02), (0.03, 0.06, 0.025), (0.09, 0.11, 0.03),
)  # fmt: skip
BROWNS: tuple[Color, ...] = ((0.12, 0.07, 0.025), (0.10, 0.085, 0.03), (0.07, 0.075, 0.03))


class TreeParams(NamedTuple):
    """A trunk, limbs that fork ``forks`` times, and a crown of clumps and cards."""

    height: float  # m
    trunk: float  # height of the first limbs, m
    radius: float  # of the trunk at the foot, m
    crown: float  # radius of the crown, m
    limbs: int  # that leave the trunk
    forks: int  # generations of branches after the limbs
    twigs: int  # thin ends of each last branch
    clumps: int  # blobs of leaves
    cards: int  # loose leaves
    card: float  # size of a loose leaf, m
    cone: float  # 0 an ellipsoid crown .. 1 a cone that is widest at its foot
    leaf_color: Color
    bark_color: Color
    seed: int


def sample_tree(rng: np.random.Generator, kind: str) -> TreeParams:
    """Draw a tree of one of ``KINDS``."""
    height = float(rng.uniform(6.0, 10.5))
    round_ = TreeParams(
        height=height, trunk=height * float(rng.uniform(0.24, 0.34)),
        radius=height * float(rng.uniform(0.018, 0.026)),
        crown=height * float(rng.uniform(0.28, 0.36)),
        limbs=5, forks=0, twigs=0, clumps=13, cards=110, card=0.5, cone=0.0,
        leaf_color=vary(rng, GREENS[rng.integers(len(GREENS))], 0.25),
        bark_color=vary(rng, (0.075, 0.06, 0.045), 0.3), seed=int(rng.integers(2**31)),
    )  # fmt: skip
    bare = round_._replace(
        limbs=6, forks=2, twigs=4, clumps=0, cards=0, crown=height * float(rng.uniform(0.26, 0.36))
    )
    match kind:
        case "round":
            return round_
        case "poplar":
            height = float(rng.uniform(8.5, 12.0))
            return round_._replace(
                height=height, trunk=0.12 * height, crown=height * float(rng.uniform(0.11, 0.15)),
                radius=0.02 * height, clumps=15, limbs=2,
            )  # fmt: skip
        case "bare":
            return bare
        case "spreading":
            height = float(rng.uniform(5.0, 8.0))
            return round_._replace(
                height=height, trunk=0.33 * height, crown=height * float(rng.uniform(0.42, 0.52)),
                radius=0.035 * height, clumps=14, card=0.6,
            )  # fmt: skip
        case "conifer":
            return round_._replace(
                height=float(rng.uniform(6.0, 12.0)), trunk=float(rng.uniform(0.3, 0.8)),
                crown=float(rng.uniform(1.5, 2.3)), cone=1.0, clumps=0, cards=340, card=0.9,
                limbs=0, leaf_color=vary(rng, (0.022, 0.045, 0.022), 0.25),
            )  # fmt: skip
        case "half bare":
            return bare._replace(
                twigs=2, cards=220, card=0.3,
                leaf_color=vary(rng, BROWNS[rng.integers(len(BROWNS))], 0.25),
            )  # fmt: skip
        case "young":
            height = float(rng.uniform(4.0, 5.5))
            return round_._replace(
                height=height, trunk=0.45 * height, radius=0.05, clumps=7, cards=90, card=0.35,
                crown=height * float(rng.uniform(0.17, 0.23)), limbs=3,
            )  # fmt: skip
    raise ValueError(f"unknown kind of tree {kind!r}; known: {', '.join(KINDS)}")


def clump(rng: np.random.Generator, centre: Point, radii: Point, color: Color) -> Asset:
    """A lumpy blob of leaves, 20 faces, darker below; its corners stick out unevenly."""
    sphere = trimesh.creation.icosphere(subdivisions=0)
    stretch = rng.uniform(0.65, 1.3, (len(sphere.vertices), 1))
    vertices = np.asarray(sphere.vertices) * stretch * np.asarray(radii) + np.asarray(centre)
    blob = solid(vertices, sphere.faces, color, "foliage")
    up = np.asarray(sphere.face_normals)[:, 2]
    return shade(blob, (0.85 + 0.3 * up) * rng.uniform(0.65, 1.35, len(up)))


def leaf_cards(rng: np.random.Generator, centres: np.ndarray, size: float, color: Color) -> Asset:
    """Loose triangles about ``centres`` [n, 3], each turned and toned at random."""
    corners = rng.normal(size=(len(centres), 3, 3))
    corners -= corners.mean(axis=1, keepdims=True)
    corners *= size / np.linalg.norm(corners, axis=2, keepdims=True).clip(0.3) * 0.7
    cards = triangles(centres[:, None] + corners, color, "foliage")
    return shade(cards, rng.uniform(0.55, 1.45, len(centres)))


def _directions(rng: np.random.Generator, count: int) -> np.ndarray:
    """Unit vectors [count, 3], even over the sphere."""
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


class _Branch(NamedTuple):
    start: np.ndarray
    end: np.ndarray
    radius: float
    level: int


def _grow(
    rng: np.random.Generator, params: TreeParams, start: np.ndarray, heading: np.ndarray,
    length: float, radius: float, level: int,
) -> list[_Branch]:  # fmt: skip
    """A branch and all that forks from it, kept below the tree's height."""
    end = start + heading * length
    end[2] = min(end[2], params.height - 0.1 * rng.random())
    branches = [_Branch(start, end, radius, level)]
    if level > params.forks:
        return branches
    children = 3 if level < params.forks else params.twigs
    for child in range(children):
        along = start + (end - start) * rng.uniform(0.45, 1.0 if child else 0.95)
        turned = heading + 0.75 * _directions(rng, 1)[0] + [0, 0, 0.25]
        turned /= np.linalg.norm(turned)
        branches += _grow(
            rng, params, along, turned, length * rng.uniform(0.5, 0.8), 0.55 * radius, level + 1
        )
    return branches


def _skeleton(rng: np.random.Generator, params: TreeParams) -> list[_Branch]:
    """Limbs around the upper trunk with everything that forks from them."""
    p = params
    span = p.height - p.trunk
    branches = []
    for limb in range(p.limbs):
        turn = 2 * np.pi * (limb + rng.uniform(-0.3, 0.3)) / p.limbs
        share = limb / max(p.limbs, 1)
        out, up = p.crown * (1 - 0.5 * share), 0.5 * span * rng.uniform(0.6, 1.0)
        heading = np.array([out * np.cos(turn), out * np.sin(turn), up]) * 0.62
        length = float(np.linalg.norm(heading))
        start = np.array([0, 0, p.trunk + 0.45 * span * share])
        branches += _grow(rng, p, start, heading / length, length, 0.5 * p.radius, 0)
    return branches


def _wood(rng: np.random.Generator, params: TreeParams, branches: list[_Branch]) -> Asset:
    """Trunk and limbs as tubes, branches as thinner ones, twigs as slivers."""
    p = params
    tip = p.trunk + 0.75 * (p.height - p.trunk)
    parts = [
        tube((0, 0, 0), (0, 0, p.trunk), p.radius, p.bark_color, "bark", end_radius=0.75 * p.radius,
             sides=6, caps=False),
        tube((0, 0, p.trunk), (0, 0, tip), 0.75 * p.radius, p.bark_color, "bark",
             end_radius=0.15 * p.radius, sides=4, caps=False),
    ]  # fmt: skip
    slivers = []
    for branch in branches:
        if branch.level < 2:
            parts.append(
                tube(tuple(branch.start), tuple(branch.end), branch.radius, p.bark_color, "bark",
                     end_radius=0.5 * branch.radius, sides=4 - branch.level, caps=False)
            )  # fmt: skip
        else:
            width = max(branch.radius, 0.02)
            across = np.cross(branch.end - branch.start, _directions(rng, 1)[0] + [2, 0, 0])
            across *= width / np.linalg.norm(across).clip(1e-6)
            slivers.append([branch.start - across, branch.start + across, branch.end])
    if slivers:
        parts.append(triangles(np.array(slivers), p.bark_color, "bark"))
    return merge(*parts)


def _crown_points(
    rng: np.random.Generator, params: TreeParams, count: int, inner: float
) -> np.ndarray:
    """Points [count, 3] in the crown, none nearer its axis than ``inner`` of its radius."""
    p = params
    middle, half = (p.height + p.trunk) / 2, (p.height - p.trunk) / 2
    sphere = _directions(rng, count) * rng.uniform(inner, 1.0, (count, 1))
    turn, level = rng.uniform(0, 2 * np.pi, count), 1 - np.sqrt(rng.uniform(0, 1, count))
    out = (1 - level) * rng.uniform(max(inner, 0.5), 1.0, count)
    cone = np.column_stack([out * np.cos(turn), out * np.sin(turn), 2 * level - 1])
    unit = (1 - p.cone) * sphere + p.cone * cone
    return unit * [p.crown, p.crown, half] + [0, 0, middle]


def _leaves(rng: np.random.Generator, params: TreeParams, branches: list[_Branch]) -> list[Asset]:
    p = params
    parts = []
    blob = p.crown * 1.15 * max(p.clumps, 1) ** (-1 / 3)
    tall = blob * np.clip((p.height - p.trunk) / (2 * p.crown), 0.7, 1.6)
    for centre in _crown_points(rng, p, p.clumps, 0.3) if p.clumps else ():
        centre[2] = np.clip(centre[2], p.trunk + 0.4 * tall, p.height - 0.6 * tall)
        parts.append(clump(rng, tuple(centre), (blob, blob, tall), p.leaf_color))
    if p.cards and p.forks:
        last = [b for b in branches if b.level > 0]
        picks = rng.integers(len(last), size=p.cards)
        along = rng.uniform(0.3, 1.0, p.cards)
        points = [
            last[i].start + (last[i].end - last[i].start) * t
            for i, t in zip(picks, along, strict=True)
        ]
        parts.append(leaf_cards(rng, np.array(points), p.card, p.leaf_color))
    elif p.cards:
        parts.append(leaf_cards(rng, _crown_points(rng, p, p.cards, 0.75), p.card, p.leaf_color))
    return parts


def tree(params: TreeParams) -> Asset:
    """Build the tree."""
    rng = np.random.default_rng(params.seed)
    branches = _skeleton(rng, params)
    return merge(_wood(rng, params, branches), *_leaves(rng, params, branches))
