"""Distributions of attributes: valid files, and draws."""

import json

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sdr_jax
from common.errors import UserError
from scene import proposal as module
from scene.attributes import BY_NAME, LATER, NAMES, default_unit
from scene.proposal import (
    Histogram,
    Proposal,
    default_proposal,
    describe,
    draw,
    moments,
    random_proposal,
    slide,
)
from sdr_jax import distributions
from tests.scene.conftest import SEEDS, refused

VALUES = dict.fromkeys(NAMES, 0.25)
BOTH = tuple(BY_NAME)
UNITS = st.floats(0, 1, width=32)
LIST = st.lists(UNITS, min_size=23, max_size=23)
SIZES = st.sampled_from([23, len(BOTH)])
ROWS = st.tuples(SIZES, st.integers(2, 12)).flatmap(
    lambda size: st.lists(
        st.lists(st.just(0.0) | st.floats(0.001, 1), min_size=size[1], max_size=size[1]).filter(
            any
        ),
        min_size=size[0],
        max_size=size[0],
    )
)
"""Weights of bins, some of them 0."""
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


def test_streets_from_a_later_one_on_are_those_of_the_whole_dataset():
    mixed = module.streets_named("mixed", "scenex", 0.2)
    for streets in (random_proposal(), mixed, histogram(np.ones((23, 4)))):
        dataset = draw(streets, 3, 9)
        assert len(np.unique(dataset, axis=0)) == 9
        for start, count in ((0, 9), (1, 8), (5, 3), (8, 1)):
            np.testing.assert_array_equal(draw(streets, 3, count, start), dataset[start:][:count])


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


OLD = tuple(name for name in BOTH if name not in {row.name for row in LATER})
AGED = {
    "one": dict.fromkeys(OLD, 0.25),
    "mixture": {
        "components": [
            {"share": 0.5, "attributes": dict.fromkeys(OLD, value)} for value in (0.25, 0.75)
        ]
    },
    "binned": {name: {"probabilities": [0.5, 0.5]} for name in OLD},
    "named": {"space": "extended", **dict.fromkeys(OLD, 0.25)},
}


@pytest.mark.parametrize("kind", AGED)
def test_a_file_older_than_some_attributes_has_their_defaults_and_one_line_says_so(
    kind, tmp_path, caplog
):
    path = tmp_path / "attributes.json"
    path.write_text(json.dumps(AGED[kind]))
    units = draw(module.streets_in(path), 0, 6)
    np.testing.assert_array_equal(units[:, -3:], [default_unit("extended")[-3:]] * 6)
    (line,) = caplog.messages
    assert line == f"{path}: no {', '.join(row.name for row in LATER)}; using their defaults"
    caplog.clear()
    for value in (VALUES, {"space": "scenex", **VALUES}, dict.fromkeys(BOTH, 0.25)):
        path.write_text(json.dumps(value))
        module.streets_in(path)
    assert not caplog.messages


@given(LISTS, SEEDS)
def test_what_is_described_is_read_back_to_the_same_streets(lists, seed):
    centre, width = lists
    assert module.shortest(np.float32(0.15)) == 0.15
    assert [np.float32(module.shortest(value)) for value in centre] == np.float32(centre).tolist()
    proposal = slide(np.array(centre), np.array(width))
    rough = Proposal(np.float32(centre), np.float32(width))  # sticks out of [0, 1]
    described = (json.loads(json.dumps(describe(p))) for p in (proposal, rough))
    parsed, other = map(module.parse_streets, described)
    assert [part.tobytes() for part in parsed] == [part.tobytes() for part in proposal]
    assert draw(other, seed, 2).tobytes() == draw(rough, seed, 2).tobytes()


@pytest.mark.parametrize(("value", "message"), [
    ([0.5] * 23, "expected a JSON object"),
    ({**VALUES, "car_postion": 0.5}, "unknown attribute 'car_postion'; did you mean car_position?"),
    ({NAMES[0]: 0.25, **dict.fromkeys(NAMES[1:14], 0.5)}, "attribute car_position is missing; all 23"),
    ({**VALUES, "bend": 0.5}, f"attribute field_of_view is missing; all {len(BOTH)}"),
    ({"space": "extended", **VALUES}, f"attribute field_of_view is missing; all {len(BOTH)}"),
    ({"space": "scenex", **VALUES, "bend": 0.5}, "unknown attribute 'bend'; known: illum"),
    ({"space": "narrow", **VALUES}, "unknown space 'narrow'; known: scenex, extended"),
    ({"space": ["extended"], **VALUES}, r"unknown space \['extended'\]; did you mean extended"),
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
    ([], "components must be a list"), ({}, "components must be a list"),
    ([WHOLE, {"share": 1}], r"components\[1\]: expected an object of share and attributes"),
    ([{**WHOLE, "share": "all"}], r"components\[0\]: share is 'all'"),
    ([{**WHOLE, "attributes": {**VALUES, "car_position": 2}}], r"components\[0\]: .*car_position is 2"),
    ([{**WHOLE, "share": 0.5}], "add up to 1, not 0.5"),
    ([WHOLE, WHOLE], r"add up to 1, not 1 \+ 1"),
    *(([WHOLE, {**WHOLE, "share": share}], r"components\[1\]: share is .*, but must be a number in \(0, 1\]")
      for share in (2, -1, np.nan, 10**400)),
    ([{**WHOLE, "share": 0.5}, {"share": 0.5, "attributes": dict.fromkeys(BOTH, 0.5)}], "different spaces"),
])  # fmt: skip
def test_what_is_wrong_in_a_mixture_is_named(rows, message):
    refused(ValueError, message, module.parse_streets, {"components": rows})


@given(st.lists(st.floats(0.01, 1), min_size=1, max_size=4), SEEDS)
def test_a_mixture_draws_each_component_its_share(weights, seed):
    shares = [w / sum(weights) for w in weights]
    parts = [slide(np.full(23, k / 10), 0.0) for k in range(len(shares))]
    streets = module.mixture(shares, parts)
    parsed = module.parse_streets(json.loads(json.dumps(describe(streets))))
    units = draw(streets, seed, 200)
    np.testing.assert_array_equal(draw(parsed, seed, 200), units)
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
    assert module.space_in(module.read_streets("mixed", None)) == "scenex"
    np.testing.assert_array_equal(module.streets_named("default", "extended", 0.3), by_eye)
    complaint = "unknown streets 'half'; known: default, random, mixed"
    refused(ValueError, complaint, module.streets_named, "half", "scenex")


def test_a_file_has_its_own_space_and_another_is_refused(tmp_path):
    file = tmp_path / "attributes.json"
    file.write_text(json.dumps(describe(random_proposal("extended"))))
    for space in (None, "extended"):
        assert module.space_in(module.read_streets(str(file), space)) == "extended"
    complaint = "attributes.json has the attributes of space extended, not scenex"
    refused(UserError, complaint, module.read_streets, str(file), "scenex")


@pytest.mark.parametrize("content", [None, "no JSON", '{"nonsense": 1}'])
def test_a_file_that_is_missing_or_wrong_is_the_user_s_error(content, tmp_path):
    file = tmp_path / "streets.json"
    if content is not None:
        file.write_text(content)
    refused(UserError, str(file), module.read_streets, str(file), "scenex")


def test_components_that_are_equal_are_one():
    by_eye, other = default_proposal(), random_proposal()
    assert module.mixture((0.5, 0.5), (by_eye, by_eye)) is by_eye
    assert module.mixture((0.25, 0.5, 0.25), (by_eye, other, by_eye)).shares == (0.5, 0.5)
    assert module.mixture(np.array([0.25, 0.75]), (by_eye, other)).shares == (0.25, 0.75)
    np.testing.assert_array_equal(draw(module.mixture((1,), (other,)), 3, 2), draw(other, 3, 2))


def histogram(weights):
    rows = np.array(weights)
    return Histogram((rows / rows.sum(axis=1, keepdims=True)).astype(np.float32))


def bins_of(units, count):
    borders = (np.arange(1, count) / count).astype(np.float32)
    return np.searchsorted(borders, units, side="right")


@given(ROWS, SEEDS)
def test_a_histogram_is_read_back_to_the_bit_and_draws_the_same(weights, seed):
    component = histogram(weights)
    for streets in (
        component,
        module.mixture((0.25, 0.75), (random_proposal(module.space_in(component)), component)),
    ):
        parsed = module.parse_streets(json.loads(json.dumps(describe(streets))))
        parsed_component = module.components(parsed)[-1][1]
        assert (
            isinstance(parsed_component, Histogram)
            and parsed_component.probabilities.dtype == np.float32
        )
        assert parsed_component.probabilities.tobytes() == component.probabilities.tobytes()
        np.testing.assert_array_equal(draw(parsed, seed, 6), draw(streets, seed, 6))
    units = draw(component, seed, 6)
    assert units.dtype == np.float32 and (units >= 0).all() and (units < 1).all()
    np.testing.assert_array_equal(draw(component, seed, 2), units[:2])
    samples = np.take_along_axis(component.probabilities, bins_of(units, len(weights[0])).T, axis=1)
    assert (samples > 0).all()


@pytest.mark.parametrize("count", [2, 3, 7, 10])
def test_bins_are_drawn_as_often_as_they_are_likely(count):
    weights = np.random.default_rng(count).gamma(0.5, size=(23, count))
    weights[:, 0][::2] = weights[:, -1][1::2] = 0
    component = histogram(weights)
    units = draw(component, 4, 4000)
    bins = bins_of(units, count)
    shares = (bins[..., None] == np.arange(count)).mean(axis=0)
    np.testing.assert_allclose(shares, component.probabilities, atol=0.03)
    assert (shares[component.probabilities == 0] == 0).all()
    inside = units * count - bins  # uniform within each bin
    assert inside[bins == np.argmax(weights, axis=1)].mean() == pytest.approx(0.5, abs=0.02)
    mean = component.probabilities @ ((np.arange(count) + 0.5) / count)
    np.testing.assert_allclose(units.mean(axis=0), mean, atol=0.03)
    spread = np.minimum(units.std(axis=0), 12**-0.5)  # no interval is longer than 1
    np.testing.assert_allclose(spread, moments(component).width * 12**-0.5, atol=0.03)
    space, policy = sdr_jax.space(NAMES, count), jnp.asarray(component.probabilities)
    np.testing.assert_allclose(moments(component), distributions.moments(space, policy), atol=1e-5)


def test_certain_bins_are_intervals_and_even_ones_the_whole_range():
    even = Histogram(np.full((23, 4), 0.25, np.float32))
    for component, expected in ((moments(even), random_proposal()), (even, random_proposal())):
        np.testing.assert_allclose(draw(component, 2, 50), draw(expected, 2, 50), atol=1e-6)
    for count in (2, 9, 41):
        for bin_ in (0, count // 2, count - 1):
            certain = Histogram(np.tile(np.eye(count, dtype=np.float32)[bin_], (23, 1)))
            interval = slide(np.full(23, (bin_ + 0.5) / count), 1 / count)
            np.testing.assert_allclose(moments(certain), interval, atol=1e-6)
            np.testing.assert_allclose(draw(certain, 3, 50), draw(interval, 3, 50), atol=1e-6)
            assert (bins_of(draw(certain, 3, 50), count) == bin_).all()


@pytest.mark.parametrize("count", [3, 7, 10, 41])
def test_the_ends_of_bins_belong_to_them(count):
    """The smallest and largest number of a stream, and the border between two bins."""
    numbers = np.float32([0, np.nextafter(np.float32(0.5), np.float32(0)), 0.5, module.BELOW_ONE])
    for low, high in ((0, 1), (0, count - 1), (1, count - 1)):
        row = np.zeros(count, np.float32)
        row[low] = row[high] = 0.5
        inverse = module._inverse_distribution(Histogram(np.tile(row, (4, 1))))
        assert bins_of(inverse(numbers), count).tolist() == [low, low, high, high]


def test_a_histogram_is_no_proposal_that_has_the_same_numbers():
    half = np.full(23, 0.5, np.float32)
    interval, even = Proposal(half, half), Histogram(np.stack([half, half], axis=1))
    streets = module.mixture((0.5, 0.5), (interval, even))
    assert streets.shares == (0.5, 0.5)
    equal = Histogram(even.probabilities.copy())
    assert len(module.components(module.mixture((0.5, 0.5), (even, equal)))) == 1
    extended = Histogram(np.full((len(BOTH), 2), 0.5, np.float32))
    assert module.space_in(extended) == "extended"
    refused(ValueError, "different spaces", module.mixture, (0.5, 0.5), (even, extended))


EVEN = {"unit": {"probabilities": [0.25, 0.25, 0.5]}}
BINNED = dict.fromkeys(NAMES, EVEN)


@pytest.mark.parametrize(("entry", "message"), [
    ({"unit": {"centre": 0.5, "width": 0.1}}, "car_position has no probabilities, but illumination_inten"),
    ({"probabilities": [0.5, 0.5]}, "car_position has 2 probabilities, but must have 3, as many as"),
    *(({"probabilities": value}, f"car_position{message}") for value, message in (
        (0.5, ": probabilities must be a list of two"), ([1.0], ": probabilities must be a list of two"),
        ([0.25, 0.25, 0.4], r" has probabilities that add up to 0.9, not 1"),
        ([0.5, 0.5, 3e-4], " has probabilities that add up to 1.0003"),
        *(([0.5, 0.5, bad], f" has the probability {bad!r}, which must be a number in") for bad in (
            -0.1, 5, np.nan, np.inf, True, None, "0")),
    )),
])  # fmt: skip
def test_what_is_wrong_in_probabilities_is_named(entry, message):
    module.parse_streets(BINNED)
    refused(ValueError, message, module.parse_streets, {**BINNED, "car_position": entry})
    rows = [{"share": 1, "attributes": {**BINNED, "car_position": entry}}]
    refused(
        ValueError,
        rf"components\[0\]: attribute {message}",
        module.parse_streets,
        {"components": rows},
    )
    wide = {"centre": 0.5, "width": 0.1}
    refused(ValueError, "no probab", module.parse_streets, {**BINNED, NAMES[0]: wide})


def test_beside_probabilities_an_attribute_with_one_value_is_held():
    parsed = module.parse_streets({**VALUES, "car_position": EVEN})
    assert [NAMES[where] for where, _ in parsed.held] == [n for n in NAMES if n != "car_position"]
    units = draw(parsed, 0, 400)
    car = NAMES.index("car_position")
    assert (np.delete(units, car, axis=1) == np.float32(0.25)).all()
    assert 0.4 < (units[:, car] >= 2 / 3).mean() < 0.6


def test_probabilities_alone_are_enough_and_decide():
    thirds = {"probabilities": [1 / 3, 1 / 3, 0.3333]}  # rounded by hand
    entry = {"unit": {"centre": 0.1, "width": 0, **thirds}}
    parsed = module.parse_streets({**dict.fromkeys(NAMES, thirds), NAMES[3]: entry})
    assert parsed.probabilities.tobytes() == np.float32([thirds["probabilities"]] * 23).tobytes()
    np.testing.assert_allclose(moments(parsed).centre, 0.5, atol=1e-4)
    unit = describe(parsed)["components"][0]["attributes"][NAMES[3]]["unit"]
    assert unit["probabilities"] == [0.33333334, 0.33333334, 0.3333]
    assert list(unit) == ["centre", "width", "probabilities"] and unit["width"] == pytest.approx(
        1, abs=1e-3
    )
