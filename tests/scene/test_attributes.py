"""The table of attributes: frozen ranges, and unit values to metres and radians and back."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene import StreetParams, default_unit, street_params
from scene.attributes import ATTRIBUTES, BY_NAME, NAMES, SPACES, check_unit, names, space_of
from tests.scene.conftest import refused

# name: (unit 0, unit 1, scale, default). A wider range would inflate every gain over random
# attributes, so a change here changes the benchmark.
FROZEN = {
    "illumination_intensity": (0.3, 1.7, "linear", 0.9),"illumination_angle_x": (8, 80, "linear", 35),
    "illumination_angle_y": (-180, 180, "linear", 60),  "camera_position_probability": (0, 1, "linear", 0.1),
    "camera_position_x": (0, 8, "linear", 1.8),         "camera_position_y": (0.8, 4.0, "linear", 1.5),
    "camera_rotation_x": (-12, 20, "linear", 2),        "camera_rotation_y": (-40, 40, "linear", 0),
    "building_position": (5, 30, "linear", 9),          "fence_position": (3.5, 20, "linear", 7.5),
    "tree_position": (3.5, 20, "linear", 9),            "bicycle_position": (1, 14, "linear", 6.3),
    "person_position": (1, 14, "linear", 5.5),          "pole_position": (2, 14, "linear", 4.8),
    "car_position": (1, 14, "linear", 3.4),             "building_probability": (0, 1, "linear", 0.8),
    "building_interval": (8, 40, "log", 10),            "fence_interval": (3, 40, "log", 12),
    "tree_interval": (3, 40, "log", 14),                "bicycle_interval": (3, 40, "log", 18),
    "person_interval": (1.5, 40, "log", 8),             "pole_interval": (5, 50, "log", 16),
    "car_interval": (5, 50, "log", 25),
}  # fmt: skip
ATTRIBUTE = st.sampled_from(SPACES["extended"])
UNIT = st.floats(0, 1)


def test_ranges_scales_and_defaults_are_the_frozen_ones():
    table = {a.name: (a.low, a.high, a.scale, a.default) for a in ATTRIBUTES}
    assert table == FROZEN
    # In the order of every attribute vector: 8 of the environment, 7 positions, 8 densities.
    assert tuple(FROZEN) == tuple(table) == NAMES == StreetParams._fields[:23]
    assert names("extended") == tuple(BY_NAME) == StreetParams._fields
    assert all(a.unit and a.meaning for a in BY_NAME.values())
    assert [space_of(n) for n in (23, len(BY_NAME))] == list(SPACES)
    # The middle of a linear range is the mean, of a logarithmic one the geometric mean.
    assert BY_NAME["camera_position_y"].physical(0.5) == pytest.approx(2.4)
    assert BY_NAME["car_interval"].physical(0.5) == pytest.approx(math.sqrt(5 * 50))


@given(ATTRIBUTE, UNIT, UNIT)
def test_physical_values_grow_with_the_unit_stay_in_range_and_tell_it(attribute, a, b):
    low, high = attribute.physical(min(a, b)), attribute.physical(max(a, b))
    assert sorted([a, b]) == pytest.approx([*map(attribute.to_unit, (low, high))], abs=1e-9)
    assert attribute.low - 1e-9 <= low <= high <= attribute.high + 1e-9


def test_the_default_street_has_the_default_values_and_angles_in_radians():
    params = street_params(default_unit())
    extended = street_params(default_unit("extended"))
    assert extended[:23] == params[:23]
    for attribute, value in zip(BY_NAME.values(), extended, strict=True):
        expected = math.radians(attribute.default) if attribute.unit == "deg" else attribute.default
        assert value == pytest.approx(expected, abs=1e-4), attribute.name
    assert street_params(np.ones(23)).camera_rotation_x == pytest.approx(math.radians(20))
    assert street_params(np.zeros(23)).illumination_angle_y == pytest.approx(-math.pi)
    for shape in ((), (22,), (24,), (37,), (23, 2), (0,)):
        refused(ValueError, r"must have 23 \(scenex\) or 40", check_unit, np.zeros(shape))


@given(st.sampled_from(NAMES), st.sampled_from([-0.1, 1.001, math.nan, math.inf, -math.inf]))
def test_a_value_outside_the_unit_interval_is_refused_by_name(name, value):
    unit = default_unit()
    unit[NAMES.index(name)] = value
    refused(ValueError, rf"{name} is .*\[0, 1\]", street_params, unit)
    assert check_unit(np.full((5, 23), 0.5)).shape == (5, 23)  # many streets at once
    refused(ValueError, f"{name} is ", check_unit, np.stack([default_unit(), unit]))
