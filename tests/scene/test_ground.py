"""Road, sidewalk and terrain: where they lie and what is painted on them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene.classes import TrainId
from scene.ground import (
    GROUND_INSTANCES,
    KERB_HEIGHT,
    ROAD_HALF_WIDTH,
    SIDEWALK_WIDTH,
    ground_assets,
    ground_height,
    sample_ground,
)
from scene.materials import material_id

SEEDS = st.integers(0, 2**32 - 1)


def ground(seed):
    return sample_ground(np.random.default_rng(seed))


@pytest.mark.parametrize(("y", "height"), [(0, 0), (4.9, 0), (-4.9, 0), (5.5, 0.12), (-30, 0.12)])
def test_the_ground_is_flat_but_for_the_kerb(y, height):
    assert ground_height(y) == height


def test_the_three_surfaces_are_road_sidewalk_and_terrain():
    assert [TrainId(t).name for t in GROUND_INSTANCES.values()] == ["ROAD", "SIDEWALK", "TERRAIN"]
    assert set(ground_assets(ground(0))) == set(GROUND_INSTANCES)


@given(SEEDS)
def test_each_surface_keeps_to_its_strip(seed):
    road, sidewalk, terrain = ground_assets(ground(seed)).values()
    outer = ROAD_HALF_WIDTH + SIDEWALK_WIDTH
    reach = [np.abs(a.mesh.vertices[:, 1]) for a in (road, sidewalk, terrain)]
    assert reach[0].max() == ROAD_HALF_WIDTH
    assert reach[1].min() == pytest.approx(ROAD_HALF_WIDTH)
    assert reach[1].max() == outer
    assert reach[2].min() == outer
    assert road.mesh.vertices[:, 2].max() < 0.02  # paint
    assert terrain.mesh.vertices[:, 2] == pytest.approx(KERB_HEIGHT)


@given(SEEDS)
def test_markings_lie_on_the_asphalt_and_within_it(seed):
    road = ground_assets(ground(seed))[1]
    painted = road.mesh.vertices[
        np.unique(road.mesh.faces[road.material == material_id("marking")])
    ]
    asphalt = road.mesh.vertices[
        np.unique(road.mesh.faces[road.material == material_id("asphalt")])
    ]
    assert (asphalt[:, 2] == 0).all()
    assert (painted[:, 2] > 0).all()
    assert (np.abs(painted[:, 1]) < ROAD_HALF_WIDTH).all()


@given(SEEDS)
def test_dashes_keep_clear_of_crosswalks(seed):
    drawn = ground(seed)
    road = ground_assets(drawn)[1]
    centres = road.mesh.triangles_center[road.material == material_id("marking")]
    width = np.ptp(road.mesh.triangles[road.material == material_id("marking")][..., 1], axis=1)
    dashes = centres[np.isclose(width, 0.13)]
    for x in drawn.crosswalks:
        assert (np.abs(dashes[:, 0] - x) > 4).all()


def test_a_crosswalk_crosses_the_whole_road():
    with_one = next(g for g in map(ground, range(50)) if g.crosswalks)
    road = ground_assets(with_one)[1]
    marking = road.mesh.triangles[road.material == material_id("marking")]
    near = marking[np.abs(marking[..., 0] - with_one.crosswalks[0]).max(axis=1) < 1.6]
    assert near[..., 1].min() < -ROAD_HALF_WIDTH + 0.8
    assert near[..., 1].max() > ROAD_HALF_WIDTH - 0.9


def test_grounds_vary_and_are_pure():
    grounds = [ground(seed) for seed in range(30)]
    assert grounds == [ground(seed) for seed in range(30)]
    assert len({g.asphalt for g in grounds}) == 30
    assert {g.edge_lines for g in grounds} == {0, 1, 2}
    assert {g.terrain_material for g in grounds} == {"grass", "concrete"}
