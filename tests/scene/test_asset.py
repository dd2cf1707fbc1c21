"""Meshes as plain arrays, and the solids that trimesh makes, too."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from scene.look.materials import material_id
from scene.mesh.asset import merge, rotate
from scene.mesh.mesh import Mesh, cross, twice_areas
from scene.mesh.solids import box, ellipsoid, quads

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
SQUARE = np.array([(0, 0, 0), (2, 0, 0), (2, 3, 0), (0, 3, 0)], float)
number = st.floats(-3, 3)
vector = st.tuples(number, number, number)


def test_a_mesh_asks_trimesh_for_what_it_does_not_hold_and_its_copy_has_arrays_of_its_own():
    mesh = box((2, 3, 4), (0, 0, 0), RED).mesh
    assert mesh.bounds.tolist() == [[-1, -1.5, 0], [1, 1.5, 4]]
    assert mesh.area == pytest.approx(2 * (6 + 8 + 12))
    with pytest.raises(AttributeError, match="colour"):
        _ = mesh.colour
    mesh = Mesh(SQUARE.copy(), np.array([[0, 1, 2]]))
    mesh.copy().vertices[:] = 7
    assert (mesh.vertices == SQUARE).all()


def test_quads_are_what_merging_them_one_by_one_gives():
    both = quads(np.stack([SQUARE, SQUARE + 1]), [RED, BLUE], ["glass", "metal"])
    joined = merge(quads([SQUARE], [RED], ["glass"]), quads([SQUARE + 1], [BLUE], ["metal"]))
    assert both.mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]
    assert both.material.tolist() == [material_id(m) for m in ("glass", "glass", "metal", "metal")]
    assert both.color.tolist() == joined.color.tolist() == [[*RED]] * 2 + [[*BLUE]] * 2
    assert both.mesh.vertices.tobytes() == joined.mesh.vertices.tobytes()
    assert both.mesh.faces.tobytes() == joined.mesh.faces.tobytes()
    assert twice_areas(both.mesh.vertices, both.mesh.faces).tolist() == [6, 6, 6, 6]


@given(vector, vector)
def test_cross_products_are_those_of_numpy(a, b):
    for one in (np.array(a), np.array([a, b])):
        assert cross(one, np.array(b)).tolist() == np.cross(one, np.array(b)).tolist()


@pytest.mark.parametrize("subdivisions", [0, 1, 2])
def test_a_sphere_is_the_one_of_trimesh(subdivisions):
    ours = ellipsoid((0, 0, 0), (1, 1, 1), RED, subdivisions=subdivisions).mesh
    theirs = trimesh.creation.icosphere(subdivisions=subdivisions)
    assert (ours.faces == theirs.faces).all()
    assert ours.vertices == pytest.approx(theirs.vertices, abs=1e-15)


@given(number, vector.filter(lambda v: np.linalg.norm(v) > 0.1), vector)
def test_turning_is_that_of_trimesh(angle, axis, about):
    asset = box((1, 2, 3), (4, 5, 6), RED)
    matrix = trimesh.transformations.rotation_matrix(angle, axis, about)
    wanted = trimesh.transformations.transform_points(asset.mesh.vertices, matrix)
    assert rotate(asset, angle, axis, about).mesh.vertices == pytest.approx(wanted, abs=1e-12)
