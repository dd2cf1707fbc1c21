"""Spaces, their bins, and relaxation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sdr_jax import Space, relax, slide, space
from sdr_jax.bins import bin_centres, bin_mask
from sdr_jax.distributions import entropy, moments, uniform

from .conftest import SEEDS, refuses

NAMES = ["car", "tree", "fence"]
SPACE = space(NAMES, bins=[10, 4, 7], groups=[["fence"], ["car", "tree"]])
SMALL = space(["a", "b", "c"], bins=[2, 5, 3])


def test_a_space_is_built_from_names() -> None:
    assert (SPACE.bins, SPACE.attributes, SPACE.max_bins) == ((10, 4, 7), 3, 10)
    assert (SPACE.groups, space(NAMES).groups) == (((2,), (0, 1)), ((0, 1, 2),))
    assert hash(SPACE) == hash(space(NAMES, [10, 4, 7], [["fence"], ["car", "tree"]]))
    refuses("attribute 2", Space, ("car", "tree"), (10, 10), ((0, 1, 2),))  # out of range


@pytest.mark.parametrize(("arguments", "culprit"), [
    (dict(names=[]), "at least one attribute"), (dict(names=["car", "car"]), "'car'"),
    (dict(names=NAMES, bins=1), "'car' has 1 bins"),
    (dict(names=NAMES, bins=[10, 10, 1]), "'fence' has 1 bins"),
    (dict(names=NAMES, bins=[10, 10]), "3 attributes, but 2"),
    (dict(names="car"), "names is the string 'car'"),
    (dict(names=NAMES, groups=[["car", "bus"], ["tree", "fence"]]), "'bus'"),
    (dict(names=NAMES, groups=[["car", "tree"], ["tree", "fence"]]), "'tree'"),
    (dict(names=NAMES, groups=[["car", "tree"]]), "'fence'"),
    (dict(names=NAMES, groups=[NAMES, []]), "a group needs"),
    (dict(names=NAMES, unordered=["weather"]), "in unordered: 'weather'; choose from car"),
])  # fmt: skip
def test_a_bad_space_is_refused_by_name(arguments: dict, culprit: str) -> None:
    refuses(culprit, space, **arguments)


@pytest.mark.parametrize("array", [jnp.asarray, np.asarray])  # both are accepted
@pytest.mark.parametrize(("options", "widths"), [
    ({}, [1 / 10, 1 / 4, 1]), (dict(unoptimised="half"), [1 / 10, 1 / 4, 1 / 7]),
    (dict(width=0.1), [0.1, 0.1, 1]),
    (dict(width=(0.2, 0.25, 0.4), unoptimised="half"), [0.2, 0.25, 0.4]),
])  # fmt: skip
def test_relax_by_hand(array, options: dict, widths: list[float]) -> None:
    centre, width = relax(SPACE, array([[3, 3, -1]] * 5), **options)
    np.testing.assert_allclose(centre, [[0.35, 0.875, 0.5]] * 5, atol=1e-7)
    np.testing.assert_allclose(width, [widths] * 5, atol=1e-7)


def test_a_bad_width_is_refused() -> None:
    for width, culprit in ((1.5, "1.5"), (-0.1, "-0.1"), ((0.1, 0.1), "2 widths for 3")):
        refuses(culprit, relax, SPACE, jnp.zeros(3, int), width=width)


@given(st.integers(0, 9), st.integers(0, 100))
def test_wider_bins_slide_inside_no_further_than_needed(action: int, percent: int) -> None:
    actions, target = np.asarray([action, action % 4, action % 7]), percent / 100
    centre, width = relax(SPACE, actions, target)
    np.testing.assert_allclose(width, target, atol=1e-6)
    inside = np.clip((actions + 0.5) / SPACE.bins, target / 2, 1 - target / 2)
    np.testing.assert_allclose(centre, inside, atol=1e-6)


def test_bins_their_entropy_and_moments_by_hand() -> None:
    assert bin_mask(SMALL).tolist() == [[1, 1, 0, 0, 0], [1] * 5, [1, 1, 1, 0, 0]]
    np.testing.assert_allclose(bin_centres(SMALL)[0, :2], [0.25, 0.75])
    np.testing.assert_allclose(bin_centres(SMALL)[1], [0.1, 0.3, 0.5, 0.7, 0.9])
    even, certain = uniform(SMALL), jax.nn.one_hot(jnp.asarray([1, 4, 0]), 5)
    np.testing.assert_allclose(even[2], [1 / 3] * 3 + [0, 0])
    assert float(entropy(even)) == pytest.approx(np.log(2 * 5 * 3), rel=1e-6)
    assert float(entropy(certain)) == 0
    np.testing.assert_allclose(moments(SMALL, even), [[0.5] * 3, [1] * 3], atol=1e-6)
    expected = relax(SMALL, jnp.asarray([1, 4, 0]), 0.1)
    np.testing.assert_allclose(moments(SMALL, certain, 0.1), expected, atol=1e-6)


@given(st.integers(0, 4), st.floats(0, 1), SEEDS)
def test_without_an_order_intervals_are_one_bin_or_all(value, share, seed) -> None:
    apart = space(["a", "b"], bins=5, unordered=["b"])
    centre, width = map(np.asarray, relax(apart, jnp.asarray([value, value]), 0.7))
    np.testing.assert_allclose([centre[1], width[1]], [(value + 0.5) / 5, 0.2], atol=1e-6)
    assert width[0] == pytest.approx(0.7)
    rest = np.random.default_rng(seed).dirichlet(np.ones(5), 2)
    p = (1 - share) * rest + share * np.eye(5)[value]
    interval = np.asarray(moments(apart, jnp.asarray(p, jnp.float32), 0.7))[:, 1]
    expected = [(p[1].argmax() + 0.5) / 5, 0.2] if p[1].max() > 0.5 else [0.5, 1]
    np.testing.assert_allclose(interval, expected, atol=1e-6)


@given(SEEDS)
def test_moments_are_those_of_the_distribution_and_stay_inside(seed: int) -> None:
    weights = np.random.default_rng(seed).exponential(size=(3, 5)) * bin_mask(SMALL)
    p = weights / weights.sum(axis=1, keepdims=True)
    centre, width = moments(SMALL, jnp.asarray(p, jnp.float32))
    bins, values = np.asarray(SMALL.bins), bin_centres(SMALL)
    mean = (p * values).sum(axis=1)
    variance = (p * (values - mean[:, None]) ** 2).sum(axis=1) + 1 / bins**2 / 12
    expected = np.minimum(1, np.sqrt(12 * variance))
    np.testing.assert_allclose(width, expected, atol=1e-5)
    np.testing.assert_allclose(centre, np.clip(mean, expected / 2, 1 - expected / 2), atol=1e-5)


def test_intervals_slide_into_the_unit_range() -> None:
    slid = slide(np.float32([0, 0.5, 1]), np.full(3, 0.5, np.float32))
    np.testing.assert_allclose(slid.centre, [0.25, 0.5, 0.75])


def test_numpys_numbers_of_bins_are_integers():
    for bins in (np.int64(5), np.array([5, 5, 5])):
        assert space(NAMES, bins=bins).bins == (5, 5, 5)


def test_half_of_an_attribute_without_order_is_one_bin():
    streets = space(["weather", "height"], bins=[4, 4], unordered=["weather"])
    centre, width = relax(streets, np.array([-1, -1]), None, "half")
    np.testing.assert_allclose(centre, [2.5 / 4, 0.5])
    np.testing.assert_allclose(width, [0.25, 0.25])
