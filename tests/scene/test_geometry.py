"""Meshes as arrays, solids compared with those of trimesh, and the geometry of a street."""

import pickle

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from scene.assets.families import FAMILIES
from scene.classes import TrainId
from scene.look.materials import MATERIAL_ID, MATERIALS, material_id
from scene.mesh.asset import merge, rotate
from scene.mesh.mesh import cross, twice_areas
from scene.mesh.solids import box, ellipsoid, quads
from scene.render.geometry import SKY_INSTANCE, asset_shape, build, shape_of, world
from scene.render.instances import CLOSE
from tests.scene.conftest import SEEDS, solid, street

BALL = ellipsoid((0, 0, 0), (1, 1, 1), (0.5, 0.5, 0.5), subdivisions=2)
RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
SQUARE = np.array([(0, 0, 0), (2, 0, 0), (2, 3, 0), (0, 3, 0)], float)
number = st.floats(-3, 3)
vector = st.tuples(number, number, number)


@settings(max_examples=8)
@given(SEEDS)
def test_arrays_fit_together_the_same_each_time(seed):
    sampled = street(seed=seed)
    g, repeated = build(sampled), build(sampled)
    for a, b in zip((g[3:7], *g.shapes), (repeated[3:7], *repeated.shapes), strict=True):
        assert [x.tobytes() for x in a[:4]] == [x.tobytes() for x in b[:4]]
    n = 4 + len(sampled.placements)
    assert len(g.shape) == len(g.surfaces) == len(g.pose) == len(g.train_id) == n
    stands = [g.shapes[k] for k in g.shape[1:]]
    assert g.triangles == sum(len(shape.faces) for shape in stands)
    assert len(set(g.assets)) == len(g.assets) == len(g.shapes) - 3
    for p in sampled.placements:
        assert g.assets[g.shape[p.instance] - 3][:2] == (p.family, p.asset)
        assert (g.assets[g.shape[p.instance] - 3][2] == "far") == p.far
        assert (g.pose[p.instance] == p.pose[:3].astype(np.float32)).all()
    assert (SKY_INSTANCE, g.train_id[0]) == (0, TrainId.SKY)
    assert g.train_id[1:4].tolist() == [TrainId.ROAD, TrainId.SIDEWALK, TrainId.TERRAIN]
    assert all(g.train_id[p.instance] == FAMILIES[p.family].train_id for p in sampled.placements)
    for shape, address in zip(stands, g.surfaces[1:].tolist(), strict=True):
        assert shape.surface.ctypes.data == address
        assert shape.surface.shape == (len(shape.faces), 16)
        assert (np.linalg.norm(shape.vertices - shape.ball[:3], axis=1) <= shape.ball[3]).all()
        assert 0 <= shape.faces.min() <= shape.faces.max() < len(shape.vertices)
        assert ((shape.color >= 0) & (shape.color <= 1)).all()
        assert shape.material.max() < len(MATERIALS) and np.isfinite(shape.vertices).all()


def test_a_pickled_street_has_addresses_of_its_own():
    first = build(street(seed=2))
    copy = pickle.loads(pickle.dumps(first))
    for one, other in zip(first.shapes, copy.shapes, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one[:4], other[:4], strict=True))
    for g in (first, copy):
        arrays = ("surface", "vertices", "faces")
        for k, row in zip(g.shape[1:], g.tables[1:], strict=True):
            shape = g.shapes[k]
            addresses = [getattr(shape, name).ctypes.data for name in arrays]
            assert [*addresses, len(shape.vertices), len(shape.faces)] == list(shape.table)
            assert list(shape.table) == row.tolist()
    assert not np.isin(copy.surfaces[1:], first.surfaces[1:]).any()
    assert np.array_equal(first.pose, copy.pose) and first.triangles == copy.triangles


def test_normals_are_unit_and_perpendicular_to_their_faces():
    for shape in build(street(seed=1)).shapes:
        a, b, c = (shape.vertices[shape.faces[:, k]] for k in range(3))
        flat = np.linalg.norm(np.cross(b - a, c - a), axis=1) < 1e-7
        assert np.abs(np.linalg.norm(shape.normal[~flat], axis=1) - 1).max() < 1e-3
        for edge in (b - a, c - a):
            length = np.linalg.norm(edge, axis=1)
            leaning = np.abs((edge * shape.normal).sum(axis=1)) / np.maximum(length, 1e-3)
            assert np.quantile(leaning, 0.99) < 0.02


def test_a_fine_ball_is_smoothed_however_its_faces_are_wound_and_a_box_keeps_its_edges():
    ball = shape_of(BALL)  # of radius 1
    assert ((ball.corners * ball.vertices[ball.faces]).sum(axis=2) > 0.995).all()
    cube = shape_of(box((1, 2, 3), (0, 0, 0), (0.5, 0.5, 0.5)))
    np.testing.assert_allclose(cube.corners, np.repeat(cube.normal[:, None], 3, axis=1), atol=1e-6)
    faces = np.array(BALL.mesh.faces)
    faces[::2] = faces[::2, ::-1]
    mesh = trimesh.Trimesh(BALL.mesh.vertices, faces, process=False)
    shapes = shape_of(BALL._replace(mesh=mesh)), shape_of(BALL)
    along, expected = ((shape.corners * shape.normal[:, None]).sum(axis=2) for shape in shapes)
    assert (along > 0.9).all()
    expected[::2] = expected[::2, ::-1]
    np.testing.assert_allclose(along, expected, atol=1e-5)


def test_merging_names_the_face_that_each_triangle_comes_from():
    g = build(street(seed=4))
    merged = world(g)
    assert len(merged.face) == g.triangles
    for i in np.random.default_rng(0).integers(0, g.triangles, 50):
        pose, shape = g.pose[merged.instance[i]], g.shapes[g.shape[merged.instance[i]]]
        expected = shape.vertices[shape.faces[merged.face[i]]] @ pose[:, :3].T + pose[:, 3]
        np.testing.assert_allclose(merged.vertices[3 * i : 3 * i + 3], expected, atol=1e-3)


def test_a_far_tree_covers_as_much_with_a_fraction_of_its_triangles():
    for index in range(8):
        near, far = asset_shape("tree", index), asset_shape("tree", index, "far")
        assert len(far.surface) == len(far.faces) < 0.5 * len(near.faces)
        one, other = (twice_areas(shape.vertices, shape.faces).sum() for shape in (far, near))
        assert one == pytest.approx(other, rel=0.15)
        low, high = near.vertices.min(axis=0), near.vertices.max(axis=0)
        outside = np.maximum(low - far.vertices, far.vertices - high).max(axis=1)
        assert np.quantile(outside, 0.99) < 0.5


def test_leaves_seen_from_near_are_small_and_cover_as_much_as_their_cards():
    for index in (1, 5):
        full, near = asset_shape("tree", index), asset_shape("tree", index, "near")
        leafy = [s.material == MATERIAL_ID["foliage"] for s in (full, near)]
        areas = [
            twice_areas(s.vertices, s.faces)[m] / 2
            for s, m in zip((full, near), leafy, strict=True)
        ]
        assert areas[1].sum() == pytest.approx(areas[0].sum(), rel=0.1)
        assert np.median(areas[1]) < 0.3 * np.median(areas[0])
        assert (~leafy[0]).sum() == (~leafy[1]).sum()
        assert np.linalg.norm(near.normal, axis=1) == pytest.approx(1, abs=1e-3)


def test_greenery_beside_a_camera_is_seen_from_near():
    sampled = street(seed=3, shots=4)
    g = build(sampled)
    eyes = np.array([e.position[:2] for c in sampled.cameras for e in (c, *c.further)])
    kinds = set()
    for p in sampled.placements:
        view = g.assets[g.shape[p.instance] - 3][2]
        least = np.hypot(*(eyes - p.pose[:2, 3]).T).min()
        green = p.train_id == TrainId.VEGETATION
        assert (view == "near") == (green and least < CLOSE)
        kinds.add(view)
    assert kinds == {"", "near", "far"}
    # A camera of the user's own may stand where no tree was to be near.
    far = next(p for p in sampled.placements if p.far and p.train_id == TrainId.VEGETATION)
    close = sampled.cameras[0]._replace(position=(*(far.pose[:2, 3] + 4), 1.5), further=())
    g = build(sampled._replace(cameras=(close,)))
    assert g.assets[g.shape[far.instance] - 3][2] == "near"


def test_quads_are_merged_ones_a_ball_is_trimesh_s_and_a_mesh_asks_for_what_it_does_not_hold():
    reference = trimesh.creation.icosphere(subdivisions=2)
    assert (BALL.mesh.faces == reference.faces).all()
    assert BALL.mesh.vertices == pytest.approx(reference.vertices, abs=1e-15)
    both = quads(np.stack([SQUARE, SQUARE + 1]), [RED, BLUE], ["glass", "metal"])
    joined = merge(quads([SQUARE], [RED], ["glass"]), quads([SQUARE + 1], [BLUE], ["metal"]))
    assert both.mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]
    assert both.material.tolist() == [material_id(m) for m in ("glass", "glass", "metal", "metal")]
    assert both.color.tolist() == joined.color.tolist() == [[*RED]] * 2 + [[*BLUE]] * 2
    assert both.mesh.vertices.tobytes() == joined.mesh.vertices.tobytes()
    assert both.mesh.faces.tobytes() == joined.mesh.faces.tobytes()
    assert twice_areas(both.mesh.vertices, both.mesh.faces).tolist() == [6, 6, 6, 6]
    mesh = box((2, 3, 4), (0, 0, 0), RED).mesh
    assert mesh.bounds.tolist() == [[-1, -1.5, 0], [1, 1.5, 4]]
    assert solid(mesh).area == pytest.approx(2 * (6 + 8 + 12))
    with pytest.raises(AttributeError, match="colour"):
        _ = mesh.colour


@given(vector.filter(lambda v: np.linalg.norm(v) > 0.1), vector, st.floats(0.001, 6))
def test_products_are_those_of_numpy_and_turning_is_that_of_trimesh(a, b, angle):
    for one in (np.array(a), np.array([a, b])):
        assert cross(one, np.array(b)).tolist() == np.cross(one, np.array(b)).tolist()
    asset = box((1, 2, 3), (4, 5, 6), RED)
    matrix = trimesh.transformations.rotation_matrix(angle, a, b)
    expected = trimesh.transformations.transform_points(asset.mesh.vertices, matrix)
    assert rotate(asset, angle, a, b).mesh.vertices == pytest.approx(expected, abs=1e-12)
