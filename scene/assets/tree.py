"""Trees: a recursively branching skeleton, and leaves as ragged clumps and loose cards."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scene.asset import Asset, Color, merge, triangles, tube, vary
from scene.assets._foliage import GREENS, clump, directions, leaf_cards

KINDS: tuple[str, ...] = (
    "round", "poplar", "bare", "spreading", "conifer", "half bare", "young", "bare broad",
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
    cards: int  # loose leaves: around the blobs, else on the branches, else a cone of them
    card: float  # size of a loose leaf, m
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
        limbs=5, forks=0, twigs=0, clumps=11, cards=200, card=0.45,
        leaf_color=vary(rng, GREENS[rng.integers(len(GREENS))], 0.25),
        bark_color=vary(rng, (0.062, 0.050, 0.038), 0.3), seed=int(rng.integers(2**31)),
    )  # fmt: skip
    bare = round_._replace(
        trunk=height * float(rng.uniform(0.16, 0.26)), limbs=7, forks=2, twigs=5, clumps=0, cards=0,
        crown=height * float(rng.uniform(0.30, 0.40)),
    )  # fmt: skip
    match kind:
        case "round":
            return round_
        case "poplar":
            height = float(rng.uniform(8.5, 12.0))
            return round_._replace(
                height=height, trunk=0.12 * height, crown=height * float(rng.uniform(0.11, 0.15)),
                radius=0.02 * height, clumps=12, limbs=2,
            )  # fmt: skip
        case "bare":
            return bare
        case "bare broad":
            return bare._replace(
                crown=height * float(rng.uniform(0.4, 0.46)), radius=0.032 * height
            )
        case "spreading":
            height = float(rng.uniform(5.0, 8.0))
            return round_._replace(
                height=height, trunk=0.33 * height, crown=height * float(rng.uniform(0.42, 0.52)),
                radius=0.035 * height, clumps=12, card=0.6,
            )  # fmt: skip
        case "conifer":
            return round_._replace(
                height=float(rng.uniform(6.0, 12.0)), trunk=float(rng.uniform(0.3, 0.8)),
                crown=float(rng.uniform(1.5, 2.3)), clumps=0, cards=340, card=0.9,
                limbs=0, leaf_color=vary(rng, (0.022, 0.045, 0.022), 0.25),
            )  # fmt: skip
        case "half bare":
            return bare._replace(
                twigs=2, cards=190, card=0.3,
                leaf_color=vary(rng, BROWNS[rng.integers(len(BROWNS))], 0.25),
            )  # fmt: skip
        case "young":
            height = float(rng.uniform(4.0, 5.5))
            return round_._replace(
                height=height, trunk=0.45 * height, radius=0.05, clumps=5, cards=150, card=0.35,
                crown=height * float(rng.uniform(0.17, 0.23)), limbs=3,
            )  # fmt: skip
    raise ValueError(f"unknown kind of tree {kind!r}; known: {', '.join(KINDS)}")


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
        turned = heading + 0.75 * directions(rng, 1)[0] + [0, 0, 0.35]
        turned /= np.linalg.norm(turned)
        branches += _grow(
            rng, params, along, turned, length * rng.uniform(0.5, 0.8), 0.5 * radius, level + 1
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
    tip = p.trunk + 0.85 * (p.height - p.trunk)
    parts = [
        tube((0, 0, 0), (0, 0, p.trunk), p.radius, p.bark_color, "bark", end_radius=0.7 * p.radius,
             sides=6, caps=False),
        tube((0, 0, p.trunk), (0, 0, tip), 0.7 * p.radius, p.bark_color, "bark",
             end_radius=0.08 * p.radius, sides=4, caps=False),
    ]  # fmt: skip
    slivers = []
    for branch in branches:
        if branch.level < 2:
            parts.append(
                tube(tuple(branch.start), tuple(branch.end), branch.radius, p.bark_color, "bark",
                     end_radius=0.5 * branch.radius, sides=4 - branch.level, caps=False)
            )  # fmt: skip
        else:
            width = max(branch.radius, 0.024)
            across = np.cross(branch.end - branch.start, directions(rng, 1)[0] + [2, 0, 0])
            across *= width / np.linalg.norm(across).clip(1e-6)
            slivers.append([branch.start - across, branch.start + across, branch.end])
    if slivers:
        parts.append(triangles(np.array(slivers), p.bark_color, "bark"))
    return merge(*parts)


def _ellipsoid_points(rng: np.random.Generator, params: TreeParams) -> np.ndarray:
    """Middles [clumps, 3] of the crown's blobs, spread evenly by the golden angle."""
    p = params
    index = np.arange(p.clumps)
    level = (2 * index + 1) / p.clumps - 1
    turn = 2.4 * index + rng.uniform(0, 2 * np.pi)
    out = np.sqrt(1 - level**2)
    unit = np.column_stack([out * np.cos(turn), out * np.sin(turn), level])
    unit *= rng.uniform([0.35, 0.35, 0.65], 0.8, (p.clumps, 3))
    middle, half = (p.height + p.trunk) / 2, (p.height - p.trunk) / 2
    return unit * [p.crown, p.crown, half] + [0, 0, middle]


def _cone_points(rng: np.random.Generator, params: TreeParams) -> np.ndarray:
    """Points [cards, 3] on and a little inside a cone with its foot at the lowest leaves."""
    p = params
    level = 1 - np.sqrt(rng.uniform(0, 1, p.cards))
    turn = rng.uniform(0, 2 * np.pi, p.cards)
    out = p.crown * (1 - level) * rng.uniform(0.5, 1.0, p.cards)
    low, high = p.trunk + 0.6 * p.card, p.height - 0.5 * p.card
    return np.column_stack([out * np.cos(turn), out * np.sin(turn), low + level * (high - low)])


def _clumped_leaves(rng: np.random.Generator, params: TreeParams) -> list[Asset]:
    """Blobs of leaves through the crown, and loose cards that fray the outline of each."""
    p = params
    wide = 1.05 * p.crown * p.clumps ** (-1 / 3)
    tall = wide * np.clip((p.height - p.trunk) / (2 * p.crown), 0.75, 1.5)
    centres = _ellipsoid_points(rng, p)
    centres[:, 2] = centres[:, 2].clip(p.trunk + 0.5 * tall, p.height - 0.8 * tall)
    radii = np.array([wide, wide, tall])
    blobs = [clump(rng, tuple(centre), tuple(radii), p.leaf_color) for centre in centres]
    around = directions(rng, p.cards) * rng.uniform(0.8, 1.25, (p.cards, 1)) * radii
    cards = centres[rng.integers(p.clumps, size=p.cards)] + around
    return [*blobs, leaf_cards(rng, cards, p.card, p.leaf_color)]


def _twig_leaves(
    rng: np.random.Generator, params: TreeParams, branches: list[_Branch]
) -> list[Asset]:
    """The last leaves, along the outer branches."""
    p = params
    outer = [b for b in branches if b.level > 0]
    start, end = (np.array([getattr(b, name) for b in outer]) for name in ("start", "end"))
    pick, along = rng.integers(len(outer), size=p.cards), rng.uniform(0.3, 1.0, (p.cards, 1))
    return [leaf_cards(rng, start[pick] + (end - start)[pick] * along, p.card, p.leaf_color)]


def tree(params: TreeParams) -> Asset:
    """Build the tree."""
    p = params
    rng = np.random.default_rng(p.seed)
    branches = _skeleton(rng, p)
    wood = _wood(rng, p, branches)
    if p.clumps:
        return merge(wood, *_clumped_leaves(rng, p))
    if not p.cards:
        return wood
    if branches:
        return merge(wood, *_twig_leaves(rng, p, branches))
    return merge(wood, leaf_cards(rng, _cone_points(rng, p), p.card, p.leaf_color))
