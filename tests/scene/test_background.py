"""The background: beyond all lines, closing the horizon, and never in the lines' way."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene.assets.catalogue import AssetPool
from scene.attributes import default_unit, street_params
from scene.street.background import BEHIND, LINES_END, VISTA_END, background
from scene.street.street import sample_street

SEEDS = st.integers(0, 2**32 - 1)
UNITS = st.integers(0, 2**32 - 1).map(lambda seed: np.random.default_rng(seed).random(23))
DEFAULT = street_params(default_unit())


def stands(seed, params=DEFAULT):
    return background(params, np.random.default_rng(seed))


@given(SEEDS, UNITS)
def test_it_lies_beyond_the_lines(seed, unit):
    for stand in stands(seed, street_params(unit)):
        assert stand.x >= LINES_END or abs(stand.y) >= BEHIND
        assert stand.x < VISTA_END + 60
        assert stand.family in ("building", "tree", "bush")


@given(SEEDS)
def test_it_is_pure_and_no_larger_than_a_street(seed):
    assert stands(seed) == stands(seed) != stands(seed + 1)
    assert 40 < len(stands(seed)) < 160


def test_a_row_of_houses_looks_down_the_road_from_its_end():
    for seed in range(20):
        middle = [s for s in stands(seed) if abs(s.y) < 20 and s.yaw == -math.pi / 2]
        assert middle
        # The front of a building is at its local -y.
        assert -math.sin(-middle[0].yaw) == pytest.approx(-1)


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
    pool = AssetPool(0, 4)
    street = sample_street(DEFAULT, seed, 2, pool)
    without = pytest.MonkeyPatch()
    with without.context() as patch:
        patch.setattr("scene.street.street.background", lambda params, rng: [])
        bare = sample_street(DEFAULT, seed, 2, pool)
    assert (bare.cameras, bare.ground) == (street.cameras, street.ground)
    kept = street.placements[: len(bare.placements)]
    assert [p[:4] for p in kept] == [p[:4] for p in bare.placements]
    assert len(street.placements) > len(bare.placements)
