"""Embree through its C interface: trees, instances, rays against answers worked out by hand."""

import gc

import numpy as np
import pytest

from scene.render import RendererError, embree_api
from scene.render.embree import _cast, _probe
from scene.render.embree_api import Forest, Tree, query_arguments

WALL = np.array([[5, -1, 0], [5, 1, 0], [5, 1, 2], [5, -1, 2]], np.float32)
TWO = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
STILL = np.eye(3, 4, dtype=np.float32)


def moved(x=0.0, y=0.0, z=0.0):
    return STILL + np.array([[0, 0, 0, x], [0, 0, 0, y], [0, 0, 0, z]], np.float32)


def cast(forest, origin, directions, columns, rows):
    n = columns * rows
    face, instance = np.empty(n, np.int32), np.empty(n, np.int32)
    distance, u, v = (np.empty(n, np.float32) for _ in range(3))
    _cast(
        forest.scene, query_arguments(coherent=True), np.asarray(origin, np.float32),
        np.asarray(directions, np.float32), columns, rows,
        face, instance, distance, u, v,
    )  # fmt: skip
    return face, instance, distance, u, v


@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (4, 2), (5, 3), (7, 1), (3, 8)])
def test_every_ray_of_every_size_of_image_gets_its_own_answer(columns, rows):
    # Rays with an odd number go ahead, into the wall; the others back, into nothing.
    n = columns * rows
    ahead = np.arange(n) % 2 == 1
    directions = np.where(ahead[:, None], [1.0, 0, 0], [-1.0, 0, 0])
    forest = Forest([Tree(WALL, TWO)], [3], STILL[None])
    face, instance, distance, _, _ = cast(forest, (0, 0, 0.5), directions, columns, rows)
    assert (face >= 0)[ahead].all()
    assert (face[~ahead] == -1).all()
    assert (instance == np.where(ahead, 3, 0)).all()
    np.testing.assert_allclose(distance, np.where(ahead, 5, 0), atol=1e-5)


def test_the_nearest_instance_is_found_with_its_face_and_place():
    tree = Tree(WALL, TWO)
    forest = Forest([tree, tree], [1, 2], np.stack([moved(x=10), moved(x=2, y=0.5)]))
    # Through the lower right triangle: corners (7, -0.5, 0), (7, 1.5, 0), (7, 1.5, 2).
    face, instance, distance, u, v = cast(forest, (0, 1, 0.5), [[1, 0, 0]], 1, 1)
    assert (face[0], instance[0]) == (0, 2)
    assert distance[0] == pytest.approx(7)
    corners = WALL[TWO[0]] + [2, 0.5, 0]
    place = (1 - u[0] - v[0]) * corners[0] + u[0] * corners[1] + v[0] * corners[2]
    assert place == pytest.approx([7, 1, 0.5], abs=1e-5)


def test_rays_in_the_way_of_something_within_reach_are_not_free():
    forest = Forest([Tree(WALL, TWO)], [1], STILL[None])
    starts = np.zeros((4, 3), np.float32) + [0, 0, 1]
    directions = np.array([[1, 0, 0], [-1, 0, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    wanted = np.array([1, 1, 0, 1], np.uint8)

    def free(reach):
        out = np.empty(4, np.float32)
        arguments = query_arguments(coherent=False)
        _probe(
            forest.scene, arguments, starts.astype(np.float32), directions, wanted, 4, 1,
            np.float32(reach), out,
        )  # fmt: skip
        return out.tolist()

    assert free(np.inf) == [0, 1, 0, 1]
    assert free(4.0) == [1, 1, 0, 1]


def test_a_forest_outlives_the_names_of_its_trees():
    def plant():
        return Forest([Tree(WALL.copy(), TWO.copy())], [1], STILL[None])

    forest = plant()
    gc.collect()
    face, *_ = cast(forest, (0, 0, 0.5), [[1, 0, 0]] * 8, 4, 2)
    assert (face >= 0).all()


def test_a_wheel_without_the_library_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(embree_api, "PATTERNS", ("nothing/*.so",))
    with pytest.raises(RendererError, match=r"no Embree 4 library lies beside embreex"):
        embree_api._find()
