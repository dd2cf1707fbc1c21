"""The depth buffer against rays cast one by one, and against what must never happen: a gap."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scene.mesh.solids import box, ellipsoid
from scene.render import RenderSettings
from scene.render.embree.depth_buffer import nearest
from scene.render.geometry import Shape, shape_of, stand
from scene.render.shot import sample_rays
from scene.street.camera import Camera
from tests.scene.conftest import SEEDS, cast

SIZE = RenderSettings(width=40, height=30, fov=70)
GREY = (0.5, 0.5, 0.5)
STILL = Camera((0.0, 0.0, 0.0), 0.0, 0.0)


def shape(corners):
    """A shape of loose triangles f32[n, 3, 3]."""
    n = len(corners)
    faces, surface = np.arange(3 * n, dtype=np.int32).reshape(n, 3), np.zeros((n, 16), np.float32)
    return Shape.of(np.asarray(corners, np.float32).reshape(-1, 3), faces, surface)


def draw(shapes, poses=None, camera=STILL):
    poses = np.eye(3, 4)[None].repeat(len(shapes), 0) if poses is None else poses
    pose = np.concatenate([np.zeros((1, 3, 4)), poses]).astype(np.float32)
    rays = sample_rays(camera, SIZE)
    geometry = stand(shapes, pose, np.zeros(len(pose), np.uint8))
    return nearest(geometry, camera, SIZE, rays), rays


@settings(max_examples=60)
@given(
    seed=SEEDS, count=st.integers(1, 12), spread=st.floats(0.5, 30), size=st.floats(0.05, 20),
    yaw=st.floats(-3.1, 3.1), pitch=st.floats(-1.2, 1.2),
)  # fmt: skip
def test_it_finds_what_rays_find(seed, count, spread, size, yaw, pitch):
    # Triangles anywhere: beside, behind and through the camera's plane, and larger than the view.
    rng = np.random.default_rng(seed)
    corners = rng.normal(0, spread, (count, 1, 3)) + rng.normal(0, size, (count, 3, 3))
    camera = Camera(tuple(rng.normal(0, 2, 3)), yaw, pitch)
    hits, rays = draw([shape(corners)], camera=camera)
    origin, directions = rays.origin.astype(float), rays.directions.astype(float)
    distances, edges = cast(origin, directions, corners.astype(np.float32))
    clear = ~edges.any(axis=1)  # rays along an edge may go either way
    best = distances.min(axis=1)
    assert ((hits.face >= 0) == np.isfinite(best))[clear].all()
    seen = clear & np.isfinite(best)
    np.testing.assert_allclose(hits.distance[seen], best[seen], rtol=2e-3, atol=1e-4)


def test_faces_that_share_an_edge_leave_no_gap():
    # From inside of a closed ball of many faces, every sample sees one of them.
    ball = shape_of(ellipsoid((0, 0, 0), (3, 3, 3), GREY, subdivisions=4))
    for yaw in np.linspace(-3, 3, 7):
        hits, _ = draw([ball], camera=Camera((0.3, -0.2, 0.1), yaw, 0.4))
        assert (hits.face >= 0).all()


def test_place_and_distance_are_those_of_the_point_that_is_seen():
    wall = shape([[[5, -9, -9], [5, 9, -9], [5, 9, 9]], [[5, -9, -9], [5, 9, 9], [5, -9, 9]]])
    pose = np.array([[[1, 0, 0, 2], [0, 1, 0, 0.5], [0, 0, 1, 0]]])
    hits, rays = draw([wall], pose)
    points = rays.origin + hits.distance[:, None] * rays.directions
    corners = wall.vertices[wall.faces[hits.face]] + pose[0, :, 3]
    weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], 1)
    np.testing.assert_allclose((weights[..., None] * corners).sum(1), points, atol=1e-4)
    np.testing.assert_allclose(points[:, 0], 7, atol=1e-4)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_nearer_of_two_wins_whichever_is_drawn_first(order):
    walls = [shape_of(box((0.1, 50, 50), (x, 0, -25), GREY)) for x in (4, 9)]
    hits, _ = draw([walls[k] for k in order])
    assert (hits.instance == 1 + order.index(0)).all()


def test_what_lies_behind_is_not_seen_and_a_floor_under_the_camera_is_up_to_the_horizon():
    behind = shape_of(box((1, 50, 50), (-4, 0, -25), GREY))
    floor = shape([[[-900, -900, -1], [900, -900, -1], [0, 1800, -1]]])
    hits, rays = draw([behind, floor])
    rise = rays.directions[:, 2]
    down = rise < -2e-3
    assert (hits.instance[down] == 2).all() and (hits.instance[rise >= 0] == 0).all()
    np.testing.assert_allclose(hits.distance[down], -1 / rise[down], rtol=1e-3)
