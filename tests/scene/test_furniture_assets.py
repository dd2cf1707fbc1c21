"""Street furniture: walls, fences, posts, signs and lights do what they are there for."""

import numpy as np
import pytest
from hypothesis import given, settings

from scene.assets import fence, signpost, traffic_light, traffic_sign, wall
from scene.look.materials import material_id
from tests.scene.asset_checks import check_planes, fill, kinds, make, seeds
from tests.scene.rays import first_face

HANGING = ("traffic light", "traffic sign")


@pytest.mark.parametrize("kind", wall.KINDS)
@given(seed=seeds)
def test_faces_towards_the_road_never_fight_for_one_plane(kind, seed):
    check_planes(make("wall", kind, seed))


@pytest.mark.parametrize("kind", fence.KINDS)
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
    for family, kind in kinds(HANGING):
        mesh = make(family, kind, seed).mesh
        assert mesh.bounds[0, 2] < signpost.MIN_HEIGHT - 0.05
        assert -0.07 < mesh.bounds[1, 0] <= -signpost.MAX_RADIUS + 0.01
        assert mesh.bounds[0, 1] < 0 < mesh.bounds[1, 1]


@settings(max_examples=4)
@given(seed=seeds)
def test_sign_shows_its_face_to_the_camera_and_grey_to_the_back(seed):
    for kind in traffic_sign.KINDS:
        params = traffic_sign.sample_traffic_sign(np.random.default_rng(seed), kind)
        asset = traffic_sign.traffic_sign(params)
        level = params.centre + 0.01
        back = first_face(asset.mesh, (5.0, 0.001, level), (-1.0, 0, 0))
        assert np.allclose(asset.color[back], np.float32(params.back))
        front = first_face(asset.mesh, (-5.0, 0.001, level), (1.0, 0, 0))
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
