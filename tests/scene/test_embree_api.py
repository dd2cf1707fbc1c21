"""Embree through its C interface: meshes, instances, rays against answers worked out by hand."""

import gc

import numpy as np
import pytest

from scene.render import RendererError
from scene.render.embree import api
from scene.render.embree.api import MeshBVH, SceneBVH
from tests.scene.rays import free

WALL = np.array([[5, -1, 0], [5, 1, 0], [5, 1, 2], [5, -1, 2]], np.float32)
TWO = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
STILL = np.eye(3, 4, dtype=np.float32)


def moved(x=0.0, y=0.0, z=0.0):
    return STILL + np.array([[0, 0, 0, x], [0, 0, 0, y], [0, 0, 0, z]], np.float32)


@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (4, 2), (5, 3), (7, 1), (3, 8)])
def test_every_ray_of_every_size_of_image_gets_its_own_answer(columns, rows):
    # Of each three rays one goes ahead into the wall, one back into nothing, and one is not asked.
    kind = np.arange(columns * rows) % 3
    directions = np.where((kind == 1)[:, None], [1.0, 0, 0], [-1.0, 0, 0])
    bvh = SceneBVH([MeshBVH(WALL, TWO)], [3], STILL[None])
    starts = np.tile([0, 0, 0.5], (columns * rows, 1))
    found = free(bvh, starts, directions, kind != 2, columns)
    assert found.tolist() == np.choose(kind, [1, 0, -1]).tolist()


def test_rays_that_run_alike_share_one_direction():
    bvh = SceneBVH([MeshBVH(WALL, TWO)], [1], STILL[None])
    starts = [[0, 0, 1], [0, 0, 3], [0, 5, 1]]
    assert free(bvh, starts, [[1, 0, 0]], [1, 1, 1], 3).tolist() == [0, 1, 1]


def test_instances_stand_where_they_are_put():
    mesh_bvh = MeshBVH(WALL, TWO)
    bvh = SceneBVH([mesh_bvh, mesh_bvh], [1, 2], np.stack([moved(x=10), moved(y=7)]))
    starts = [[0, 0, 1], [0, 7, 1], [0, 3.5, 1]]
    ahead = [[1, 0, 0]]
    assert free(bvh, starts, ahead, [1, 1, 1], 3).tolist() == [0, 0, 1]
    assert free(bvh, starts, ahead, [1, 1, 1], 3, reach=8.0).tolist() == [1, 0, 1]


def test_rays_in_the_way_of_something_within_reach_are_not_free():
    bvh = SceneBVH([MeshBVH(WALL, TWO)], [1], STILL[None])
    starts = np.zeros((4, 3), np.float32) + [0, 0, 1]
    directions = np.array([[1, 0, 0], [-1, 0, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    wanted = [1, 1, 0, 1]
    assert free(bvh, starts, directions, wanted, 4).tolist() == [0, 1, -1, 1]
    assert free(bvh, starts, directions, wanted, 4, reach=4.0).tolist() == [1, 1, -1, 1]


def test_a_scene_outlives_the_names_of_its_meshes():
    def build():
        return SceneBVH([MeshBVH(WALL.copy(), TWO.copy())], [1], STILL[None])

    bvh = build()
    gc.collect()
    assert not free(bvh, [[0, 0, 0.5]] * 8, [[1, 0, 0]], [1] * 8, 4).any()


def test_a_wheel_without_the_library_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(api, "PATTERNS", ("nothing/*.so",))
    with pytest.raises(RendererError, match=r"no Embree 4 library lies beside embreex"):
        api._find()
