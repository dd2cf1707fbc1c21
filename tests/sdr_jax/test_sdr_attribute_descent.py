import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sdr_jax import Proposal, attribute_descent, relax, run_on_host, sdr, space

UNEVEN = space(["a", "b", "c"], bins=[3, 5, 2], groups=[["b"], ["c", "a"]])


def table_reward(seed: int, attributes: int, bins: int):
    """A reward of all attributes together, undecided ones included, with no structure at all."""
    table = np.random.default_rng(seed).uniform(size=(bins + 1,) * attributes).astype(np.float32)

    def reward(rng_key: jax.Array, proposals: Proposal) -> jax.Array:
        decided = proposals.width < 1
        index = jnp.where(decided, jnp.floor(proposals.centre * bins), bins).astype(int)
        return jnp.asarray(table)[tuple(index.T)]

    return reward


ORDER = ["c", "a", "d", "b"]
SINGLE = space(list("abcd"), bins=4, groups=[[name] for name in ORDER])
DESCENT = attribute_descent(SINGLE)
METHODS = {n: sdr(SINGLE, updates_per_group=math.ceil(4 / n), hidden=2) for n in (1, 3, 6)}


@pytest.mark.parametrize("n", METHODS)
@settings(max_examples=3)
@given(seed=st.integers(0, 2**32 - 1))
def test_it_is_sdr_with_one_group_per_attribute_and_brute_force_for_a_policy(
    seed: int, n: int
) -> None:
    """The paper's remark, with SDR's own schedule, fixed groups and undecided attributes."""
    active = [SINGLE.names.index(name) for name in ORDER]
    reward = table_reward(seed, 4, 4)
    method, per_group = METHODS[n], math.ceil(4 / n)

    state = method.init(jax.random.key(seed))
    descent = state.descent
    expected = []
    for group in active:
        tried: list[tuple[int, float]] = []
        for t in range(per_group):
            actions, _ = method.sample(jax.random.key(seed), state, n)
            brute_force = (jnp.arange(n) + t * n) % 4  # in place of what the policy samples
            actions = actions.at[:, group].set(brute_force)
            rewards = reward(jax.random.key(0), relax(SINGLE, actions))
            tried += zip(brute_force.tolist(), rewards.tolist(), strict=True)
            expected.append(actions)
            # SDR moves on to its next group by itself.
            descent = descent._replace(updates=descent.updates + 1)
            state = state._replace(descent=descent)
        best = max(range(4), key=lambda k: np.mean([r for bin_, r in tried if bin_ == k]))
        descent = descent._replace(fixed=descent.fixed.at[group].set(best))  # in place of arg max
        state = state._replace(descent=descent)

    found, record = run_on_host(jax.random.key(0), DESCENT, reward, 4 * per_group, n)
    np.testing.assert_array_equal(record.actions, jnp.stack(expected))
    np.testing.assert_array_equal(found.current, descent.fixed)
    learnt = relax(SINGLE, descent.fixed)
    jax.tree.map(np.testing.assert_array_equal, DESCENT.solution(found), learnt)


@pytest.mark.parametrize(("n", "updates"), [(1, 10), (2, 6), (3, 4), (4, 4), (25, 3)])
def test_a_round_tries_every_bin_with_any_number_of_data_sets(n: int, updates: int) -> None:
    method = attribute_descent(UNEVEN)
    best = jnp.asarray([2, 1, 0])
    values = relax(UNEVEN, best).centre

    def reward(rng_key: jax.Array, proposals: Proposal) -> jax.Array:
        distance = jnp.abs(proposals.centre - values[None, :])
        return -jnp.sum(jnp.where(proposals.width < 1, distance, 1.0), axis=1)

    state, record = run_on_host(jax.random.key(0), method, reward, updates, n)
    assert (int(state.sweeps), int(state.tried)) == (3, 0)
    np.testing.assert_array_equal(state.current, best)
    assert record.info.group.tolist() == sorted(record.info.group.tolist())
    tried = np.asarray(record.actions).reshape(-1, 3)
    assert set(tried[:, 0]) == {-1, 0, 1, 2}  # the last in the order
    assert set(tried[:, 1]) == {0, 1, 2, 3, 4}  # the first: from then on it stays decided
    earlier, _ = run_on_host(jax.random.key(0), method, reward, updates - 1, n)
    assert int(earlier.current[0]) == -1  # a sweep that is not finished decides nothing


def test_repeats_are_averaged_and_failed_bins_tried_again() -> None:
    method = attribute_descent(space(["a"], bins=2), repeats=2)
    state = method.init(jax.random.key(0))
    for tried, rewards in (
        ([[0], [1]], [1.0, 0.6]),
        ([[0], [1]], [0.0, jnp.nan]),
        ([[1], [0]], [0.6, 0.0]),  # bin 1 lacks a reward; the other data set is to spare
    ):
        assert int(state.current[0]) == -1
        actions, _ = method.sample(jax.random.key(0), state, 2)
        np.testing.assert_array_equal(actions, tried)
        state, _ = method.update(state, actions, jnp.asarray(rewards))
    assert int(state.current[0]) == 1  # 0.6, against the mean of 1, 0 and 0
    np.testing.assert_allclose(method.probabilities(state), 0.5)  # it goes round again


def test_a_bin_that_always_fails_does_not_hold_up_the_others() -> None:
    method = attribute_descent(space(["a", "b"], bins=2))

    def reward(rng_key: jax.Array, proposals: Proposal) -> jax.Array:
        return jnp.where(proposals.centre[:, 0] == 0.75, jnp.nan, 1.0)

    state, record = run_on_host(jax.random.key(0), method, reward, 6)
    assert record.actions[:, 0, 0].tolist() == [0, 1, 1, 1, 1, 1]  # 3 times the usual 2
    assert (state.current.tolist(), int(state.sweeps)) == ([0, -1], 1)


def test_authors_code_puts_undecided_at_half() -> None:
    method = attribute_descent(UNEVEN, 0.02, unoptimised="half")
    _, proposal = method.sample(jax.random.key(0), method.init(jax.random.key(0)), 2)
    np.testing.assert_array_equal(proposal.centre[:, 2], 0.5)
    np.testing.assert_allclose(proposal.width, 0.02)
