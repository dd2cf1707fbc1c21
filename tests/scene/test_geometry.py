"""A street as flat arrays."""

import numpy as np
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from scene import catalogue
from scene.asset import box, ellipsoid
from scene.attributes import default_unit, street_params
from scene.catalogue import AssetPool
from scene.classes import TrainId
from scene.geometry import SKY_INSTANCE, build, shape_of, world
from scene.materials import MATERIALS
from scene.street import Placement, sample_street

POOL = AssetPool(0, 4)
DEFAULT = street_params(default_unit())


def street(seed):
    return sample_street(DEFAULT, seed, 1, POOL)


@settings(max_examples=8)
@given(st.integers(0, 2**32 - 1))
def test_arrays_fit_together(seed):
    drawn = street(seed)
    g = build(drawn)
    n = len(g.faces)
    assert len(g.normal) == len(g.corners) == len(g.color) == len(g.material) == n
    assert (g.faces.min(), g.faces.max()) == (0, len(g.vertices) - 1)
    assert g.material.max() < len(MATERIALS)
    assert ((g.color >= 0) & (g.color <= 1)).all()
    assert np.isfinite(g.vertices).all()
    ids = {1, 2, 3} | {p.instance for p in drawn.placements}
    assert set(np.flatnonzero(g.count).tolist()) == ids
    assert (g.first + g.count <= n).all()
    assert g.triangles == g.count.sum() > n  # some assets stand there twice


def test_normals_are_unit_and_perpendicular_to_their_faces():
    g = build(street(1))
    a, b, c = (g.vertices[g.faces[:, k]] for k in range(3))
    assert np.abs(np.linalg.norm(g.normal, axis=1) - 1).max() < 1e-5
    for edge in (b - a, c - a):
        length = np.linalg.norm(edge, axis=1)
        leaning = np.abs((edge * g.normal).sum(axis=1)) / np.maximum(length, 1e-3)
        assert np.quantile(leaning, 0.999) < 0.02


def test_a_fine_ball_is_smoothed_and_a_box_keeps_its_edges():
    ball = shape_of(ellipsoid((0, 0, 0), (1, 1, 1), (0.5, 0.5, 0.5), subdivisions=2))
    outwards = ball.vertices[ball.faces]
    outwards /= np.linalg.norm(outwards, axis=2, keepdims=True)
    assert ((ball.corners * outwards).sum(axis=2) > 0.995).all()
    cube = shape_of(box((1, 2, 3), (0, 0, 0), (0.5, 0.5, 0.5)))
    np.testing.assert_allclose(cube.corners, np.repeat(cube.normal[:, None], 3, axis=1), atol=1e-6)


def test_a_surface_wound_both_ways_is_smoothed_all_the_same():
    ball = ellipsoid((0, 0, 0), (1, 1, 1), (0.5, 0.5, 0.5), subdivisions=2)
    faces = np.array(ball.mesh.faces)
    faces[::2] = faces[::2, ::-1]
    mesh = trimesh.Trimesh(ball.mesh.vertices, faces, process=False)
    mixed, straight = shape_of(ball._replace(mesh=mesh)), shape_of(ball)
    along = (mixed.corners * mixed.normal[:, None]).sum(axis=2)
    assert (along > 0.9).all()
    expected = (straight.corners * straight.normal[:, None]).sum(axis=2)
    expected[::2] = expected[::2, ::-1]
    np.testing.assert_allclose(along, expected, atol=1e-5)


def test_instances_know_their_classes():
    drawn = street(2)
    train_id = build(drawn).train_id
    assert train_id[SKY_INSTANCE] == TrainId.SKY
    assert train_id[1:4].tolist() == [TrainId.ROAD, TrainId.SIDEWALK, TrainId.TERRAIN]
    for p in drawn.placements:
        assert train_id[p.instance] == catalogue.FAMILIES[p.family].train_id


def test_an_asset_is_turned_and_moved_by_its_pose():
    pose = np.array([[0.0, -1, 0, 10], [1, 0, 0, 3], [0, 0, 1, 0.12], [0, 0, 0, 1]])
    drawn = street(0)._replace(placements=(Placement("car", 1, TrainId.CAR, 4, pose),))
    g = build(drawn)
    own = catalogue.asset("car", 1)
    merged = world(g)
    placed = merged.vertices.reshape(-1, 3, 3)[merged.instance == 4]
    x, y, z = np.moveaxis(own.mesh.vertices[own.mesh.faces], -1, 0)
    np.testing.assert_allclose(placed, np.stack([10 - y, 3 + x, 0.12 + z], axis=-1), atol=1e-5)


def test_merging_names_the_face_that_each_triangle_comes_from():
    g = build(street(4))
    merged = world(g)
    assert len(merged.face) == g.triangles
    for i in np.random.default_rng(0).integers(0, g.triangles, 50):
        pose = g.pose[merged.instance[i]].astype(float)
        own = g.vertices[g.faces[merged.face[i]]]
        expected = own @ pose[:, :3].T + pose[:, 3]
        np.testing.assert_allclose(merged.vertices[3 * i : 3 * i + 3], expected, atol=1e-3)


def test_building_twice_gives_the_same_bytes():
    assert all(
        a.tobytes() == b.tobytes() for a, b in zip(build(street(3)), build(street(3)), strict=True)
    )
