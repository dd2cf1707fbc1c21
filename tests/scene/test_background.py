"""The background: beyond all lines, closing the horizon, and never in the lines' way."""

import math

import numpy as np
import pytest
from hypothesis import given

from scene.attributes import street_params
from scene.street.background import BEHIND, LINES_END, VISTA_END, background
from tests.scene.conftest import DEFAULT, SEEDS, UNITS, street


def stands(seed, params=DEFAULT):
    return background(params, np.random.default_rng(seed))


@given(SEEDS, UNITS)
def test_it_lies_beyond_the_lines_and_is_pure_and_no_larger_than_a_street(seed, unit):
    for stand in stands(seed, street_params(unit)):
        assert stand.x >= LINES_END or abs(stand.y) >= BEHIND
        assert stand.x < VISTA_END + 60
        assert stand.family in ("building", "tree", "bush")
    assert stands(seed) == stands(seed) != stands(seed + 1)
    assert 40 < len(stands(seed)) < 160


def test_a_row_of_houses_looks_down_the_road_from_its_end():
    for seed in range(20):
        middle = [s for s in stands(seed) if abs(s.y) < 20 and s.yaw == -math.pi / 2]
        assert middle  # the front of a building is at its local -y


@pytest.mark.parametrize(("probability", "low", "high"), [(0.0, 0.0, 0.12), (1.0, 0.5, 0.9)])
def test_it_is_town_where_there_are_buildings_and_country_where_there_are_none(
    probability, low, high
):
    params = DEFAULT._replace(building_probability=probability)
    families = [s.family for seed in range(30) for s in stands(seed, params)]
    assert low <= families.count("building") / len(families) <= high
    assert families.count("tree") / len(families) > 0.1


@given(SEEDS)
def test_it_leaves_lines_cameras_and_ground_as_they_are(seed):
    drawn = street(seed=seed, shots=2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("scene.street.street.background", lambda params, rng: [])
        bare = street(seed=seed, shots=2)
    assert (bare.cameras, bare.ground) == (drawn.cameras, drawn.ground)
    kept = drawn.placements[: len(bare.placements)]
    assert [p[:4] for p in kept] == [p[:4] for p in bare.placements]
    assert len(drawn.placements) > len(bare.placements)
