"""Embree through its C interface, and the depth buffer against rays cast one by one: without a gap."""

import gc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scene.mesh.solids import ellipsoid
from scene.render import RendererError, RenderSettings
from scene.render.embree import api, depth_buffer
from scene.render.geometry import Shape, shape_of, stand
from scene.render.shot import sample_rays
from scene.street.camera import Camera
from tests.scene.conftest import SEEDS, cast, free, refused

SIZE = RenderSettings(width=40, height=30, fov=70)
GREY = (0.5, 0.5, 0.5)
STILL = Camera((0.0, 0.0, 0.0), 0.0, 0.0)
WALL = np.array([[5, -1, 0], [5, 1, 0], [5, 1, 2], [5, -1, 2]], np.float32)
TWO = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
PLACE = np.eye(3, 4, dtype=np.float32)


def shape(corners):
    """A shape of loose triangles f32[n, 3, 3]."""
    n = len(corners)
    faces, surface = np.arange(3 * n, dtype=np.int32).reshape(n, 3), np.zeros((n, 16), np.float32)
    return Shape.of(np.asarray(corners, np.float32).reshape(-1, 3), faces, surface)


def draw(shapes, poses=None, camera=STILL):
    poses = np.eye(3, 4)[None].repeat(len(shapes), 0) if poses is None else poses
    pose = np.concatenate([np.zeros((1, 3, 4)), poses]).astype(np.float32)
    rays = sample_rays(camera, SIZE)
    geometry = stand(shapes, np.arange(-1, len(shapes)), pose, np.zeros(len(pose), np.uint8))
    return depth_buffer.nearest(geometry, camera, SIZE, rays), rays


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
    hit = clear & np.isfinite(best)
    np.testing.assert_allclose(hits.distance[hit], best[hit], rtol=2e-3, atol=1e-4)


def test_faces_that_share_an_edge_leave_no_gap():
    # From inside of a closed ball of many faces, every sample sees one of them.
    ball = shape_of(ellipsoid((0, 0, 0), (3, 3, 3), GREY, subdivisions=4))
    for yaw in np.linspace(-3, 3, 7):
        assert (draw([ball], camera=Camera((0.3, -0.2, 0.1), yaw, 0.4))[0].face >= 0).all()


def test_place_and_distance_are_those_of_the_point_that_is_seen():
    wall = shape([[[5, -9, -9], [5, 9, -9], [5, 9, 9]], [[5, -9, -9], [5, 9, 9], [5, -9, 9]]])
    pose = np.array([[[1, 0, 0, 2], [0, 1, 0, 0.5], [0, 0, 1, 0]]])
    hits, rays = draw([wall], pose)
    points = rays.origin + hits.distance[:, None] * rays.directions
    corners = wall.vertices[wall.faces[hits.face]] + pose[0, :, 3]
    weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], 1)
    np.testing.assert_allclose((weights[..., None] * corners).sum(1), points, atol=1e-4)
    np.testing.assert_allclose(points[:, 0], 7, atol=1e-4)


def test_what_is_hidden_is_left_out_and_nothing_else():
    places = np.random.default_rng(0).uniform((5, -9, -6), (30, 9, 6), (220, 3))
    shapes = [shape_of(ellipsoid(p, (0.8,) * 3, GREY)) for p in places]
    hits, alone = draw(shapes)[0], [draw([one])[0] for one in shapes]
    away = np.array([np.where(h.face >= 0, h.distance, np.inf) for h in alone])
    first = np.where(np.isinf(away.min(axis=0)), 0, 1 + away.argmin(axis=0))
    assert len(np.unique(first)) > 20 and (hits.instance == first).all()


def wall_ahead():
    return api.SceneBVH([api.MeshBVH(WALL.copy(), TWO.copy())], np.zeros(1), PLACE[None])


@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (4, 2), (5, 3), (7, 1), (3, 8)])
def test_every_ray_of_every_size_of_image_gets_its_own_answer(columns, rows):
    # Of each three rays one goes ahead into the wall, one back into nothing, and one is not asked.
    kind = np.arange(columns * rows) % 3
    directions = np.where((kind == 1)[:, None], [1.0, 0, 0], [-1.0, 0, 0])
    starts = np.tile([0, 0, 0.5], (columns * rows, 1))
    unblocked = free(wall_ahead(), starts, directions, kind != 2, columns)
    assert unblocked.tolist() == np.choose(kind, [1, 0, -1]).tolist()


def test_instances_stand_where_they_are_put_and_outlive_the_names_of_their_meshes():
    mesh_bvh, poses = api.MeshBVH(WALL, TWO), np.stack([PLACE, PLACE])
    poses[0, 0, 3], poses[1, 1, 3] = 10, 7
    bvh = api.SceneBVH([mesh_bvh], np.zeros(2), poses)
    rays = [[0, 0, 1], [0, 7, 1], [0, 3.5, 1]], [[1, 0, 0]]  # one direction for all
    assert free(bvh, *rays, [1, 1, 1], 3).tolist() == [0, 0, 1]
    assert free(bvh, *rays, [1, 1, 1], 3, reach=8.0).tolist() == [1, 0, 1]
    bvh = wall_ahead()
    gc.collect()
    assert not free(bvh, [[0, 0, 0.5]] * 8, [[1, 0, 0]], [1] * 8, 4).any()


def test_a_wheel_without_the_library_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(api, "PATTERNS", ("nothing/*.so",))
    refused(RendererError, r"has no Embree 4 library", api._find)
