"""Standing assets: buildings, walls, fences, plants, signs, lights and lamps."""

import numpy as np
import pytest
from hypothesis import given, settings

from scene.assets import building, signpost, traffic_light, traffic_sign, tree
from scene.look.materials import material_id
from tests.scene.conftest import SEEDS, cast, hits, kinds, make, solid

BARE = ["bare lime", "half bare", "bare broad", "pollard", "birch", "bare poplar", "ivied",
        "young bare", "bare vase"]  # fmt: skip
"""Kinds of trees with few leaves or none."""


def coverage(asset, share):
    """Share of rays along y that hit the asset, over its width and above a share of its height."""
    (left, front, _), (right, _, top) = asset.mesh.bounds
    heights = np.linspace(max(share * top, 0.02), top - 0.02, 61)
    x, z = (grid.ravel() for grid in np.meshgrid(np.linspace(left, right, 101), heights))
    origins = np.column_stack([x, np.full(x.size, front - 1), z])
    return hits(asset.mesh, origins, np.array([[0.0, 1.0, 0.0]])).mean()


@pytest.mark.parametrize("kind", [k for k in building.FAMILY.kinds if k != "car park"])
@given(seed=SEEDS)
def test_building_has_a_near_face_windows_sides_and_a_back(kind, seed):
    asset_mesh, _, material, *_ = make("building", kind, seed)
    mesh = solid(asset_mesh)
    glass = material == material_id("glass")
    at_facade = np.abs(mesh.triangles[:, :, 1]).max(axis=1) < 1e-9
    assert glass.sum() >= 8 and mesh.area_faces[at_facade].sum() > 15
    windows = mesh.area_faces[glass & (mesh.triangles[:, :, 1].max(axis=1) < 0.2)].sum()
    width, depth, height = mesh.extents
    assert 0.05 < windows / (width * height) < (1 if kind == "curtain wall" else 0.7)
    assert 8 <= width <= 15.4 and 8 <= depth <= 14 and 5 <= height <= 26
    rays = np.array([[1.0, 0, 0], [-1, 0, 0], [0, -1, 0], [0, 1, 0]])
    targets = np.array([0.0, mesh.bounds.mean(axis=0)[1], 2.0])
    assert hits(asset_mesh, targets - 30 * rays, rays).all()


@pytest.mark.parametrize(("family", "kind"), kinds(["building", "wall"]))
@given(seed=SEEDS)
def test_faces_towards_the_road_never_share_a_plane(family, kind, seed):
    # None is within 3 cm of another one that it overlaps.
    mesh = solid(make(family, kind, seed).mesh)
    facing = mesh.triangles[np.abs(mesh.face_normals[:, 1]) > 0.999]
    corners, depth = facing[:, :, [0, 2]], facing[:, 0, 1]
    edge = np.roll(corners, -1, axis=1) - corners
    offset = corners.mean(axis=1)[:, None, None] - corners  # [points, triangles, corners, 2]
    side = edge[..., 0] * offset[..., 1] - edge[..., 1] * offset[..., 0]
    inside = (side > 1e-9).all(axis=-1) | (side < -1e-9).all(axis=-1)
    near = np.abs(depth[:, None] - depth) < 0.03
    assert (inside & near).sum() == len(facing)  # each overlaps only itself


@pytest.mark.parametrize(("family", "kind"), [*kinds(["fence"]), *(("tree", k) for k in BARE)])
@given(seed=SEEDS)
def test_fences_and_bare_trees_are_see_through(family, kind, seed):
    asset = make(family, kind, seed)
    if family == "fence":
        assert 0.03 < coverage(asset, 0.0) < (0.97 if kind == "boards" else 0.8)
    else:
        assert 0.02 < coverage(asset, 0.4) < 0.6


def test_two_trees_in_five_are_bare_or_half_bare_and_leafy_crowns_are_ragged_but_closed():
    names = tree.FAMILY.kinds
    assert set(BARE) <= set(names)
    assert sum(names[index % len(names)] in BARE for index in range(24)) >= 0.4 * 24
    assert 0.3 < coverage(make("tree", "plane", 0), 0.4) < 0.9


@given(seed=SEEDS)
def test_wood_tapers_to_the_twigs_and_a_young_tree_stands_between_stakes(seed):
    mesh = solid(make("tree", "bare lime", seed).mesh)
    foot = mesh.triangles[..., 2].min(axis=1)
    assert mesh.area_faces[foot > 5].mean() < 0.2 * mesh.area_faces[foot < 0.1].mean()
    for kind in ("young", "young bare"):
        asset = make("tree", kind, seed)
        wood = solid(asset.mesh).triangles[asset.material == material_id("wood")]
        assert wood[..., 2].max() > 1 and wood[..., 1].min() < -0.2 < 0.2 < wood[..., 1].max()


@pytest.mark.parametrize(("family", "kind"), kinds(["tree", "bush"]))
def test_leaves_vary_in_shade(family, kind):
    asset = make(family, kind, 1)
    leaves = asset.material == material_id("foliage")
    assert not leaves.any() or asset.color[leaves].std(axis=0).max() > 0.005


@settings(max_examples=4)
@given(seed=SEEDS)
def test_every_sign_and_light_hangs_on_every_post(seed):
    for kind in signpost.FAMILY.kinds:
        points = make("signpost", kind, seed).mesh.vertices
        assert points[:, 2].max() >= signpost.MIN_HEIGHT
        level = (points[:, 2] > traffic_sign.LOWEST) & (points[:, 2] < signpost.MIN_HEIGHT)
        # No part of a post is in front of the plates.
        assert points[level, 0].min(initial=0.0) >= -1.15 * signpost.MAX_RADIUS - 1e-9
    for family, kind in kinds(["traffic light", "traffic sign"]):
        low, high = make(family, kind, seed).mesh.bounds
        assert low[2] < signpost.MIN_HEIGHT - 0.05
        assert -0.07 < high[0] <= -signpost.MAX_RADIUS + 0.01 and low[1] < 0 < high[1]


@pytest.mark.parametrize("kind", traffic_sign.FAMILY.kinds)
@settings(max_examples=4)
@given(seed=SEEDS)
def test_sign_shows_its_face_to_the_camera_and_grey_to_the_back(kind, seed):
    params = traffic_sign.sample_traffic_sign(np.random.default_rng(seed), kind)
    asset = traffic_sign.traffic_sign(params)
    layers = [layer.color for layer in params.layers[1:]]
    for x, expected in ((5.0, [params.back]), (-5.0, layers)):
        start, ray = np.array([x, 0.001, params.centre + 0.01]), np.array([[-x / 5, 0, 0]])
        distance = cast(start, ray, solid(asset.mesh).triangles)[0][0]
        color = asset.color[distance.argmin()]
        assert np.isfinite(distance.min()) and np.isclose(color, expected).all(axis=1).any()


@given(seed=SEEDS)
def test_one_lamp_shines_in_each_head(seed):
    for kind in traffic_light.FAMILY.kinds:
        params = traffic_light.sample_traffic_light(np.random.default_rng(seed), kind)
        asset = traffic_light.traffic_light(params)
        shining = asset.color[asset.material == material_id("lamp")].reshape(-1, 16, 3)
        dark = asset.color[asset.material == material_id("glass")].reshape(-1, 16, 3)
        assert len(shining) == len(params.heads) and shining.max(axis=2).min() > 0.9
        assert len(shining) + len(dark) == sum(len(head.lamps) for head in params.heads)
        assert dark.size == 0 or dark.max() < 0.1  # lamps that are off are dark


@given(seed=SEEDS)
def test_heads_side_by_side_show_one_colour_or_stop(seed):
    for kind in traffic_light.FAMILY.kinds:
        first, *others = traffic_light.sample_traffic_light(np.random.default_rng(seed), kind).heads
        lit_color = first.lamps[first.lit]
        for head in others:
            expected = lit_color if lit_color in head.lamps else traffic_light.LIGHT_RED
            assert head.lamps[head.lit] == expected


def test_lights_show_red_amber_and_green():
    lights = [traffic_light.sample_traffic_light(np.random.default_rng(seed), kind)
             for seed in range(6) for kind in traffic_light.FAMILY.kinds]  # fmt: skip
    lit_colors = {head.lamps[head.lit] for params in lights for head in params.heads}
    assert lit_colors >= {
        traffic_light.LIGHT_RED,
        traffic_light.LIGHT_AMBER,
        traffic_light.LIGHT_GREEN,
    }


@settings(max_examples=10)
@given(seed=SEEDS)
def test_street_lamp_arm_reaches_over_the_road(seed):
    for kind in ("arm", "swan neck", "double"):
        _, y, z = make("lamp", kind, seed).mesh.vertices.T
        assert y[z > 4].min() < -1 and (y[z > 4].max() > 1) == (kind == "double")
