"""Intervals of attributes: what a file may say, and what is drawn from them."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene import proposal as module
from scene.attributes import BY_NAME, NAMES, default_unit
from scene.proposal import Proposal, default_proposal, describe, draw, random_proposal, slide
from tests.scene.conftest import SEEDS, refused

VALUES = dict.fromkeys(NAMES, 0.25)
BOTH = tuple(BY_NAME)
UNITS = st.floats(0, 1, width=32)
LIST = st.lists(UNITS, min_size=23, max_size=23)
SIZES = st.sampled_from([23, len(BOTH)])
LISTS = SIZES.flatmap(lambda n: st.tuples(*[st.lists(UNITS, min_size=n, max_size=n)] * 2))


@given(LIST, st.floats(0, 1), SEEDS)
def test_draws_stay_on_their_interval_and_below_one(centre, width, seed):
    proposal = slide(np.array(centre), width)
    units = draw(proposal, seed, 5)
    assert units.dtype == np.float32 and units.shape == (5, 23)
    assert (np.abs(units - proposal.centre) <= proposal.width / 2 + 1e-6).all()
    assert (units >= 0).all() and (units < 1).all()


def test_a_street_does_not_depend_on_how_many_there_are_and_all_fill_their_interval():
    many = draw(random_proposal(), 3, 9)
    np.testing.assert_array_equal(draw(random_proposal(), 3, 4), many[:4])
    assert len(np.unique(many)) == many.size
    assert not np.array_equal(draw(random_proposal(), 4, 9), many)
    units = draw(random_proposal(), 0, 2000)
    np.testing.assert_allclose(units.mean(axis=0), 0.5, atol=0.03)
    np.testing.assert_allclose(units.std(axis=0), 12**-0.5, atol=0.02)
    spread = draw(default_proposal(), 0, 2000) - slide(default_unit(), module.RELAXATION).centre
    np.testing.assert_allclose(spread.std(axis=0), module.RELAXATION * 12**-0.5, rtol=0.1)
    extended = default_proposal(space="extended")
    np.testing.assert_array_equal(extended.width > 0, [name in NAMES for name in BOTH])
    np.testing.assert_array_equal(draw(extended, 3, 4)[0, :23], draw(default_proposal(), 3, 4)[0])


def test_a_file_gives_values_or_intervals_and_a_description_says_where_they_lie_in_metres():
    short = {"centre": 0.5, "width": 0.2}
    long = {"unit": {"centre": 0.8, "width": 0.4}, "physical": {}, "meaning": "x"}
    proposal = module.parse_streets({**VALUES, NAMES[1]: short, NAMES[2]: long})
    np.testing.assert_allclose(proposal.centre[:4], [0.25, 0.5, 0.8, 0.25], rtol=1e-6)
    np.testing.assert_allclose(proposal.width[:4], [0, 0.2, 0.4, 0], rtol=1e-6)
    # At the border intervals slide inside.
    centre, width = slide(np.array([0.0, 0.5, 0.98]), np.array([0.2, 1.0, 0.1]))
    np.testing.assert_allclose(centre, [0.1, 0.5, 0.95], rtol=1e-6)
    np.testing.assert_allclose(width, [0.2, 1.0, 0.1], rtol=1e-6)
    attributes = describe(default_proposal(0.2))["components"][0]["attributes"]
    row = attributes["camera_position_y"]  # 0.8 to 4 m, by default 1.5
    assert row["unit"] == {"centre": 0.21875, "width": 0.2} and row["meaning"]
    assert row["physical"] == {"centre": 1.5, "low": 1.18, "high": 1.82, "unit": "m"}


@given(LISTS, SEEDS)
def test_what_is_described_is_read_back_to_the_same_streets(lists, seed):
    centre, width = lists
    assert module.shortest(np.float32(0.15)) == 0.15
    assert [np.float32(module.shortest(value)) for value in centre] == np.float32(centre).tolist()
    proposal = slide(np.array(centre), np.array(width))
    rough = Proposal(np.float32(centre), np.float32(width))  # sticks out of [0, 1]
    described = (json.loads(json.dumps(describe(p))) for p in (proposal, rough))
    again, other = map(module.parse_streets, described)
    assert [part.tobytes() for part in again] == [part.tobytes() for part in proposal]
    assert draw(other, seed, 2).tobytes() == draw(rough, seed, 2).tobytes()


@pytest.mark.parametrize(("value", "message"), [
    ([0.5] * 23, "expected a JSON object"),
    ({**VALUES, "car_postion": 0.5}, "unknown attribute 'car_postion'; known: illum"),
    ({NAMES[0]: 0.25, **dict.fromkeys(NAMES[1:14], 0.5)}, "attribute car_position is missing; all 23"),
    ({**VALUES, "bend": 0.5}, f"attribute field_of_view is missing; all {len(BOTH)}"),
    *(({**VALUES, "car_position": value}, f"car_position{message}") for value, message in (
        (1.5, r" is 1.5; .* \[0, 1\]"),
        *((value, f" is {value!r}") for value in (-0.1, np.nan, "0.5", True, None)),
        ({"width": 0.5}, ": expected a number, or centre"),
        ({"centre": 0.5, "width": 2}, " is 2"),
        ({"centre": 0.9, "width": 0.4}, r" has the interval \[0.7, 1.1\] \(centre 0.9, width 0.4\), which"),
        ({"unit": {"centre": 0.05, "width": 0.2}}, r" has the interval \[-0.05, 0.15\]"),
        ([{"centre": 0.5}], " is "), ({"unit": 3}, ": expected a number"),
    )),
])  # fmt: skip
def test_what_is_wrong_in_a_file_is_named(value, message):
    refused(ValueError, message, module.parse_streets, value)


WHOLE = {"share": 1, "attributes": VALUES}


@pytest.mark.parametrize(("rows", "message"), [
    ([], "components: expected a list"), ({}, "components: expected a list"),
    ([WHOLE, {"share": 1}], r"components\[1\]: expected an object of share and attributes"),
    ([{**WHOLE, "share": "all"}], r"components\[0\]: share is 'all'"),
    ([{**WHOLE, "attributes": {**VALUES, "car_position": 2}}], r"components\[0\]: .*car_position is 2"),
    ([{**WHOLE, "share": 0.5}], "add up to 1, not 0.5"),
    ([WHOLE, WHOLE], r"add up to 1, not 1 \+ 1"),
    ([{**WHOLE, "share": 2}, {**WHOLE, "share": -1}], "must be above 0"),
    ([{**WHOLE, "share": np.nan}], "must be above 0"),
    ([{**WHOLE, "share": 0.5}, {"share": 0.5, "attributes": dict.fromkeys(BOTH, 0.5)}], "different spaces"),
])  # fmt: skip
def test_what_is_wrong_in_a_mixture_is_named(rows, message):
    refused(ValueError, message, module.parse_streets, {"components": rows})


@given(st.lists(st.floats(0.01, 1), min_size=1, max_size=4), SEEDS)
def test_a_mixture_draws_each_component_its_share(weights, seed):
    shares = [w / sum(weights) for w in weights]
    parts = [slide(np.full(23, k / 10), 0.0) for k in range(len(shares))]
    streets = module.mixture(shares, parts)
    again = module.parse_streets(json.loads(json.dumps(describe(streets))))
    units = draw(streets, seed, 200)
    np.testing.assert_array_equal(draw(again, seed, 200), units)
    np.testing.assert_array_equal(draw(streets, seed, 7), units[:7])
    for part, share in zip(parts, shares, strict=True):
        assert np.isclose(units[:, 0], part.centre[0]).mean() == pytest.approx(share, abs=0.02)


def test_streets_by_name_and_half_of_either():
    by_eye = default_proposal(0.3, "extended")
    mixed = module.streets_named("mixed", "extended", 0.3)
    units = draw(mixed, 5, 8)
    near = (np.abs(units - by_eye.centre) <= by_eye.width / 2 + 1e-6).all(axis=1)
    assert near.sum() == 4 and mixed.shares == (0.5, 0.5)
    assert module.space_in(module.read_streets("mixed", "scenex")) == "scenex"
    np.testing.assert_array_equal(module.streets_named("default", "extended", 0.3), by_eye)
    complaint = "unknown streets 'half'; known: default, random, mixed"
    refused(ValueError, complaint, module.streets_named, "half", "scenex")


def test_components_that_are_equal_are_one():
    by_eye, other = default_proposal(), random_proposal()
    assert module.mixture((0.5, 0.5), (by_eye, by_eye)) is by_eye
    assert module.mixture((0.25, 0.5, 0.25), (by_eye, other, by_eye)).shares == (0.5, 0.5)
    np.testing.assert_array_equal(draw(module.mixture((1,), (other,)), 3, 2), draw(other, 3, 2))
