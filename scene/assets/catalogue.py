"""Every asset family, and the way from (family, index) to a mesh.

The catalogue is open-ended: any index gives an asset, its kind that of ``Family.turns``, the rest drawn
from a generator seeded by family and index, so the same (family, index) is the same asset anywhere. A
user's own assets stand beside them, named by their files' content and path (``library.scan``).
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path, PurePath
from typing import Any, NamedTuple

import numpy as np

from scene.assets import library, own_class
from scene.assets.families import FAMILIES
from scene.assets.own_class import OwnClass
from scene.attributes import StreetParams
from scene.cache import Arrays, kept
from scene.classes import CLASS_NAMES
from scene.look.surfaces import ROADS, SIDEWALKS, TERRAINS
from scene.mesh.asset import Asset
from scene.names import OVERLAPS, USES, WEATHERS
from scene.sky.weather import SKIES


class AssetPool(NamedTuple):
    """The assets a street may draw from, whether they may stand in each other, and in which weather.

    Consecutive indices of every family, and a user's own.
    """

    first: int = 0
    size: int | None = None  # built-in ones of every family; None: ``Family.count``
    fraction: float = 1.0  # share that is used, of built-in and own ones (the half-asset study)
    own: str = ""  # folder of own assets, see ``library``
    use: str = "both"  # which ones: "both", "own" or "built-in"
    without: tuple[str, ...] = ()  # families that stay away
    overlap: str = (
        ""  # whether they may stand in each other: "allow", "avoid", "" as the space has it
    )
    own_class: OwnClass | None = None  # a class beside the engine's, and its asset
    weather: str = ""  # of all streets: one of ``WEATHERS``; "" leaves it to chance

    @property
    def decides(self) -> dict[str, Any]:
        """Its fields as plain values; the last four where they say anything, so that older records hold."""
        own = self.own_class and self.own_class._asdict()
        fields = {**self._asdict(), "without": list(self.without), "own_class": own}
        added = ("without", "overlap", "own_class", "weather")
        return {k: v for k, v in fields.items() if v or k not in added}

    def called(self, naming: Callable[[str], str]) -> AssetPool:
        """The same pool, its folder and the file of its own class by the names that ``naming`` gives them."""
        own = self.own_class and self.own_class.called(naming)
        return self._replace(own=naming(self.own), own_class=own)

    def overlap_of(self, params: StreetParams) -> str:
        """``overlap`` in a street; the default of ``scenex`` is "allow", as in the paper, else "avoid"."""
        return self.overlap or ("allow" if params.space == "scenex" else "avoid")


MOST = 1_000_000
"""Assets of a family; indices beyond are no plausible wish."""


def refuse_unknown(pool: AssetPool, named: str = "asset ") -> None:
    """Raise ValueError for a field out of range, by name, as `check_pool` does, but read no folder."""
    if pool.use not in USES:
        raise ValueError(f"{named}use {pool.use!r} is unknown; known: {', '.join(USES)}")
    if pool.overlap not in ("", *OVERLAPS):
        raise ValueError(f"overlap {pool.overlap!r} is unknown; known: {', '.join(OVERLAPS)}")
    if pool.weather not in ("", *WEATHERS):
        raise ValueError(f"weather {pool.weather!r} is unknown; known: {', '.join(WEATHERS)}")
    if not 0 < pool.fraction <= 1:
        raise ValueError(f"{named}fraction must lie in (0, 1], not {pool.fraction}")
    if pool.first < 0:
        raise ValueError(f"the first asset must be 0 or more, not {pool.first}")
    if pool.size is not None and pool.size < 1:
        raise ValueError(f"{named}count must be 1 or more, not {pool.size}")
    if pool.size is not None and pool.size > MOST:
        raise ValueError(f"{named}count must be {MOST:,} or less, not {pool.size}")
    for family in pool.without:
        if family not in FAMILIES:
            raise ValueError(f"{named}without: no family {family!r}; known: {', '.join(FAMILIES)}")


def check_pool(pool: AssetPool, named: str = "asset ") -> AssetPool:
    """The pool itself, its folder of own assets and the file of its own class by their absolute paths.

    Args:
        pool: the pool.
        named: how the names of its fields begin in errors; on a command line, ``--asset-``.

    Raises:
        ValueError: a field out of range, by name.
        LibraryError: the folder of own assets is wanted and not named, or cannot be used; see ``library``;
            or the file of the own class.
    """
    refuse_unknown(pool, named)
    if pool.use == "own" and not pool.own:
        raise library.LibraryError(f"{named}use 'own' needs a folder of own assets")
    if pool.own:
        library.check(pool.own)
    if pool.own_class is not None:
        own_class.check(pool.own_class)
    return pool.called(lambda path: str(Path(path).absolute()) if path else path)


def draw_asset(pool: AssetPool, family: str, rng: np.random.Generator) -> int | str | None:
    """Draw one asset of ``family`` as ``chosen`` does. Always takes one number from ``rng``."""
    return chosen(pool, family, rng.random())


def chosen(pool: AssetPool, family: str, share: float) -> int | str | None:
    """The asset of ``family`` that a number in [0, 1) chooses: an index, or what an own one is called.

    With both in use, every asset is as likely as any other. None where there is none.
    """
    count = _built_in(pool, family)
    own = own_assets(pool, family)
    if count + len(own) == 0:
        return None
    drawn = int(share * (count + len(own)))
    return pool.first + drawn if drawn < count else own[drawn - count]


def draw_in_season(
    pool: AssetPool, family: str, bare: float | None, rng: np.random.Generator
) -> int | str | None:
    """Draw one asset as ``draw_asset`` does, trees with or without leaves as ``in_season`` says."""
    ref = draw_asset(pool, family, rng)
    return None if ref is None else in_season(family, ref, bare, pool, rng.random())


BARE = "bare"
"""In the names of the kinds of trees without leaves."""


def in_season(
    family: str,
    ref: int | str,
    bare: float | None,
    pool: AssetPool,
    share: float,
) -> int | str:
    """A tree with or without leaves in the place of one, so that a share ``bare`` of trees has none.

    The next built-in tree of the pool that suits; the tree itself if none does, and all that is no
    built-in tree, and all trees where ``bare`` is None. ``share`` in [0, 1) decides.
    """
    if family != "tree" or bare is None or not isinstance(ref, int):
        return ref
    wanted, count = share < bare, _built_in(pool, family)
    for step in range(min(count, len(FAMILIES[family].kinds))):
        other = pool.first + (ref - pool.first + step) % count
        if (BARE in kind(family, other)) == wanted:
            return other
    return ref


@lru_cache(maxsize=256)  # the same for all that a street draws
def _built_in(pool: AssetPool, family: str) -> int:
    """How many built-in assets of a family a pool offers."""
    size = FAMILIES[family].count if pool.size is None else pool.size
    absent = pool.use == "own" or family in pool.without
    return 0 if absent else max(1, round(size * pool.fraction))


OWN_POST = 0.1
"""A user's own sign that reaches this low, metres, has a post of its own."""


def parts_of(
    family: str, ref: int | str, chance: float, pool: AssetPool
) -> list[tuple[str, int | str]]:
    """The assets that make up one object: a rider's machine and a sign's post have their own class.

    Where a pool of own assets has no post for a sign or light, a built-in one stands there; an own rider
    goes without a machine. What would hang in the air, since a pool is without its family, is left out.
    ``chance`` in [0, 1) decides on the machine or the post.
    """
    if family == own_class.FAMILY or not FAMILIES[family].on:
        return [(family, ref)]
    row = FAMILIES[family]
    whole = isinstance(ref, str) and row.front == "back"
    if whole and bounds(family, ref)[0, 2] < OWN_POST:
        return [(family, ref)]
    base = row.on
    if not isinstance(base, str):
        if isinstance(ref, int):
            base = row.base(kind(family, ref))
        else:  # a user's own rider says not what it rides
            place = chance * len(row.kinds)
            base, chance = row.base(row.kinds[int(place)]), place % 1.0
    below = chosen(pool, base, chance)
    if below is None and row.front == "back":
        below = chosen(pool._replace(use="built-in"), base, chance)
    if below is not None:
        return [(family, ref), (base, below)]
    return [(family, ref)] if isinstance(ref, str) and row.front != "back" else []


def own_assets(pool: AssetPool, family: str) -> tuple[str, ...]:
    """What the own assets are called that a pool offers for a family, in a fixed order."""
    if not pool.own or pool.use == "built-in" or family in pool.without:
        return ()
    found = library.scan(pool.own).get(family, ())
    return found[: max(1, round(len(found) * pool.fraction))]


def absent(pool: AssetPool) -> tuple[str, ...]:
    """Families of which a pool has no asset, so that their places in a street stay empty.

    Not the posts of own signs and lights, which are built-in ones then.
    """
    if pool.use != "own":
        return ()
    own = [row for family, row in FAMILIES.items() if own_assets(pool, family)]
    there = [row.name for row in own] + [row.on for row in own if row.front == "back"]
    return tuple(family for family in FAMILIES if family not in there)


@lru_cache(maxsize=256)  # what is drawn often is kept by the renderers, as arrays
def asset(family: str, ref: int | str) -> Asset:
    """The built-in asset of a family with an index, or the own asset that ``library.scan`` calls so.

    Raises:
        ValueError: unknown family or negative index.
        LibraryError: the file cannot be used.
    """
    if family == own_class.FAMILY:
        return own_class.load(str(ref))
    if family not in FAMILIES:
        raise ValueError(f"unknown asset family {family!r}; known: {', '.join(FAMILIES)}")
    if isinstance(ref, str):
        return library.load(family, ref)
    if ref < 0:
        raise ValueError(f"asset index of {family} must be 0 or more, not {ref}")
    row = FAMILIES[family]
    seed = [zlib.crc32(family.encode()), ref, *([1] if ref in row.again else [])]
    return row.draw(np.random.default_rng(seed), kind(family, ref))


@lru_cache(maxsize=4096)
def bounds(family: str, ref: int | str) -> np.ndarray:
    """Low and high corner f64[2, 3] of an asset in its own frame (read-only)."""

    def make() -> Arrays:
        vertices = asset(family, ref).mesh.vertices
        return {"corners": np.stack([vertices.min(axis=0), vertices.max(axis=0)])}

    built_in = isinstance(ref, int)
    name = f"bounds-{family}-{ref}".replace(" ", "_")
    corners = (kept(name, make) if built_in else make())["corners"]
    corners.setflags(write=False)
    return corners


def kind(family: str, ref: int | str) -> str:
    """The kind of a built-in asset, or the file name of an own one."""
    if isinstance(ref, str):
        return PurePath(ref).name
    turns = FAMILIES[family].turns
    return turns[ref % len(turns)]


def train_id(family: str, ref: int | str) -> int:
    """The class of an asset: that of its kind, if that has one, else of its family."""
    row = FAMILIES[family]
    of_kind = dict(row.classes) if isinstance(ref, int) else {}
    return int(of_kind.get(kind(family, ref), row.train_id))


def families_of(name: str) -> tuple[str, ...]:
    """The families of a class, or the one family called ``name``.

    Raises:
        ValueError: neither a class with assets nor a family.
    """
    found = tuple(f for f, row in FAMILIES.items() if CLASS_NAMES[row.train_id] == name)
    if not found and name not in FAMILIES:
        known = dict.fromkeys([CLASS_NAMES[row.train_id] for row in FAMILIES.values()])
        raise ValueError(
            f"no assets of class {name!r}; known: {', '.join(known | dict.fromkeys(FAMILIES))}"
        )
    return found or (name,)


def surfaces() -> dict[str, tuple[str, ...]]:
    """Names of what covers the ground and the sky, by class."""
    return {
        "road": tuple(row.name for row in ROADS),
        "sidewalk": tuple(row.name for row in SIDEWALKS),
        "terrain": tuple(row.name for row in TERRAINS),
        "sky": tuple(row.name for row in SKIES),
    }
