import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sdr_jax import Proposal, Space, draw, relax, slide, space

NAMES = ["car", "tree", "fence"]
SPACE = space(NAMES, bins=[10, 4, 7], groups=[["fence"], ["car", "tree"]])
seeds = st.integers(0, 2**32 - 1)


def test_a_space_is_built_from_names() -> None:
    assert SPACE.bins == (10, 4, 7)
    assert SPACE.groups == ((2,), (0, 1))
    assert (SPACE.attributes, SPACE.max_bins) == (3, 10)
    assert space(NAMES).groups == ((0, 1, 2),)
    assert hash(SPACE) == hash(space(NAMES, [10, 4, 7], [["fence"], ["car", "tree"]]))


@pytest.mark.parametrize(
    ("arguments", "culprit"),
    [
        (dict(names=[]), "at least one attribute"),
        (dict(names=["car", "car"]), "'car'"),
        (dict(names=NAMES, bins=1), "'car' has 1 bins"),
        (dict(names=NAMES, bins=[10, 10, 1]), "'fence' has 1 bins"),
        (dict(names=NAMES, bins=[10, 10]), "3 attributes, but 2"),
        (dict(names=NAMES, groups=[["car", "bus"], ["tree", "fence"]]), "'bus'"),
        (dict(names=NAMES, groups=[["car", "tree"], ["tree", "fence"]]), "'tree'"),
        (dict(names=NAMES, groups=[["car", "tree"]]), "'fence'"),
        (dict(names=NAMES, groups=[NAMES, []]), "a group needs"),
    ],
)
def test_a_bad_space_is_refused_by_name(arguments: dict, culprit: str) -> None:
    with pytest.raises(ValueError, match=culprit):
        space(**arguments)


def test_indices_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="attribute 2"):
        Space(("car", "tree"), (10, 10), ((0, 1, 2),))


def test_relax_by_hand() -> None:
    centre, width = relax(SPACE, jnp.asarray([3, 3, -1]))
    np.testing.assert_allclose(centre, [0.35, 0.875, 0.5], atol=1e-7)
    np.testing.assert_allclose(width, [0.1, 0.25, 1.0], atol=1e-7)


def test_undecided_may_be_half() -> None:
    centre, width = relax(SPACE, jnp.asarray([3, 3, -1]), unoptimised="half")
    assert centre[2] == 0.5
    np.testing.assert_allclose(width[2], 1 / 7, atol=1e-7)


def test_bins_tile_the_unit_interval() -> None:
    wide = space(["a"], bins=7)
    centre, width = relax(wide, jnp.arange(7)[:, None])
    low, high = centre - width / 2, centre + width / 2
    assert low[0, 0] == pytest.approx(0, abs=1e-6)
    assert high[-1, 0] == pytest.approx(1, abs=1e-6)
    np.testing.assert_allclose(low[1:], high[:-1], atol=1e-6)


@given(st.integers(0, 9), st.integers(0, 100))
def test_wider_bins_slide_inside_and_keep_their_width(action: int, percent: int) -> None:
    given_width = percent / 100
    actions = jnp.asarray([action, action % 4, action % 7])
    centre, width = relax(SPACE, actions, given_width)
    np.testing.assert_allclose(width, given_width, atol=1e-6)
    assert np.all(centre - width / 2 >= -1e-6)
    assert np.all(centre + width / 2 <= 1 + 1e-6)
    # ... and move no further than needed.
    moved = np.abs(centre - (np.asarray(actions) + 0.5) / np.asarray(SPACE.bins))
    inside = (centre - width / 2 > 1e-6) & (centre + width / 2 < 1 - 1e-6)
    assert np.all(np.where(inside, moved, 0) < 1e-6)


def test_numpy_arrays_are_welcome() -> None:
    proposal = slide(np.asarray([0.0, 0.5, 1.0], np.float32), np.full(3, 0.5, np.float32))
    np.testing.assert_allclose(proposal.centre, [0.25, 0.5, 0.75])
    stored = Proposal(*map(np.asarray, proposal))
    np.testing.assert_array_equal(
        draw(jax.random.key(0), stored, 2), draw(jax.random.key(0), proposal, 2)
    )
    np.testing.assert_allclose(relax(SPACE, np.asarray([0, 0, -1])).width, [0.1, 0.25, 1])


def test_one_width_per_attribute() -> None:
    _, width = relax(SPACE, jnp.zeros((5, 3), int), (0.2, 0.3, 0.4))
    np.testing.assert_allclose(width[4], [0.2, 0.3, 0.4], atol=1e-7)


@given(seeds)
def test_draws_stay_in_their_interval_and_below_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    actions = jnp.asarray(rng.integers(-1, SPACE.bins, (4, 3)))
    proposal = relax(SPACE, actions)
    unit = draw(jax.random.key(seed), proposal, streets=50)
    assert unit.shape == (4, 50, 3)
    assert unit.dtype == jnp.float32
    low, high = proposal.centre - proposal.width / 2, proposal.centre + proposal.width / 2
    assert np.all((unit >= 0) & (unit < 1))
    assert np.all((unit >= low[:, None] - 1e-6) & (unit <= high[:, None] + 1e-6))


def test_draws_are_uniform_and_differ_between_streets() -> None:
    proposal = Proposal(jnp.asarray([0.5, 0.3]), jnp.asarray([1.0, 0.2]))
    unit = draw(jax.random.key(0), proposal, streets=20_000)
    np.testing.assert_allclose(unit.mean(0), proposal.centre, atol=0.01)
    np.testing.assert_allclose(unit.std(0), proposal.width / 12**0.5, atol=0.01)


def test_no_width_no_variance() -> None:
    proposal = relax(SPACE, jnp.asarray([9, 0, 2]), width=0.0)
    unit = draw(jax.random.key(0), proposal, streets=3)
    np.testing.assert_allclose(unit, np.tile([0.95, 0.125, 2.5 / 7], (3, 1)), atol=1e-6)


def test_even_a_draw_of_almost_one_stays_below_one() -> None:
    one = Proposal(jnp.ones(1), jnp.zeros(1))
    assert draw(jax.random.key(0), one, streets=1)[0, 0] < 1
