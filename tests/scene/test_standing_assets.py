"""Buildings, trees and bushes: sound, of real sizes, repeatable."""

import hashlib
import importlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from trimesh.ray.ray_pyembree import RayMeshIntersector as Rays

from scene.asset import Asset
from scene.materials import MATERIALS, material_id

BUDGET = {
    "building": 2500, "tree": 7500, "bush": 2500,
}  # fmt: skip
"""Most triangles of each family."""

LIMITS = {
    # low and high corner of the space an asset keeps to, metres
    "building": ((-7.7, -1.25, 0), (7.7, 12.6, 26)),
    "tree": ((-8, -8, 0), (8, 8, 14.2)),
    "bush": ((-2.6, -1.4, 0), (2.6, 1.4, 2.6)),
}
FAMILIES = {name: importlib.import_module(f"scene.assets.{name}") for name in BUDGET}
KINDS = [(name, kind) for name, module in FAMILIES.items() for kind in module.KINDS]

BARE = ["bare lime", "half bare", "bare broad", "pollard", "birch", "bare poplar", "ivied",
        "young bare", "bare vase"]  # fmt: skip
"""Kinds of trees that carry few leaves or none."""

every_kind = pytest.mark.parametrize(("family", "kind"), KINDS)
seeds = st.integers(0, 2**32 - 1)


def make(family: str, kind: str, seed: int) -> Asset:
    module = FAMILIES[family]
    params = getattr(module, f"sample_{family}")(np.random.default_rng(seed), kind)
    return getattr(module, family)(params)


def digest(asset: Asset) -> str:
    arrays = (asset.mesh.vertices, asset.mesh.faces, asset.color, asset.material)
    return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()


def fill(asset: Asset, low: float, high: float) -> float:
    """Share of rays along y that hit the asset, within its width and the given heights."""
    (left, front, _), (right, _, _) = asset.mesh.bounds
    x, z = np.meshgrid(np.linspace(left, right, 101), np.linspace(low, high, 61))
    origins = np.column_stack([x.ravel(), np.full(x.size, front - 1), z.ravel()])
    rays = np.tile([0.0, 1.0, 0.0], (x.size, 1))
    return float(Rays(asset.mesh).intersects_any(origins, rays).mean())


@pytest.mark.parametrize("family", FAMILIES)
def test_at_least_four_kinds(family):
    kinds = FAMILIES[family].KINDS
    assert len(set(kinds)) == len(kinds) >= 4


@every_kind
@given(seed=seeds)
def test_a_sound_asset(family, kind, seed):
    asset = make(family, kind, seed)
    mesh, count = asset.mesh, len(asset.mesh.faces)
    assert 0 < count <= BUDGET[family]
    assert asset.color.shape == (count, 3) and asset.color.dtype == np.float32
    assert asset.material.shape == (count,) and asset.material.dtype == np.uint8
    assert asset.material.max() < len(MATERIALS)
    assert 0 <= asset.color.min() and asset.color.max() <= 1
    assert np.isfinite(mesh.vertices).all()
    low, high = LIMITS[family]
    assert (mesh.bounds[0] >= np.array(low) - 1e-9).all() and (mesh.bounds[1] <= high).all()
    assert mesh.bounds[0, 2] == pytest.approx(0, abs=1e-9)


@every_kind
def test_same_seed_same_bytes_and_other_seeds_others(family, kind):
    digests = [digest(make(family, kind, seed)) for seed in range(4)]
    assert digests == [digest(make(family, kind, seed)) for seed in range(4)]
    assert len(set(digests)) == 4


@pytest.mark.parametrize("family", FAMILIES)
def test_the_kinds_differ(family):
    kinds = FAMILIES[family].KINDS
    assert len({digest(make(family, kind, 0)) for kind in kinds}) == len(kinds)


@pytest.mark.parametrize("family", FAMILIES)
def test_unknown_kind_is_refused_by_name(family):
    with pytest.raises(ValueError, match=r"unknown kind of .*'marble'; known: "):
        make(family, "marble", 0)


@pytest.mark.parametrize("kind", [k for k in FAMILIES["building"].KINDS if k != "car park"])
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
    hits = Rays(mesh).intersects_any(targets - 30 * rays, rays)
    assert hits.all()


@pytest.mark.parametrize(("family", "kind"), [k for k in KINDS if k[0] == "building"])
@given(seed=seeds)
def test_faces_towards_the_road_never_fight_for_one_plane(family, kind, seed):
    """No upright face lies within 3 cm before or behind another one that faces the same way."""
    mesh = make(family, kind, seed).mesh
    facing = mesh.triangles[np.abs(mesh.face_normals[:, 1]) > 0.999]
    corners, depth = facing[:, :, [0, 2]], facing[:, 0, 1]
    middle = corners.mean(axis=1)
    edge = np.roll(corners, -1, axis=1) - corners
    out = middle[:, None, None] - corners  # [points, triangles, corners, 2]
    side = edge[..., 0] * out[..., 1] - edge[..., 1] * out[..., 0]
    inside = (side > 1e-9).all(axis=-1) | (side < -1e-9).all(axis=-1)
    near = np.abs(depth[:, None] - depth) < 0.03
    assert (inside & near).sum() == len(facing)  # each lies in itself alone


@pytest.mark.parametrize("kind", BARE)
@given(seed=seeds)
def test_sky_shows_through_a_bare_tree(kind, seed):
    asset = make("tree", kind, seed)
    top = asset.mesh.bounds[1, 2]
    assert 0.02 < fill(asset, 0.4 * top, top) < 0.6


def test_two_trees_in_five_are_bare_or_half_bare():
    kinds = FAMILIES["tree"].KINDS
    assert set(BARE) <= set(kinds)
    assert sum(kinds[index % len(kinds)] in BARE for index in range(24)) >= 0.4 * 24


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
    for kind in FAMILIES[family].KINDS:
        asset = make(family, kind, 1)
        leaves = asset.material == material_id("foliage")
        assert not leaves.any() or asset.color[leaves].std(axis=0).max() > 0.005
