"""Street furniture: walls, fences, posts, signs and lights are sound, of real sizes, repeatable."""

import hashlib
import importlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from trimesh.ray.ray_pyembree import RayMeshIntersector as Rays

from scene.asset import Asset
from scene.assets import signpost, traffic_light, traffic_sign
from scene.materials import MATERIALS, material_id

BUDGET = {
    "wall": 1900, "fence": 1150, "lamp": 900, "signpost": 700, "traffic_light": 600,
    "traffic_sign": 320,
}  # fmt: skip
"""Most triangles of each family."""

LIMITS = {
    # low and high corner of the space an asset keeps to, metres
    "wall": ((-2, -0.15, 0), (2, 0.6, 3.2)),
    "fence": ((-2, -0.2, 0), (2, 0.2, 2.5)),
    "lamp": ((-0.5, -3, 0), (0.5, 3, 9.5)),
    "signpost": ((-0.35, -2.3, 0), (0.4, 0.6, signpost.MAX_HEIGHT)),
    "traffic_light": ((-0.55, -0.7, 1.4), (0, 0.7, 4)),
    "traffic_sign": ((-0.15, -1.1, 1.2), (0, 1.1, 3.1)),
}
FAMILIES = {name: importlib.import_module(f"scene.assets.{name}") for name in BUDGET}
KINDS = [(name, kind) for name, module in FAMILIES.items() for kind in module.KINDS]
HANGING = ("traffic_light", "traffic_sign")

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
@settings(max_examples=6)
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
    if family not in HANGING:
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


@pytest.mark.parametrize(("family", "kind"), [k for k in KINDS if k[0] == "wall"])
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


@pytest.mark.parametrize("kind", FAMILIES["fence"].KINDS)
@given(seed=seeds)
def test_one_sees_through_a_fence(kind, seed):
    asset = make("fence", kind, seed)
    share = fill(asset, 0.02, asset.mesh.bounds[1, 2] - 0.02)
    assert 0.03 < share < (0.97 if kind == "boards" else 0.8)


@settings(max_examples=4)
@given(seed=seeds)
def test_every_sign_and_light_hangs_on_every_post(seed):
    for kind in signpost.KINDS:
        post = make("signpost", kind, seed)
        assert post.mesh.bounds[1, 2] >= signpost.MIN_HEIGHT
        points = post.mesh.vertices
        level = (points[:, 2] > traffic_sign.LOWEST) & (points[:, 2] < signpost.MIN_HEIGHT)
        # Nothing of a post stands before the plates.
        assert points[level, 0].min(initial=0.0) >= -1.15 * signpost.MAX_RADIUS - 1e-9
    for family in HANGING:
        for kind in FAMILIES[family].KINDS:
            mesh = make(family, kind, seed).mesh
            assert mesh.bounds[0, 2] < signpost.MIN_HEIGHT - 0.05
            assert -0.07 < mesh.bounds[1, 0] <= -signpost.MAX_RADIUS + 0.01
            assert mesh.bounds[0, 1] < 0 < mesh.bounds[1, 1]


@settings(max_examples=4)
@given(seed=seeds)
def test_sign_shows_its_face_to_the_camera_and_grey_to_the_back(seed):
    for kind in FAMILIES["traffic_sign"].KINDS:
        params = FAMILIES["traffic_sign"].sample_traffic_sign(np.random.default_rng(seed), kind)
        asset = FAMILIES["traffic_sign"].traffic_sign(params)
        level = params.centre + 0.01
        back = Rays(asset.mesh).intersects_first([[5.0, 0.001, level]], [[-1.0, 0, 0]])[0]
        assert np.allclose(asset.color[back], np.float32(params.back))
        front = Rays(asset.mesh).intersects_first([[-5.0, 0.001, level]], [[1.0, 0, 0]])[0]
        assert any(
            np.allclose(asset.color[front], np.float32(la.color)) for la in params.layers[1:]
        )


@given(seed=seeds)
def test_one_lamp_shines_in_each_head(seed):
    for kind in traffic_light.KINDS:
        params = traffic_light.sample_traffic_light(np.random.default_rng(seed), kind)
        asset = traffic_light.traffic_light(params)
        lenses = asset.color[asset.material == material_id("lamp")].max(axis=1).reshape(-1, 16)
        assert (lenses.min(axis=1) > 0.9).sum() == len(params.heads)
        assert len(lenses) == sum(len(head.lamps) for head in params.heads)


def test_lights_show_red_amber_and_green():
    shown = set()
    for seed in range(6):
        for kind in traffic_light.KINDS:
            params = traffic_light.sample_traffic_light(np.random.default_rng(seed), kind)
            shown |= {head.lamps[head.lit] for head in params.heads}
    assert shown >= {traffic_light.RED, traffic_light.AMBER, traffic_light.GREEN}


@settings(max_examples=10)
@given(seed=seeds)
def test_street_lamp_arm_reaches_over_the_road(seed):
    for kind in ("arm", "swan neck", "double"):
        mesh = make("lamp", kind, seed).mesh
        high = mesh.vertices[mesh.vertices[:, 2] > 4]
        assert high[:, 1].min() < -1
        assert (high[:, 1].max() > 1) == (kind == "double")
