"""Where there is room: objects stand on a street one by one, clear of others and of the camera."""

from __future__ import annotations

from bisect import bisect_right
from functools import lru_cache

import numpy as np

from scene.assets import catalogue
from scene.assets.catalogue import AssetPool, kind, pick
from scene.assets.families import FAMILIES
from scene.classes import TrainId
from scene.compiled import njit
from scene.ground.path import place_at, to_world
from scene.street.camera import DRIVE, SEARCH, VIEW
from scene.street.lines import LINE_END, LINE_START, Setting, parts_of
from scene.street.placing import Standing, pose_at
from scene.street.room import Rectangle, Rectangles, footprint

HOUSES = frozenset({TrainId.BUILDING, TrainId.TRAIN, TrainId.WALL, TrainId.FENCE})
SPARE = 0.15
"""Metres that objects are apart at least."""
BESIDE, BELOW = 0.35, 0.8
"""Metres beside and below the lens that are kept free."""
STEP = 0.5
"""Metres between the places of the camera that are looked at."""
STEEP_LIFT, BENT_LIFT, MOST_LIFT = 0.006, 0.001, 0.05
"""Metres by which tiles are lifted for each per cent of slope and 1/km of bend, and at most."""
BLOCK, GAP = 12.0, 14.0
"""In the way of the camera, objects stand in blocks of at most ``BLOCK`` metres, ``GAP`` metres apart: within
its ``SEARCH`` a shot finds a place between them."""


class Plot:
    """A street's ground with what stands on it so far, in road coordinates."""

    def __init__(self, street: Setting, standing: list[Standing]) -> None:
        """A plot on which ``standing`` stand already."""
        self.street = street
        self.ground = street.ground
        self.added: list[Standing] = []
        self._taken, self._houses = Rectangles(), Rectangles()
        self._laid: dict[str, Rectangles] = {}
        self._blocks: list[tuple[float, float]] = []
        self._along = np.arange(-1.0, DRIVE + SEARCH + VIEW, STEP)
        lane = street.drive * street.params.camera_position_x
        self._path = to_world(
            street.ground.path, self._along, lane
        )  # where the camera may come along
        for family, ref, pose in standing:
            self._stand(family, ref, pose)

    def put(
        self,
        family: str,
        ref: int | str | None,
        x: float,
        y: float,
        yaw: float,
        *,
        seed: int = 0,
        spare: float = SPARE,
        tilt: np.ndarray | None = None,
        bare: bool = False,
    ) -> bool:
        """Stand an object where there is room; says whether there was.

        Args:
            family: of the asset.
            ref: its index, or name of an own one; None, of which a pool has none, never stands.
            x: metres along the road.
            y: metres left of the centre line.
            yaw: radians left of the driving direction.
            seed: for what comes with it, see ``parts_of``.
            spare: metres to the next object.
            tilt: f64[4, 4] applied in its own frame.
            bare: whether it needs ground without tiles.
        """
        if ref is None or not LINE_START - 10 < x < LINE_END + 10:
            return False
        pose = pose_at(self.ground, x, y, yaw)
        pose = pose if tilt is None else pose @ tilt
        parts = parts_of(family, ref, seed, self.street.pool)
        return self.admit([(part, own, pose) for part, own in parts], spare, bare)

    def admit(self, parts: list[Standing], spare: float = SPARE, bare: bool = False) -> bool:
        """Stand an object of parts that share a pose where there is room; says whether there was.

        Args:
            parts: the object first, then its post or machine; none never stand.
            spare: metres to the next object.
            bare: whether it needs ground without tiles.
        """
        if not parts:
            return False
        family, _, pose = parts[0]
        assets = [(part, ref) for part, ref, _ in parts]
        box = footprint(assets, pose)
        if self._taken.meet(box, spare):
            return False
        if bare and any(laid.meet(box, spare) for laid in self._laid.values()):
            return False
        block = self._block(assets, box)
        if block is not None and not _bearable(block, self._blocks):
            return False
        self._occupy(family, box, block)
        self.added += parts
        return True

    def lay(self, family: str, ref: int | str | None, x: float, y: float, yaw: float) -> bool:
        """Lay a flat tile that others may stand on, unless a house, a wall or tiles of others are there."""
        if ref is None:
            return False
        pose = pose_at(self.ground, x, y, yaw)
        # Tiles are flat: where the land is not, they lie on its highest points.
        params = self.street.params
        pose[2, 3] += min(STEEP_LIFT * params.gradient + BENT_LIFT * params.bend, MOST_LIFT)
        box = footprint([(family, ref)], pose)
        if self._houses.meet(box, -0.05):
            return False
        if any(laid.meet(box, -0.05) for f, laid in self._laid.items() if f != family):
            return False
        self._laid.setdefault(family, Rectangles()).add(box)
        self.added.append((family, ref, pose))
        return True

    def place(
        self, family: str, ref: int | str, x: float, y: float, yaw: float, lift: float = 0.0
    ) -> None:
        """Stand an object on another that is there already, ``lift`` metres above the ground."""
        pose = pose_at(self.ground, x, y, yaw)
        raised = np.eye(4)
        raised[2, 3] = lift
        self._stand(family, ref, pose @ raised)
        self.added.append((family, ref, pose @ raised))

    def built(self, x: float, y: float) -> bool:
        """Whether a house, a wall or a fence stands at a place."""
        east, north, _, _ = place_at(self.ground.path, x, y)
        return self._houses.meet(Rectangle(east, north, 1.0, 0.0, 0.0, 0.0), 0.0)

    def _stand(self, family: str, ref: int | str, pose: np.ndarray) -> None:
        box = footprint([(family, ref)], pose)
        self._occupy(family, box, self._block([(family, ref)], box))

    def _occupy(self, family: str, box: Rectangle, block: tuple[float, float] | None) -> None:
        if block is not None:
            self._blocks.append(block)
        self._taken.add(box)
        if FAMILIES[family].train_id in HOUSES:
            self._houses.add(box)

    def _block(
        self, parts: list[tuple[str, int | str]], box: Rectangle
    ) -> tuple[float, float] | None:
        """From where to where an object is in the way of the camera, metres along the road."""
        lens = self.street.params.camera_position_y
        if all(catalogue.bounds(*part)[1, 2] < lens - BELOW for part in parts):
            return None
        first, last = _met(self._path, *box, BESIDE)
        return (float(self._along[first]), float(self._along[last])) if last >= 0 else None


@njit(cache=True)
def _met(
    path: np.ndarray,
    own_x: float,
    own_y: float,
    cos: float,
    sin: float,
    long: float,
    wide: float,
    spare: float,
) -> tuple[int, int]:
    """First and last of the places f64[n, 2] that are nearer than ``spare`` to a rectangle; -1 for none."""
    first, last = -1, -1
    for k in range(len(path)):
        x, y = path[k, 0] - own_x, path[k, 1] - own_y
        if abs(x * cos + y * sin) < long + spare and abs(y * cos - x * sin) < wide + spare:
            first, last = (k if first < 0 else first), k
    return first, last


def _bearable(block: tuple[float, float], blocks: list[tuple[float, float]]) -> bool:
    """Whether a further block leaves the camera gaps: it joins a short one or is far from all."""
    low, high = block
    for a, b in blocks:
        if b > low - GAP and a < high + GAP:
            low, high = min(low, a), max(high, b)
    return high - low <= BLOCK


def draw_kind(
    pool: AssetPool, family: str, kinds: tuple[str, ...], rng: np.random.Generator
) -> int | str | None:
    """One asset of certain kinds, where eight draws find one; otherwise any. Takes eight numbers."""
    drawn = [pick(pool, family, rng) for _ in range(8)]
    return next((ref for ref in drawn if ref is not None and kind(family, ref) in kinds), drawn[0])


def draw_family(shares: dict[str, float], rng: np.random.Generator) -> str:
    """A family, each with its share: what ``rng.choice`` draws, from the same number, and much sooner."""
    return list(shares)[bisect_right(_upto(tuple(shares.values())), rng.random())]


@lru_cache(maxsize=64)
def _upto(shares: tuple[float, ...]) -> list[float]:
    total = np.cumsum(shares)
    return (total / total[-1]).tolist()
