"""A street as flat arrays."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings

from scene.assets import catalogue
from scene.classes import TrainId
from scene.look.materials import MATERIALS
from scene.mesh.solids import box, ellipsoid
from scene.render.geometry import SKY_INSTANCE, asset_shape, build, shape_of, world
from scene.street.placing import Placement
from tests.scene.conftest import SEEDS, street

BALL = ellipsoid((0, 0, 0), (1, 1, 1), (0.5, 0.5, 0.5), subdivisions=2)


@settings(max_examples=8)
@given(SEEDS)
def test_arrays_fit_together_the_same_each_time(seed):
    drawn = street(seed=seed)
    g, again = build(drawn), build(drawn)
    assert g.pose.tobytes() == again.pose.tobytes()
    assert g.train_id.tobytes() == again.train_id.tobytes()
    for a, b in zip(g.shapes, again.shapes, strict=True):
        assert [x.tobytes() for x in a[:4]] == [x.tobytes() for x in b[:4]]
    n = 4 + len(drawn.placements)
    assert len(g.shapes) + 1 == len(g.surfaces) == len(g.pose) == len(g.train_id) == n
    assert g.triangles == sum(len(shape.faces) for shape in g.shapes)
    for shape, address in zip(g.shapes, g.surfaces[1:].tolist(), strict=True):
        assert shape.surface.ctypes.data == address
        assert shape.surface.shape == (len(shape.faces), 16)
        assert (np.linalg.norm(shape.vertices - shape.ball[:3], axis=1) <= shape.ball[3]).all()
        assert 0 <= shape.faces.min() <= shape.faces.max() < len(shape.vertices)
        assert shape.material.max() < len(MATERIALS)
        assert ((shape.color >= 0) & (shape.color <= 1)).all()
        assert np.isfinite(shape.vertices).all()


def test_normals_are_unit_and_perpendicular_to_their_faces():
    for shape in build(street(seed=1)).shapes:
        a, b, c = (shape.vertices[shape.faces[:, k]] for k in range(3))
        flat = np.linalg.norm(np.cross(b - a, c - a), axis=1) < 1e-7
        assert np.abs(np.linalg.norm(shape.normal[~flat], axis=1) - 1).max() < 1e-3
        for edge in (b - a, c - a):
            length = np.linalg.norm(edge, axis=1)
            leaning = np.abs((edge * shape.normal).sum(axis=1)) / np.maximum(length, 1e-3)
            assert np.quantile(leaning, 0.99) < 0.02


def test_a_fine_ball_is_smoothed_and_a_box_keeps_its_edges():
    ball = shape_of(BALL)
    outwards = ball.vertices[ball.faces]
    outwards /= np.linalg.norm(outwards, axis=2, keepdims=True)
    assert ((ball.corners * outwards).sum(axis=2) > 0.995).all()
    cube = shape_of(box((1, 2, 3), (0, 0, 0), (0.5, 0.5, 0.5)))
    np.testing.assert_allclose(cube.corners, np.repeat(cube.normal[:, None], 3, axis=1), atol=1e-6)


def test_a_surface_wound_both_ways_is_smoothed_all_the_same():
    faces = np.array(BALL.mesh.faces)
    faces[::2] = faces[::2, ::-1]
    mesh = trimesh.Trimesh(BALL.mesh.vertices, faces, process=False)
    along, expected = (
        (shape.corners * shape.normal[:, None]).sum(axis=2)
        for shape in (shape_of(BALL._replace(mesh=mesh)), shape_of(BALL))
    )
    assert (along > 0.9).all()
    expected[::2] = expected[::2, ::-1]
    np.testing.assert_allclose(along, expected, atol=1e-5)


def test_instances_know_their_classes():
    drawn = street(seed=2)
    train_id = build(drawn).train_id
    assert train_id[SKY_INSTANCE] == TrainId.SKY
    assert train_id[1:4].tolist() == [TrainId.ROAD, TrainId.SIDEWALK, TrainId.TERRAIN]
    for p in drawn.placements:
        assert train_id[p.instance] == catalogue.FAMILIES[p.family].train_id


def test_an_asset_is_turned_and_moved_by_its_pose():
    pose = np.array([[0.0, -1, 0, 10], [1, 0, 0, 3], [0, 0, 1, 0.12], [0, 0, 0, 1]])
    g = build(street()._replace(placements=(Placement("car", 1, TrainId.CAR, 4, pose),)))
    merged = world(g)
    placed = merged.vertices.reshape(-1, 3, 3)[merged.instance == 4]
    x, y, z = np.moveaxis(catalogue.asset("car", 1).mesh.triangles, -1, 0)
    np.testing.assert_allclose(placed, np.stack([10 - y, 3 + x, 0.12 + z], axis=-1), atol=1e-5)


def test_merging_names_the_face_that_each_triangle_comes_from():
    g = build(street(seed=4))
    merged = world(g)
    assert len(merged.face) == g.triangles
    for i in np.random.default_rng(0).integers(0, g.triangles, 50):
        pose, shape = g.pose[merged.instance[i]], g.shapes[merged.instance[i] - 1]
        own = shape.vertices[shape.faces[merged.face[i]]]
        expected = own @ pose[:, :3].T + pose[:, 3]
        np.testing.assert_allclose(merged.vertices[3 * i : 3 * i + 3], expected, atol=1e-3)


def test_a_far_tree_covers_as_much_with_a_fraction_of_its_triangles():
    def area(shape):
        a, b, c = (shape.vertices[shape.faces[:, k]] for k in range(3))
        return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2

    for index in range(8):
        near, far = asset_shape("tree", index), asset_shape("tree", index, far=True)
        assert len(far.faces) < 0.5 * len(near.faces)
        assert area(far) == pytest.approx(area(near), rel=0.15)
        assert len(far.surface) == len(far.faces)
        low, high = near.vertices.min(axis=0), near.vertices.max(axis=0)
        outside = np.maximum(low - far.vertices, far.vertices - high).max(axis=1)
        assert np.quantile(outside, 0.99) < 0.5
