"""Embree through its C interface: meshes, instances, rays against answers worked out by hand."""

import gc

import numpy as np
import pytest

from scene.render import RendererError
from scene.render.embree import api
from scene.render.embree.api import MeshBVH, SceneBVH
from tests.scene.conftest import free

WALL = np.array([[5, -1, 0], [5, 1, 0], [5, 1, 2], [5, -1, 2]], np.float32)
TWO = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
STILL = np.eye(3, 4, dtype=np.float32)


def wall():
    return SceneBVH([MeshBVH(WALL.copy(), TWO.copy())], [1], STILL[None])


@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (4, 2), (5, 3), (7, 1), (3, 8)])
def test_every_ray_of_every_size_of_image_gets_its_own_answer(columns, rows):
    # Of each three rays one goes ahead into the wall, one back into nothing, and one is not asked.
    kind = np.arange(columns * rows) % 3
    directions = np.where((kind == 1)[:, None], [1.0, 0, 0], [-1.0, 0, 0])
    starts = np.tile([0, 0, 0.5], (columns * rows, 1))
    found = free(wall(), starts, directions, kind != 2, columns)
    assert found.tolist() == np.choose(kind, [1, 0, -1]).tolist()


def test_instances_stand_where_they_are_put():
    mesh_bvh, poses = MeshBVH(WALL, TWO), np.stack([STILL, STILL])
    poses[0, 0, 3], poses[1, 1, 3] = 10, 7
    bvh = SceneBVH([mesh_bvh, mesh_bvh], [1, 2], poses)
    starts = [[0, 0, 1], [0, 7, 1], [0, 3.5, 1]]
    ahead = [[1, 0, 0]]  # one direction for all
    assert free(bvh, starts, ahead, [1, 1, 1], 3).tolist() == [0, 0, 1]
    assert free(bvh, starts, ahead, [1, 1, 1], 3, reach=8.0).tolist() == [1, 0, 1]


def test_rays_in_the_way_of_something_within_reach_are_not_free():
    starts, directions = [[0, 0, 1]] * 4, [[1, 0, 0], [-1, 0, 0], [1, 0, 0], [0, 0, 1]]
    wanted = [1, 1, 0, 1]
    assert free(wall(), starts, directions, wanted, 4).tolist() == [0, 1, -1, 1]
    assert free(wall(), starts, directions, wanted, 4, reach=4.0).tolist() == [1, 1, -1, 1]


def test_a_scene_outlives_the_names_of_its_meshes():
    bvh = wall()
    gc.collect()
    assert not free(bvh, [[0, 0, 0.5]] * 8, [[1, 0, 0]], [1] * 8, 4).any()


def test_a_wheel_without_the_library_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(api, "PATTERNS", ("nothing/*.so",))
    with pytest.raises(RendererError, match=r"no Embree 4 library lies beside embreex"):
        api._find()
