"""Fixed attributes: valid values, and their effect on every street."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import UserError
from scene.attributes import BY_NAME, SPACES, names, street_params
from scene.held import hold, in_words, read_fixed
from scene.proposal import Histogram, describe, draw, mixture, parse_streets, streets_named
from tests.scene.conftest import SEEDS, refused

WORDS = ("field_of_view=90", "camera_position_y=1.4")


@pytest.mark.parametrize(("words", "space", "message"), [
    (["field_of_vew=90"], "extended", "--fix field_of_vew=90: there is no attribute 'field_of_vew'; did you "
     "mean field_of_view"),
    (["zzz=1"], "scenex", "no attribute 'zzz'; known: illumination_intensity, .*car_interval$"),
    (["field_of_view=90"], "scenex", "space scenex has no attribute field_of_view; space extended does"),
    (["field_of_view=200"], "extended", r"field_of_view must be a number from 30 to 110 \(deg\), not '200'"),
    (["camera_position_y=0.7"], "scenex", r"must be a number from 0.8 to 4 \(m\)"),
    (["camera_position_y=nan"], "scenex", "must be a number from"),
    (["camera_position_y=high"], "scenex", "must be a number from"),
    (["camera_position_y"], "scenex", "must be a number from"),
    (["camera_position_y=1", "camera_position_y=2"], "scenex", "camera_position_y is already fixed"),
])  # fmt: skip
def test_what_cannot_be_held_is_refused_with_what_can(words, space, message):
    assert "\n" not in str(refused(UserError, message, read_fixed, words, space))


@given(SEEDS, st.sampled_from(["random", "default", "mixed", "bins"]), st.data())
def test_what_is_held_stands_in_every_street_and_all_else_is_as_it_was(seed, name, data):
    even = Histogram(np.full((len(BY_NAME), 3), 1 / 3, np.float32))
    streets = mixture((0.4, 0.6), (even, streets_named("random", "extended")))
    if name != "bins":
        streets = streets_named(name, "extended")
    attribute = data.draw(st.sampled_from(SPACES["extended"]))
    value = data.draw(st.floats(attribute.low, attribute.high))
    fixed = read_fixed([f"{attribute.name}={value!r}"], "extended")
    where, fixed_streets = names("extended").index(attribute.name), hold(streets, fixed)
    free, units = draw(streets, seed, 6), draw(fixed_streets, seed, 6)
    np.testing.assert_array_equal(np.delete(units, where, 1), np.delete(free, where, 1))
    size = attribute.high - attribute.low
    assert [attribute.physical(unit) for unit in units[:, where].tolist()] == pytest.approx(
        [value] * 6, abs=1e-5 * size
    )
    parsed = parse_streets(describe(fixed_streets))  # as attributes.json has it
    np.testing.assert_array_equal(draw(parsed, seed, 6), units)
    other = next(a.name for a in SPACES["extended"] if a.name != attribute.name)
    more = draw(hold(fixed_streets, {other: 0.25}), seed, 6)  # what was held stays so
    np.testing.assert_array_equal(more[:, where], units[:, where])


def test_the_camera_is_where_it_is_held():
    fixed = read_fixed(WORDS, "extended")
    assert list(fixed) == ["camera_position_y", "field_of_view"]  # in the order of the space
    params = street_params(draw(hold(streets_named("random", "extended"), fixed), 0, 1)[0])
    assert np.degrees(params.field_of_view) == pytest.approx(90)
    assert params.camera_position_y == pytest.approx(1.4)
    assert in_words(fixed) == "camera_position_y 1.4 m, field_of_view 90 deg"
    assert in_words({}) == "" and hold(params, {}) is params
