"""A street as flat arrays: every distinct mesh once, and the pose of each instance.

Nothing is copied per instance: a renderer with instancing stores the triangles of an asset once, and
``world`` merges them for one without.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from scene.assets import catalogue
from scene.cache import Arrays, cached
from scene.classes import TrainId
from scene.compiled import njit
from scene.ground.build import GROUND_INSTANCES, ground_surfaces
from scene.look.materials import MATERIAL_ID, MATERIALS
from scene.mesh.asset import Asset
from scene.render.instances import AssetKey, instances
from scene.streams import table_row
from scene.street.street import Street

f32 = np.float32
SKY_INSTANCE = 0
CREASE = 40.0
"""Angle in degrees between faces below which the surface is shaded as curved."""


SMALL = 0.12
"""Area in square metres below which a triangle may be left out far away."""
THIN = 0.25
"""Share of its small triangles that a far tree keeps."""
LEAF = 0.008
"""Area in square metres of the leaves that replace a card seen from near."""
MOST = 12
"""Largest number of leaves per card."""
ROW = 16
"""Floats in a row of a surface: 64 bytes, one line of a processor's cache."""
IGNORED = 0.5
"""Added to the material index, a whole number, of faces that labels ignore."""


class Shape(NamedTuple):
    """One mesh, ready to be placed; metres in its own frame.

    A row of ``surface`` has all that shading needs of a face: its normal (0-2), the smoothed normals at its
    corners (3-11), its linear RGB albedo (12-14), and its index into MATERIALS (15), plus a half if labels
    ignore the face.
    """

    vertices: np.ndarray  # f32[v, 3]
    faces: np.ndarray  # i32[f, 3]
    surface: np.ndarray  # f32[f, ROW]
    ball: np.ndarray  # f32[4] centre and radius of a bounding sphere
    table: tuple[int, ...]  # addresses of surface, vertices, faces; numbers of vertices, faces
    box: np.ndarray  # f32[8, 3] corners of a bounding box

    @classmethod
    def of(cls, vertices: np.ndarray, faces: np.ndarray, surface: np.ndarray) -> Shape:
        """Make a shape of these arrays, which must be contiguous."""
        ends, most = _bounds(vertices)
        ball = np.append((ends[0] + ends[1]) / 2, 1.0001 * math.sqrt(most)).astype(np.float32)
        addresses = (int(a.ctypes.data) for a in (surface, vertices, faces))
        box = np.stack(np.meshgrid(*ends.T, indexing="ij"), axis=-1).reshape(8, 3)
        table = (*addresses, len(vertices), len(faces))
        return cls(vertices, faces, surface, ball, table, box)

    def __reduce__(self) -> tuple[Any, ...]:
        """Addresses are those of one process: a copy has its own."""
        return Shape.of, (self.vertices, self.faces, self.surface)

    @property
    def normal(self) -> np.ndarray:
        """Unit normals f32[f, 3] of the flat faces."""
        return self.surface[:, 0:3]

    @property
    def corners(self) -> np.ndarray:
        """Unit normals f32[f, 3, 3] at each corner, smoothed where there is no edge."""
        return self.surface[:, 3:12].reshape(-1, 3, 3)

    @property
    def color(self) -> np.ndarray:
        """Linear RGB albedo f32[f, 3]."""
        return self.surface[:, 12:15]

    @property
    def material(self) -> np.ndarray:
        """Index i64[f] into MATERIALS."""
        return self.surface[:, 15].astype(np.int64)


class Geometry(NamedTuple):
    """Shapes and the poses of their instances; nothing is copied, since streets share shapes."""

    shapes: tuple[Shape, ...]  # each once
    shape: np.ndarray  # i64[instances] index into them; sky: -1
    tables: np.ndarray  # u64[instances, 5] ``Shape.table`` of each instance; sky: 0
    balls: np.ndarray  # f32[instances, 4] ``Shape.ball``, in its own frame
    pose: np.ndarray  # f32[instances, 3, 4] shape -> world
    train_id: np.ndarray  # u8[instances]; instance 0 is the sky
    boxes: np.ndarray  # f32[instances, 8, 3] ``Shape.box``, in its own frame
    assets: tuple[AssetKey, ...] = ()  # keys of the shapes, after those of the ground
    road_vertices: tuple[np.ndarray, ...] = ()
    """f32[v, 3] road coordinates of the ground's vertices, instances 1, 2, 3, if it bends or slopes."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Addresses are those of one process: a copy has its own."""
        return stand, (
            self.shapes, self.shape, self.pose, self.train_id, self.assets, self.road_vertices,
        )  # fmt: skip

    @property
    def surfaces(self) -> np.ndarray:
        """Address u64[instances] of each instance's ``surface``."""
        return np.ascontiguousarray(self.tables[:, 0])

    @property
    def triangles(self) -> int:
        """Number of triangles in the street, over all instances."""
        return int(self.tables[:, 4].sum())


def shape_of(asset: Asset, tone: float = 1.0) -> Shape:
    """The shape of an asset, its albedo times ``tone``."""
    vertices = np.ascontiguousarray(asset.mesh.vertices, np.float32)
    faces = np.ascontiguousarray(asset.mesh.faces, np.int32)
    surface = np.empty((len(faces), ROW), np.float32)
    _normals(vertices, faces, _meeting(vertices, faces), math.cos(math.radians(CREASE)), surface)
    surface[:, 12:15] = np.minimum(tone * np.asarray(asset.color), 1.0)
    surface[:, 15] = asset.material
    if asset.ignored is not None:
        surface[asset.ignored, 15] += IGNORED
    return Shape.of(vertices, faces, surface)


@njit(cache=True)
def _meeting(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners i64[3 f] of faces grouped by position, and the start i64[places + 1] of each group.

    Solids are merged part by part, so touching corners are found by their position, in tenths of a
    millimetre.
    """
    n = len(vertices)
    slots = 1 << math.ceil(math.log2(2 * n + 1))
    table, keys = np.full(slots, -1, np.int64), np.empty(n, np.int64)
    place_of, places = np.empty(n, np.int64), 0
    for i in range(n):
        key = np.int64(0)
        for k in range(3):
            key += np.int64(np.rint(vertices[i, k] * f32(1e4))) << (21 * k)
        at = (key * -7046029254386353131 >> 20) & (slots - 1)
        while table[at] >= 0 and keys[table[at]] != key:
            at = (at + 1) & (slots - 1)
        if table[at] < 0:
            table[at], keys[places] = places, key
            places += 1
        place_of[i] = table[at]
    begin = np.zeros(places + 1, np.int64)
    for corner in faces.flat:
        begin[place_of[corner] + 1] += 1
    for place in range(places):
        begin[place + 1] += begin[place]
    free, order = begin.copy(), np.empty(3 * len(faces), np.int64)
    for f in range(len(faces)):
        for k in range(3):
            place = place_of[faces[f, k]]
            order[free[place]] = 3 * f + k
            free[place] += 1
    return order, begin


@njit(cache=True)
def _normals(
    vertices: np.ndarray, faces: np.ndarray, meeting: tuple[np.ndarray, np.ndarray], least: float,
    surface: np.ndarray,
) -> None:  # fmt: skip
    """Normal of each face, and at its corners the mean over adjacent faces that bend less than the crease.

    The mean is weighted by area. Faces may be wound either way: a normal counts in the direction that agrees.
    """
    area = np.empty((len(faces), 3), np.float32)
    for f in range(len(faces)):
        p, q, r = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        x, y, z = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        u, v, w = r[0] - p[0], r[1] - p[1], r[2] - p[2]
        area[f, 0], area[f, 1], area[f, 2] = y * w - z * v, z * u - x * w, x * v - y * u
        length = f32(math.sqrt(area[f, 0] ** 2 + area[f, 1] ** 2 + area[f, 2] ** 2))
        for k in range(3):
            surface[f, k] = area[f, k] / length if length > 0 else f32(0)
    order, begin = meeting
    for place in range(len(begin) - 1):
        for i in range(begin[place], begin[place + 1]):
            face, corner = order[i] // 3, order[i] % 3
            x, y, z = float(area[face, 0]), float(area[face, 1]), float(area[face, 2])
            for j in range(begin[place], begin[place + 1]):
                other = order[j] // 3
                if other == face:
                    continue
                dot = (
                    surface[face, 0] * surface[other, 0]
                    + surface[face, 1] * surface[other, 1]
                    + surface[face, 2] * surface[other, 2]
                )
                if abs(dot) > least:
                    sign = 1.0 if dot > 0 else -1.0
                    x += sign * area[other, 0]
                    y += sign * area[other, 1]
                    z += sign * area[other, 2]
            size = max((x * x + y * y + z * z) ** 0.5, 1e-20)
            surface[face, 3 + 3 * corner] = x / size
            surface[face, 4 + 3 * corner] = y / size
            surface[face, 5 + 3 * corner] = z / size


@njit(cache=True)
def _bounds(vertices: np.ndarray) -> tuple[np.ndarray, np.float32]:
    """Low and high corner f32[2, 3] of points f32[v, 3], and largest squared distance from their centre."""
    ends = np.empty((2, 3), np.float32)
    for k in range(3):
        ends[0, k] = ends[1, k] = vertices[0, k]
    for i in range(len(vertices)):
        for k in range(3):
            ends[0, k] = min(ends[0, k], vertices[i, k])
            ends[1, k] = max(ends[1, k], vertices[i, k])
    most = f32(0)
    for i in range(len(vertices)):
        away = f32(0)
        for k in range(3):
            away += (vertices[i, k] - (ends[0, k] + ends[1, k]) / f32(2)) ** 2
        most = max(most, away)
    return ends, most


def thinned(shape: Shape, share: float) -> Shape:
    """Keep a ``share`` of the small triangles, leaves and twigs, enlarged so that they cover the same area.

    From afar a crown looks the same, and rays pass it faster. Source: stochastic simplification (Cook,
    Halstead, Planck, Ryu 2007).
    """
    corners = shape.vertices[shape.faces]
    area = (
        np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        / 2
    )
    small = area < SMALL
    keep = ~small | (np.arange(len(area)) * 0.618034 % 1.0 < share)
    middle = corners.mean(axis=1, keepdims=True)
    scale = np.where(small, share**-0.5, 1.0)[:, None, None]
    grown = (middle + scale * (corners - middle))[keep].astype(np.float32).reshape(-1, 3)
    faces = np.arange(len(grown), dtype=np.int32).reshape(-1, 3)
    return Shape.of(grown, faces, np.ascontiguousarray(shape.surface[keep]))


def leafed(shape: Shape) -> Shape:
    """Replace the foliage cards of a shape by leaves: folded rhombs that cover the same area.

    A card is a triangle, which is visible from near. Its leaves are spread over it, each with random
    rotation, tilt and tone.
    """
    cards = np.flatnonzero(shape.material == MATERIAL_ID["foliage"])
    corners = shape.vertices[shape.faces[cards]].astype(np.float64)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.linalg.norm(np.cross(first, second), axis=1) / 2
    number = np.clip(np.ceil(area / LEAF), 1, MOST).astype(int)
    card = np.repeat(np.arange(len(cards)), number)
    rng = table_row("leaves")
    normal, share = shape.normal[cards][card], rng.random((len(card), 2))
    share = np.where(share.sum(axis=1, keepdims=True) > 1, 1 - share, share)
    middle = corners[card, 0] + share[:, :1] * first[card] + share[:, 1:] * second[card]
    long = rng.normal(size=(len(card), 3)) + normal
    long = np.cross(long, normal) + 0.35 * rng.normal(size=long.shape)
    long /= np.linalg.norm(long, axis=1, keepdims=True).clip(1e-9)
    across = np.cross(long, normal + 0.35 * rng.normal(size=long.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True).clip(1e-9)
    # A rhomb of 1 by 0.6 times its length, folded along its middle.
    length = np.sqrt(area / number / 0.3)[card, None]
    half, wide = 0.5 * length * long, 0.3 * length * across
    fold = 0.12 * length * np.cross(long, across)
    places = np.stack([middle - half, middle + wide + fold - 0.15 * half, middle + half,
                       middle - wide + fold - 0.15 * half], axis=1)  # fmt: skip
    start = 4 * np.arange(len(card))[:, None, None]
    faces = (start + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    tone = rng.uniform(0.75, 1.3, len(card))
    kept_faces = np.delete(np.arange(len(shape.faces)), cards)
    wood = np.ascontiguousarray(shape.faces[kept_faces])
    leaves = np.repeat(shape.surface[cards][card], 2, axis=0)
    leaves[:, 12:15] = np.minimum(leaves[:, 12:15] * np.repeat(tone, 2)[:, None], 1.0)
    flat = np.cross(places[:, (1, 2)] - places[:, :1], places[:, (2, 3)] - places[:, :1]).reshape(
        -1, 3
    )
    flat /= np.linalg.norm(flat, axis=1, keepdims=True).clip(1e-12)
    leaves[:, 0:12] = np.tile(flat, 4)
    return Shape.of(
        np.concatenate([shape.vertices, places.reshape(-1, 3).astype(np.float32)]),
        np.concatenate([wood, len(shape.vertices) + faces]).astype(np.int32),
        np.concatenate([shape.surface[kept_faces], leaves]),
    )


SEEN_FROM: dict[str, Callable[[Shape], Shape]] = {
    "far": partial(thinned, share=THIN),
    "near": leafed,
}
"""Level of detail of greenery, by distance from the cameras."""


@lru_cache(maxsize=2048)
def asset_shape(family: str, asset: int | str, seen_from: str = "") -> Shape:
    """The shape of a catalogue asset, in full or as ``seen_from`` "near" or "far"."""
    if isinstance(asset, str):  # a user's own, whose file may change
        return _make_shape(family, asset, seen_from)

    def make() -> Arrays:
        shape = _make_shape(family, asset, seen_from)
        return {"vertices": shape.vertices, "faces": shape.faces, "surface": shape.surface}

    name = "-".join(["shape", family, str(asset), *([seen_from] if seen_from else [])]).replace(
        " ", "_"
    )
    return Shape.of(**cached(name, make, _is_valid))


def _make_shape(family: str, asset: int | str, seen_from: str) -> Shape:
    if seen_from:
        return SEEN_FROM[seen_from](asset_shape(family, asset))
    tone = catalogue.FAMILIES[family].tone if isinstance(asset, int) else 1.0
    return shape_of(catalogue.asset(family, asset), tone)


def _is_valid(arrays: Arrays) -> bool:
    """Whether these are the arrays of a shape; compiled code follows their indices without checks."""
    if set(arrays) != {"vertices", "faces", "surface"}:
        return False
    vertices, faces, surface = arrays["vertices"], arrays["faces"], arrays["surface"]
    return bool(
        (vertices.dtype, faces.dtype, surface.dtype) == (np.float32, np.int32, np.float32)
        and vertices.ndim == 2 and vertices.shape[1] == 3 and len(vertices)
        and faces.ndim == 2 and faces.shape[1] == 3 and surface.shape == (len(faces), ROW)
        and len(faces) and 0 <= faces.min() and faces.max() < len(vertices)
        and 0 <= surface[:, 15].min() and surface[:, 15].max() < len(MATERIALS)
        and all(a.flags.c_contiguous for a in (vertices, faces, surface))
    )  # fmt: skip


def build(street: Street) -> Geometry:
    """Collect the shapes and poses of a street."""
    ground = ground_surfaces(street.ground)
    shapes = [shape_of(surface.asset) for surface in ground.values()]
    road_vertices = () if street.ground.path.straight else tuple(
        surface.road.astype(np.float32) for surface in ground.values()
    )  # fmt: skip
    stands, first = instances(street), len(shapes)
    shapes += [asset_shape(*key) for key in stands.assets]
    labels = [int(TrainId.SKY), *GROUND_INSTANCES.values()]
    return stand(
        shapes,
        np.concatenate([np.arange(-1, first), first + stands.asset]),
        np.concatenate([np.eye(3, 4, dtype=np.float32)[None].repeat(1 + first, 0), stands.pose]),
        np.concatenate([np.array(labels, np.uint8), stands.train_id]),
        stands.assets,
        road_vertices,
    )


def stand(
    shapes: Sequence[Shape],
    shape: np.ndarray,
    pose: np.ndarray,
    train_id: np.ndarray,
    assets: tuple[AssetKey, ...] = (),
    road_vertices: tuple[np.ndarray, ...] = (),
) -> Geometry:
    """Place shapes; row 0 of the arrays, see ``Geometry``, is the sky."""
    tables, balls, boxes = (
        np.array(parts, kind)[shape]
        for parts, kind in (
            ([shape.table for shape in shapes], np.uint64),
            ([shape.ball for shape in shapes], np.float32),
            ([shape.box for shape in shapes], np.float32),
        )
    )
    tables[SKY_INSTANCE] = 0
    return Geometry(
        tuple(shapes), shape, tables, balls, pose, train_id, boxes, assets, road_vertices
    )


class World(NamedTuple):
    """All instances merged, in world metres."""

    vertices: np.ndarray  # f32[3 f, 3], three for each face
    instance: np.ndarray  # i32[f]
    face: np.ndarray  # i32[f] index into the faces of the instance's shape


def world(geometry: Geometry) -> World:
    """Merge the triangles of all instances, for renderers without instancing."""
    shapes = [geometry.shapes[k] for k in geometry.shape[1:]]
    counts = [len(shape.faces) for shape in shapes]
    parts = [
        (shape.vertices @ pose[:, :3].T + pose[:, 3])[shape.faces].reshape(-1, 3)
        for shape, pose in zip(shapes, geometry.pose[1:], strict=True)
    ]
    return World(
        np.concatenate(parts),
        np.repeat(np.arange(1, 1 + len(counts), dtype=np.int32), counts),
        np.concatenate([np.arange(n, dtype=np.int32) for n in counts]),
    )
