"""A street as flat arrays."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from scene import catalogue
from scene.attributes import default_unit, street_params
from scene.catalogue import AssetPool
from scene.classes import TrainId
from scene.geometry import SKY_INSTANCE, build
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
    assert len(g.normal) == len(g.color) == len(g.material) == len(g.instance) == n
    assert (g.faces.min(), g.faces.max()) == (0, len(g.vertices) - 1)
    assert g.material.max() < len(MATERIALS)
    assert ((g.color >= 0) & (g.color <= 1)).all()
    assert np.isfinite(g.vertices).all()
    assert set(g.instance.tolist()) == {1, 2, 3} | {p.instance for p in drawn.placements}
    dtypes = [a.dtype for a in g]
    assert dtypes == [np.float32, np.int32, np.float32, np.float32, np.uint8, np.uint16, np.uint8]


def test_normals_are_unit_and_perpendicular_to_their_faces():
    g = build(street(1))
    a, b, c = (g.vertices[g.faces[:, k]] for k in range(3))
    assert np.abs(np.linalg.norm(g.normal, axis=1) - 1).max() < 1e-5
    for edge in (b - a, c - a):
        length = np.linalg.norm(edge, axis=1)
        leaning = np.abs((edge * g.normal).sum(axis=1)) / np.maximum(length, 1e-3)
        assert np.quantile(leaning, 0.999) < 0.02


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
    placed = g.vertices[np.unique(g.faces[g.instance == 4])]
    x, y, z = own.mesh.vertices[np.unique(own.mesh.faces)].T
    np.testing.assert_allclose(placed, np.column_stack([10 - y, 3 + x, 0.12 + z]), atol=1e-5)


def test_building_twice_gives_the_same_bytes():
    assert all(
        a.tobytes() == b.tobytes() for a, b in zip(build(street(3)), build(street(3)), strict=True)
    )
