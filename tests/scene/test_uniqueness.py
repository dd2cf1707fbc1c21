"""No two assets of the catalogue look the same, and the measure of that is not fooled."""

import math

import numpy as np
import pytest
from trimesh import Trimesh

from scene.assets.catalogue import COUNTS, FAMILIES, asset, families_of, surfaces
from scene.assets.signature import (
    LOOK_ALIKE,
    SIDE,
    SIZE_WEIGHT,
    closest,
    distance,
    distances,
    signature,
)
from scene.classes import CLASS_NAMES
from scene.mesh.asset import box, merge, recolor, translate

WANTED = {
    "person": 200, "car": 195, "bus": 28, "truck": 39, "building": 106, "bicycle": 18,
    "vegetation": 19, "sky": 14, "motorcycle": 18, "rider": 30, "train": 8, "fence": 16, "wall": 16,
    "pole": 16, "traffic light": 10, "traffic sign": 40, "road": 8, "sidewalk": 8, "terrain": 8,
}  # fmt: skip
"""The paper's counts, and as many of what the paper does not count."""
SOLID = ("building", "train", "bush", "motorcycle", "person", "rider", "car", "bus", "truck")
"""Families without thin rails or painted plates, which a shaken vertex breaks up for real."""


def name_of(family: str) -> str:
    return CLASS_NAMES[FAMILIES[family].train_id]


def shaken(original, amount, seed=0):
    """The asset with its corners moved by a share of its size; corners that touch stay together."""
    vertices = np.asarray(original.mesh.vertices)
    _, corner = np.unique(vertices.round(6), axis=0, return_inverse=True)
    spread = amount * np.ptp(vertices, axis=0).max()
    moves = np.random.default_rng(seed).normal(0, spread, (corner.max() + 1, 3))
    mesh = Trimesh(vertices + moves[corner.ravel()], original.mesh.faces, process=False)
    return original._replace(mesh=mesh)


def scaled(original, factor):
    mesh = Trimesh(factor * original.mesh.vertices, original.mesh.faces, process=False)
    return original._replace(mesh=mesh)


def apart(one, other):
    return distance(signature(one), signature(other))


# -- the catalogue ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [n for n in CLASS_NAMES if n not in surfaces()])
def test_no_two_assets_of_a_class_look_the_same(name):
    keys = [(family, index) for family in families_of(name) for index in range(COUNTS[family])]
    assert len(keys) >= WANTED[name]
    found = closest([signature(asset(*key)) for key in keys], 5)
    alike = [(*keys[a], *keys[b], round(d, 3)) for d, a, b in found if d < LOOK_ALIKE]
    assert not alike, "look-alikes: see `python -m scene.assets --closest` and `--redraw`"


@pytest.mark.parametrize("name", surfaces())
def test_surfaces_and_skies_are_named_and_enough(name):
    names = surfaces()[name]
    assert len(set(names)) == len(names) >= WANTED[name]
    assert all(text.strip() for text in names)


@pytest.mark.parametrize("family", FAMILIES)
def test_kinds_are_named_and_all_come_up(family):
    kinds = FAMILIES[family].kinds
    assert 4 <= len(set(kinds)) == len(kinds) <= COUNTS[family]
    assert all(text.strip() for text in kinds)


@pytest.mark.parametrize("family", FAMILIES)
def test_kinds_differ_more_than_look_alikes(family):
    kinds = len(FAMILIES[family].kinds)
    signatures = [signature(asset(family, index)) for index in range(kinds)]
    assert closest(signatures, 1)[0][0] >= LOOK_ALIKE


# -- the measure -----------------------------------------------------------------------------------


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("index", [0, 1])
def test_a_slightly_larger_copy_looks_the_same(family, index):
    original = asset(family, index)
    assert apart(original, original) == 0
    assert apart(original, scaled(original, 1.02)) < LOOK_ALIKE / 2
    assert apart(original, scaled(original, 1.4)) > LOOK_ALIKE


@pytest.mark.parametrize("family", SOLID)
def test_a_shaken_copy_looks_the_same(family):
    original = asset(family, 0)
    assert 0 < apart(original, shaken(original, 5e-4)) < LOOK_ALIKE


@pytest.mark.parametrize("family", ["car", "bus", "truck", "person"])
def test_other_paint_is_another_asset(family):
    original = asset(family, 0)
    which = np.unique(original.color, axis=0, return_inverse=True)[1]
    areas = np.bincount(which.ravel(), original.mesh.area_faces)
    body = (which.ravel() == areas.argmax())[:, None]
    red, blue = (
        original._replace(color=np.where(body, np.float32(paint), original.color))
        for paint in ((0.6, 0.02, 0.02), (0.02, 0.05, 0.5))
    )
    assert apart(red, blue) > LOOK_ALIKE


def test_where_an_asset_stands_and_which_faces_come_first_does_not_count():
    bench = merge(
        box((2, 0.5, 0.1), (0, 0, 0.4), (0.3, 0.2, 0.1)),
        box((0.1, 0.4, 0.4), (0, 0, 0), (0.1,) * 3),
    )
    back_to_front = bench._replace(
        mesh=Trimesh(bench.mesh.vertices, bench.mesh.faces[::-1], process=False),
        color=bench.color[::-1],
    )
    assert apart(bench, translate(bench, (5, -3, 0))) < 1e-3
    assert apart(bench, back_to_front) < 0.02


def test_distances_worked_out_by_hand():
    cube = box((1, 1, 1), (0, 0, 0), (0.5, 0.5, 0.5))
    assert apart(cube, scaled(cube, 2)) == pytest.approx(SIZE_WEIGHT * math.log(2), abs=1e-3)
    black, white = recolor(cube, (0, 0, 0)), recolor(cube, (1, 1, 1))
    seen = signature(cube).cover.sum(axis=(1, 2))
    paint = np.sqrt(seen / (seen + 0.02 * 256)).max()
    assert apart(black, white) == pytest.approx(paint, abs=1e-3)


def test_a_silhouette_covers_what_the_asset_covers():
    plate = box((4, 0.01, 3), (0, 0, 0), (0.5, 0.5, 0.5))
    side = signature(plate).mask[1]  # seen 20 degrees off its normal
    across = 0.92 / np.linalg.norm((4, 0.01, 3))
    area = 4 * math.cos(math.radians(20)) * 3 * across**2
    assert side.sum() / SIDE**2 == pytest.approx(area, rel=0.02)
    assert 0 <= side.min() and side.max() <= 1 + 1e-5


def test_distances_are_symmetric_and_nought_to_themselves():
    signatures = [signature(asset("bicycle", index)) for index in range(6)]
    between = distances(signatures, signatures)
    assert between == pytest.approx(between.T)
    assert (between.diagonal() == 0).all() and (between[~np.eye(6, dtype=bool)] > 0).all()
    nearest = closest(signatures, 3)
    assert [d for d, _, _ in nearest] == sorted(between[np.triu_indices(6, 1)])[:3]


def test_signatures_are_repeatable():
    one, again = signature(asset("person", 3)), signature(asset("person", 3))
    assert all((a == b).all() for a, b in zip(one, again, strict=True))
