"""The catalogue: makes the mesh of an asset from its family and index, and draws assets for streets.

The catalogue is open-ended. Every index is an asset: its kind follows from ``Family.kind_cycle``, the rest
is drawn from a generator seeded by family and index, so that the same pair is the same asset everywhere. A
user's own assets extend it, named by the content and path of their files (``library.scan``).
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path, PurePath
from typing import Any, NamedTuple

import numpy as np

from common.errors import hint
from scene.assets import library, own_class
from scene.assets.families import FAMILIES
from scene.assets.own_class import OwnClass
from scene.attributes import StreetParams
from scene.cache import Arrays, cached
from scene.classes import CLASS_NAMES
from scene.look.surfaces import ROADS, SIDEWALKS, TERRAINS
from scene.mesh.asset import Asset
from scene.names import OVERLAPS, USES, WEATHERS
from scene.sky.weather import SKIES


class AssetPool(NamedTuple):
    """The assets that streets draw from, whether these may overlap, and the weather.

    They are consecutive indices of every family, and a user's own.
    """

    first: int = 0
    size: int | None = None  # built-in assets of every family; None for ``Family.count``
    fraction: float = 1.0  # share of built-in and of own assets that is used (study of assets)
    own: str = ""  # folder of the user's own assets, see ``library``
    use: str = "both"  # which ones: "both", "own" or "built-in"
    without: tuple[str, ...] = ()  # excluded families
    overlap: str = ""  # of assets: "allow", "avoid", or "" for the default of the space
    own_class: OwnClass | None = None  # an additional class and its asset
    weather: str = ""  # of all streets, one of ``WEATHERS``; "" draws it for each

    @property
    def identity(self) -> dict[str, Any]:
        """Its fields as JSON values; later fields only if set, so that older records keep their identity."""
        own_class = self.own_class and self.own_class._asdict()
        fields = {**self._asdict(), "without": list(self.without), "own_class": own_class}
        later = ("without", "overlap", "own_class", "weather")
        return {k: v for k, v in fields.items() if v or k not in later}

    def with_paths(self, rename: Callable[[str], str]) -> AssetPool:
        """Replace the folder of own assets and the file of the own class by ``rename`` of them."""
        own_class = self.own_class
        if own_class is not None:
            own_class = own_class._replace(file=rename(own_class.file))
        return self._replace(own=rename(self.own), own_class=own_class)

    def overlap_of(self, params: StreetParams) -> str:
        """Return ``overlap`` of a street; by default "allow" in ``scenex``, as in the paper, else "avoid"."""
        return self.overlap or ("allow" if params.space == "scenex" else "avoid")


MAX_COUNT = 1_000_000
"""The largest ``size`` of a pool; more is a typing error."""


def refuse_unknown(pool: AssetPool, prefix: str = "asset ") -> None:
    """Raise ValueError for a field out of range, as `check_pool` does, but read no folder."""
    if pool.use not in USES:
        raise ValueError(f"{prefix}use {pool.use!r} is unknown; {hint(pool.use, USES)}")
    if pool.overlap not in ("", *OVERLAPS):
        raise ValueError(f"overlap {pool.overlap!r} is unknown; {hint(pool.overlap, OVERLAPS)}")
    if pool.weather not in ("", *WEATHERS):
        raise ValueError(f"weather {pool.weather!r} is unknown; {hint(pool.weather, WEATHERS)}")
    if not 0 < pool.fraction <= 1:
        raise ValueError(f"{prefix}fraction must lie in (0, 1], not {pool.fraction}")
    if pool.first < 0:
        raise ValueError(f"the first asset must be 0 or more, not {pool.first}")
    if pool.size is not None and pool.size < 1:
        raise ValueError(f"{prefix}count must be 1 or more, not {pool.size}")
    if pool.size is not None and pool.size > MAX_COUNT:
        raise ValueError(f"{prefix}count must be {MAX_COUNT:,} or less, not {pool.size}")
    for family in pool.without:
        if family not in FAMILIES:
            raise ValueError(f"{prefix}without: no family {family!r}; {hint(family, FAMILIES)}")


def check_pool(pool: AssetPool, prefix: str = "asset ") -> AssetPool:
    """Check a pool and return it with absolute paths of its folder and of the file of its own class.

    Args:
        pool: assets to check.
        prefix: of the fields' names in errors; on a command line, ``--asset-``.

    Raises:
        ValueError: a field out of range, by name.
        LibraryError: the folder of own assets is missing, or it or the file of the own class cannot be used;
            see ``library``.
    """
    without: Any = pool.without
    if isinstance(without, str):
        raise ValueError(f"{prefix}without must be a list of families, not {without!r}")
    # Python code may pass paths and lists, but pools are keys of caches.
    pool = pool._replace(without=tuple(without)).with_paths(os.fspath)
    refuse_unknown(pool, prefix)
    if pool.use == "own" and not pool.own:
        raise library.LibraryError(f"{prefix}use 'own' needs a folder of own assets")
    if pool.own:
        library.check(pool.own)
    if pool.own_class is not None:
        own_class.check(pool.own_class)
    return pool.with_paths(lambda path: str(Path(path).absolute()) if path else path)


def draw_asset(pool: AssetPool, family: str, rng: np.random.Generator) -> int | str | None:
    """Draw one asset of ``family`` as ``asset_at`` does; always takes one number from ``rng``."""
    return asset_at(pool, family, rng.random())


def asset_at(pool: AssetPool, family: str, share: float) -> int | str | None:
    """Return the asset of ``family`` at ``share`` in [0, 1) of the pool: an index, or the name of an own one.

    Every asset of the pool, built-in or own, covers the same length of [0, 1). None if the pool has none.
    """
    count = _built_in(pool, family)
    own_refs = own_assets(pool, family)
    if count + len(own_refs) == 0:
        return None
    index = int(share * (count + len(own_refs)))
    return pool.first + index if index < count else own_refs[index - count]


def draw_in_season(
    pool: AssetPool, family: str, bare: float | None, rng: np.random.Generator
) -> int | str | None:
    """Draw one asset as ``draw_asset`` does, and for trees apply ``in_season``."""
    ref = draw_asset(pool, family, rng)
    return None if ref is None else in_season(family, ref, bare, pool, rng.random())


BARE = "bare"
"""Word in the names of the kinds of trees without leaves."""


def in_season(
    family: str, ref: int | str, bare: float | None, pool: AssetPool, share: float
) -> int | str:
    """Replace a tree by one with or without leaves, so that a share ``bare`` of trees has none.

    Returns the next suitable built-in tree of the pool. Trees stay if none is suitable or ``bare`` is None;
    own assets and other families always stay. ``share`` in [0, 1) decides about leaves.
    """
    if family != "tree" or bare is None or not isinstance(ref, int):
        return ref
    wants_bare, count = share < bare, _built_in(pool, family)
    for step in range(min(count, len(FAMILIES[family].kinds))):
        other = pool.first + (ref - pool.first + step) % count
        if (BARE in kind(family, other)) == wants_bare:
            return other
    return ref


@lru_cache(maxsize=256)  # asked for each object of a street
def _built_in(pool: AssetPool, family: str) -> int:
    """Count the built-in assets of a family in a pool."""
    size = FAMILIES[family].count if pool.size is None else pool.size
    is_absent = pool.use == "own" or family in pool.without
    return 0 if is_absent else max(1, round(size * pool.fraction))


OWN_POST = 0.1
"""A user's own sign that reaches down to this height (metres) includes its post."""


def parts_of(
    family: str, ref: int | str, chance: float, pool: AssetPool
) -> list[tuple[str, int | str]]:
    """Return the assets of one object: a rider comes with a machine, a sign or light with a post.

    These have their own class. Where the pool has no post for a sign or light, a built-in one is used; an own
    rider may come without a machine. An object is left out if it would hang in the air because the pool
    excludes its base. ``chance`` in [0, 1) chooses the machine or the post.
    """
    if family == own_class.FAMILY or not FAMILIES[family].mounted_on:
        return [(family, ref)]
    row = FAMILIES[family]
    is_own_sign = isinstance(ref, str) and row.front == "back"
    if is_own_sign and bounds(family, ref)[0, 2] < OWN_POST:
        return [(family, ref)]
    base = row.mounted_on
    if not isinstance(base, str):
        if isinstance(ref, int):
            base = row.base(kind(family, ref))
        else:  # nothing tells what a user's own rider sits on
            position = chance * len(row.kinds)
            base, chance = row.base(row.kinds[int(position)]), position % 1.0
    below = asset_at(pool, base, chance)
    if below is None and row.front == "back":
        below = asset_at(pool._replace(use="built-in"), base, chance)
    if below is not None:
        return [(family, ref), (base, below)]
    return [(family, ref)] if isinstance(ref, str) and row.front != "back" else []


def own_assets(pool: AssetPool, family: str) -> tuple[str, ...]:
    """Return the names of a pool's own assets of a family, in a fixed order."""
    if not pool.own or pool.use == "built-in" or family in pool.without:
        return ()
    refs = library.scan(pool.own).get(family, ())
    return refs[: max(1, round(len(refs) * pool.fraction))]


def missing_families(pool: AssetPool) -> tuple[str, ...]:
    """Return the families without an asset in a pool, whose places in a street stay empty.

    Posts of own signs and lights are not among them, since built-in ones are used.
    """
    if pool.use != "own":
        return ()
    own_rows = [row for family, row in FAMILIES.items() if own_assets(pool, family)]
    present = [row.name for row in own_rows] + [
        row.mounted_on for row in own_rows if row.front == "back"
    ]
    return tuple(family for family in FAMILIES if family not in present)


@lru_cache(maxsize=256)  # the renderers cache frequent assets as arrays
def asset(family: str, ref: int | str) -> Asset:
    """Make the built-in asset of a family and index, or load the own asset named by ``library.scan``.

    Raises:
        ValueError: unknown family or negative index.
        LibraryError: the file cannot be used.
    """
    if family == own_class.FAMILY:
        return own_class.load(str(ref))
    if family not in FAMILIES:
        raise ValueError(f"unknown asset family {family!r}; {hint(family, FAMILIES)}")
    if isinstance(ref, str):
        return library.load(family, ref)
    if ref < 0:
        raise ValueError(f"asset index of {family} must be 0 or more, not {ref}")
    row = FAMILIES[family]
    seed = [zlib.crc32(family.encode()), ref, *([1] if ref in row.redrawn else [])]
    return row.draw(np.random.default_rng(seed), kind(family, ref))


@lru_cache(maxsize=4096)
def bounds(family: str, ref: int | str) -> np.ndarray:
    """Return the low and high corner f64[2, 3] of an asset in its own frame (read-only)."""

    def make() -> Arrays:
        vertices = asset(family, ref).mesh.vertices
        return {"corners": np.stack([vertices.min(axis=0), vertices.max(axis=0)])}

    built_in = isinstance(ref, int)
    name = f"bounds-{family}-{ref}".replace(" ", "_")
    corners = (cached(name, make) if built_in else make())["corners"]
    corners.setflags(write=False)
    return corners


def kind(family: str, ref: int | str) -> str:
    """Return the kind of a built-in asset, or the file name of an own one."""
    if isinstance(ref, str):
        return PurePath(ref).name
    kinds = FAMILIES[family].kind_cycle
    return kinds[ref % len(kinds)]


def train_id(family: str, ref: int | str) -> int:
    """Return the class of an asset: its kind's if that has one, else its family's."""
    row = FAMILIES[family]
    of_kind = dict(row.classes) if isinstance(ref, int) else {}
    return int(of_kind.get(kind(family, ref), row.train_id))


def families_of(name: str) -> tuple[str, ...]:
    """Return the families of a class, or the one family called ``name``.

    Raises:
        ValueError: neither a class with assets nor a family.
    """
    families = tuple(f for f, row in FAMILIES.items() if CLASS_NAMES[row.train_id] == name)
    if not families and name not in FAMILIES:
        names = dict.fromkeys([CLASS_NAMES[row.train_id] for row in FAMILIES.values()])
        raise ValueError(
            f"no assets of class {name!r}; {hint(name, names | dict.fromkeys(FAMILIES))}"
        )
    return families or (name,)


def surfaces() -> dict[str, tuple[str, ...]]:
    """Return the names of the surfaces of ground and sky, by class."""
    return {
        "road": tuple(row.name for row in ROADS),
        "sidewalk": tuple(row.name for row in SIDEWALKS),
        "terrain": tuple(row.name for row in TERRAINS),
        "sky": tuple(row.name for row in SKIES),
    }
