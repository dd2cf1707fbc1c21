"""A street's ground with the objects placed so far; later ones stay clear of them and of the camera."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from scene.assets.catalogue import AssetPool, asset_at, kind, parts_of
from scene.attributes import StreetParams
from scene.classes import TrainId
from scene.ground.ground import Ground
from scene.ground.path import place_at, to_world
from scene.street.camera import DRIVE, SEARCH, VIEW
from scene.street.clearance import Rectangle, Rectangles, touched
from scene.street.instances import TRAIN_IDS, Stand, footprint, objects, rectangles, top, turned_out

LINE_START, LINE_END = -15.0, 150.0
"""Start and end of every line of objects, metres along the road."""
HOUSES = frozenset({TrainId.BUILDING, TrainId.TRAIN, TrainId.WALL, TrainId.FENCE})
SPARE, TOUCHING = 0.15, -0.05
"""Least distance in metres between objects, and between objects that belong together."""
ASIDE, BELOW = 0.35, 0.8
"""Metres to the sides of the lens and below it that are kept free."""
STEP = 0.5
"""Metres between the checked positions of the camera."""
STEEP_LIFT, BENT_LIFT, MOST_LIFT = 0.006, 0.001, 0.05
"""Metres by which tiles are lifted for each per cent of slope and 1/km of bend, and at most."""
BLOCK, GAP = 12.0, 14.0
"""Objects in the way of the camera form blocks of at most ``BLOCK`` metres, ``GAP`` metres apart, so that the
camera need not move aside for most shots."""


class Setting(NamedTuple):
    """The common data of all objects of a street."""

    params: StreetParams
    ground: Ground
    pool: AssetPool
    drive: float  # side, 1 left or -1 right, of the traffic that drives forward


class Plot:
    """A street's ground with the objects placed so far, in road coordinates."""

    def __init__(self, street: Setting) -> None:
        """Make an empty plot."""
        self.street = street
        self.ground = street.ground
        self.stands: list[Stand] = []
        self._taken, self._houses = Rectangles(), Rectangles()
        self._laid: dict[str, Rectangles] = {}
        self._blocks: list[tuple[float, float]] = []
        self._along = np.arange(-1.0, DRIVE + SEARCH + VIEW, STEP)
        lane = street.drive * street.params.camera_position_x
        # Possible positions of the camera.
        self._path = to_world(street.ground.path, self._along, lane)

    def keep_free(self, rows: np.ndarray) -> None:
        """Keep rectangles f64[n, 6] free of objects that need room."""
        self._taken.extend(rows + np.array([0.0, 0.0, 0.0, 0.0, -TOUCHING, -TOUCHING]))

    def add(self, stands: Sequence[Stand]) -> None:
        """Place objects with their parts, regardless of room."""
        grouped = list(objects(stands))
        if grouped:
            rows = rectangles(self.ground.path, stands)
            self._taken.extend(rows)
            self._occupy(grouped, rows)

    def admit(
        self, stands: Sequence[Stand], tries: np.ndarray | None = None, spare: float = 0.0
    ) -> None:
        """Place each object with its parts at its first try with room.

        Args:
            stands: the objects in order.
            tries: f64[tries, objects, 2] metres by which each is moved along the road and left of it; None:
                without moves.
            spare: least distance in metres from other objects.
        """
        grouped = list(objects(stands))
        if not grouped:
            return
        moves = np.zeros((1, len(grouped), 2)) if tries is None else tries
        footprints = np.array([footprint(*(part[:2] for part in parts)) for parts in grouped])
        x, y, yaw = np.array([parts[0][2:5] for parts in grouped]).T
        path = self.ground.path
        rows = turned_out(path, np.tile(footprints, (len(moves), 1)), *np.concatenate(
            [np.array([x + dx, y + dy, yaw]) for dx, dy in moves.transpose(0, 2, 1)], axis=1
        )).reshape(len(moves), len(grouped), 6).transpose(1, 0, 2)  # fmt: skip
        try_index = self._taken.admit(np.ascontiguousarray(rows), spare)
        admitted = np.flatnonzero(try_index >= 0).tolist()
        moved = []
        for k in admitted:
            dx, dy = moves[try_index[k], k].tolist()
            moved.append([s._replace(x=s.x + dx, y=s.y + dy) for s in grouped[k]])
        self._occupy(moved, rows[admitted, try_index[admitted]])

    def put(
        self,
        family: str,
        ref: int | str | None,
        x: float,
        y: float,
        yaw: float,
        *,
        chance: float = 0.0,
        spare: float = SPARE,
        bare: bool = False,
    ) -> bool:
        """Place an object if there is room; returns whether there was.

        Args:
            family: family of the asset.
            ref: its index, or the name of a user's own asset; None places nothing.
            x: metres along the road.
            y: metres left of the centre line.
            yaw: radians left of the driving direction.
            chance: in [0, 1), for its parts, see ``parts_of``.
            spare: least distance in metres from other objects.
            bare: whether it needs ground without tiles.
        """
        if ref is None or not LINE_START - 10 < x < LINE_END + 10:
            return False
        parts = parts_of(family, ref, chance, self.street.pool)
        if not parts:
            return False
        box = self._rectangle(parts, x, y, yaw)
        if self._taken.meet(box, spare):
            return False
        if bare and any(tiles.meet(box, spare) for tiles in self._laid.values()):
            return False
        block = self._block(parts, box)
        if block is not None and not _bearable(block, self._blocks):
            return False
        self._stand(parts, x, y, yaw, 0.0, box, block)
        return True

    def lay(self, family: str, ref: int | str | None, x: float, y: float, yaw: float) -> bool:
        """Lay a flat tile, on which objects may stand, unless a house, wall or other tiles are in the way."""
        if ref is None:
            return False
        # Tiles are flat, so they rest on the highest points of uneven land.
        params = self.street.params
        lift = min(STEEP_LIFT * params.gradient + BENT_LIFT * params.bend, MOST_LIFT)
        box = self._rectangle([(family, ref)], x, y, yaw)
        if self._houses.meet(box, TOUCHING):
            return False
        if any(tiles.meet(box, TOUCHING) for f, tiles in self._laid.items() if f != family):
            return False
        self._laid.setdefault(family, Rectangles()).add(box)
        self.stands.append(Stand(family, ref, x, y, yaw, lift))
        return True

    def place(
        self, family: str, ref: int | str, x: float, y: float, yaw: float, lift: float = 0.0
    ) -> None:
        """Place an object on an existing one, ``lift`` metres above the ground."""
        parts = [(family, ref)]
        box = self._rectangle(parts, x, y, yaw)
        self._stand(parts, x, y, yaw, lift, box, self._block(parts, box))

    def built(self, x: float, y: float) -> bool:
        """Whether a house, a wall or a fence stands at a place."""
        east, north, _, _ = place_at(self.ground.path, x, y)
        return self._houses.meet(Rectangle(east, north, 1.0, 0.0, 0.0, 0.0), 0.0)

    def _rectangle(
        self, parts: Sequence[tuple[str, int | str]], x: float, y: float, yaw: float
    ) -> Rectangle:
        u, v, long, wide = footprint(*parts)
        path = self.ground.path
        if path.bends:
            x, y, heading, _ = place_at(path, x, y)
            yaw += heading
        c, s = math.cos(yaw), math.sin(yaw)
        return Rectangle(c * u - s * v + x, s * u + c * v + y, c, s, long, wide)

    def _stand(
        self,
        parts: Sequence[tuple[str, int | str]],
        x: float,
        y: float,
        yaw: float,
        lift: float,
        box: Rectangle,
        block: tuple[float, float] | None,
    ) -> None:
        for k, (family, ref) in enumerate(parts):
            self.stands.append(Stand(family, ref, x, y, yaw, lift, k > 0))
        self._taken.add(box)
        if block is not None:
            self._blocks.append(block)
        if TRAIN_IDS[parts[0][0]] in HOUSES:
            self._houses.add(box)

    def _occupy(self, grouped: list[list[Stand]], rows: np.ndarray) -> None:
        """Record objects with rectangles f64[objects, 6]."""
        for parts in grouped:
            self.stands += parts
        lens = self.street.params.camera_position_y - BELOW
        high = [any(top(*part[:2]) >= lens for part in parts) for parts in grouped]
        ends = touched(self._path, rows[high], ASIDE)
        along = self._along[ends[ends[:, 1] >= 0]]
        self._blocks += [(low, end) for low, end in along.tolist()]
        self._houses.extend(rows[[TRAIN_IDS[parts[0].family] in HOUSES for parts in grouped]])

    def _block(
        self, parts: Sequence[tuple[str, int | str]], box: Rectangle
    ) -> tuple[float, float] | None:
        """The stretch where an object is in the way of the camera, metres along the road."""
        lens = self.street.params.camera_position_y
        if max(top(*part) for part in parts) < lens - BELOW:
            return None
        first, last = touched(self._path, np.array([box]), ASIDE)[0].tolist()
        return (float(self._along[first]), float(self._along[last])) if last >= 0 else None


def _bearable(block: tuple[float, float], blocks: list[tuple[float, float]]) -> bool:
    """Whether another block leaves gaps for the camera: it joins a short one or is far from all."""
    low, high = block
    for a, b in blocks:
        if b > low - GAP and a < high + GAP:
            low, high = min(low, a), max(high, b)
    return high - low <= BLOCK


def draw_kind(
    pool: AssetPool, family: str, kinds: tuple[str, ...], rng: np.random.Generator
) -> int | str | None:
    """Draw an asset of certain kinds if one of eight draws is of them, otherwise any. Draws eight numbers."""
    refs = [asset_at(pool, family, share) for share in rng.random(8).tolist()]
    return next((ref for ref in refs if ref is not None and kind(family, ref) in kinds), refs[0])


def draw_family(shares: dict[str, float], rng: np.random.Generator) -> str:
    """Draw a family by its share; equals ``rng.choice`` with the same number, but is much faster."""
    return list(shares)[bisect_right(_upto(tuple(shares.values())), rng.random())]


@lru_cache(maxsize=64)
def _upto(shares: tuple[float, ...]) -> list[float]:
    total = np.cumsum(shares)
    return (total / total[-1]).tolist()
