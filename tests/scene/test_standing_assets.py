"""Buildings, trees and bushes: what one must see, or see through."""

import numpy as np
import pytest
from hypothesis import given

from scene.assets import building, tree
from scene.assets.families import FAMILIES
from scene.look.materials import material_id
from tests.scene.asset_checks import check_planes, fill, make, seeds
from tests.scene.rays import hits

BARE = ["bare lime", "half bare", "bare broad", "pollard", "birch", "bare poplar", "ivied",
        "young bare", "bare vase"]  # fmt: skip
"""Kinds of trees that carry few leaves or none."""


@pytest.mark.parametrize("kind", [k for k in building.KINDS if k != "car park"])
@given(seed=seeds)
def test_building_has_a_near_face_windows_sides_and_a_back(kind, seed):
    asset = make("building", kind, seed)
    mesh = asset.mesh
    glass = asset.material == material_id("glass")
    assert glass.sum() >= 8
    at_facade = np.abs(mesh.triangles[:, :, 1]).max(axis=1) < 1e-9
    assert mesh.area_faces[at_facade].sum() > 15
    windows = mesh.area_faces[glass & (mesh.triangles[:, :, 1].max(axis=1) < 0.2)].sum()
    width, depth, height = mesh.extents
    assert 0.05 < windows / (width * height) < (1 if kind == "curtain wall" else 0.7)
    assert 8 <= width <= 15.4 and 8 <= depth <= 14 and 5 <= height <= 26
    centre = mesh.bounds.mean(axis=0)
    rays = np.array([[1.0, 0, 0], [-1, 0, 0], [0, -1, 0], [0, 1, 0]])
    targets = np.array([0.0, centre[1], 2.0])
    assert hits(mesh, targets - 30 * rays, rays).all()


@pytest.mark.parametrize("kind", building.KINDS)
@given(seed=seeds)
def test_faces_towards_the_road_never_fight_for_one_plane(kind, seed):
    check_planes(make("building", kind, seed))


@pytest.mark.parametrize("kind", BARE)
@given(seed=seeds)
def test_sky_shows_through_a_bare_tree(kind, seed):
    asset = make("tree", kind, seed)
    top = asset.mesh.bounds[1, 2]
    assert 0.02 < fill(asset, 0.4 * top, top) < 0.6


def test_two_trees_in_five_are_bare_or_half_bare():
    names = tree.KINDS
    assert set(BARE) <= set(names)
    assert sum(names[index % len(names)] in BARE for index in range(24)) >= 0.4 * 24


@given(seed=seeds)
def test_wood_of_a_tree_tapers_from_the_foot_to_the_twigs(seed):
    mesh = make("tree", "bare lime", seed).mesh
    foot = mesh.triangles[..., 2].min(axis=1)
    assert mesh.area_faces[foot > 5].mean() < 0.2 * mesh.area_faces[foot < 0.1].mean()


@given(seed=seeds)
def test_a_young_tree_stands_between_stakes(seed):
    for kind in ("young", "young bare"):
        asset = make("tree", kind, seed)
        wood = asset.mesh.triangles[asset.material == material_id("wood")]
        assert wood[..., 2].max() > 1 and wood[..., 1].min() < -0.2 < 0.2 < wood[..., 1].max()


def test_leafy_crowns_are_ragged_but_closed():
    asset = make("tree", "plane", 0)
    top = asset.mesh.bounds[1, 2]
    assert 0.3 < fill(asset, 0.4 * top, top) < 0.9


@pytest.mark.parametrize("family", ["tree", "bush"])
def test_leaves_vary_in_shade(family):
    for kind in FAMILIES[family].kinds:
        asset = make(family, kind, 1)
        leaves = asset.material == material_id("foliage")
        assert not leaves.any() or asset.color[leaves].std(axis=0).max() > 0.005
