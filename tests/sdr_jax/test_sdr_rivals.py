"""Tests of single rivals; test_sdr_every_method.py has what all methods share."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from hypothesis import given, settings

from sdr_jax import Proposal, attribute_descent, ema, random_search, relax, sdr, space
from sdr_jax.rivals.gaussian import GaussianParams, gaussian
from sdr_jax.sdr import SdrState

from .conftest import KEY, SEEDS, driven, refuses, tell

SPACE = space(["a", "b", "c"], bins=[2, 10, 5])
PAIR = space(["a", "b"], bins=[4, 2])
GAUSSIAN = gaussian(PAIR, learning_rate=optax.sgd(1.0), normalise=False)


def test_random_search_samples_uniformly_and_keeps_the_best() -> None:
    method = random_search(SPACE)
    state = method.init(KEY)
    actions, proposal = method.sample(jax.random.key(1), state, 20_000)
    counts = [np.bincount(column, minlength=10) for column in np.asarray(actions).T]
    np.testing.assert_allclose(counts, 20_000 * method.diagnostics.probabilities(state), atol=300)
    np.testing.assert_allclose(proposal, relax(SPACE, actions), atol=1e-6)
    actions = jnp.asarray([[0, 4, 1], [1, 2, 3]])
    state, info = tell(method, actions, [0.25, 0.75])
    assert (info.reward_mean, info.reward_best) == (0.5, 0.75)
    for reward in (0.5, 0.75, jnp.nan):  # worse, equal, unknown
        state, _ = tell(method, actions[:1], [reward], state)
    for answer in (method.solution(state), method.diagnostics.spread(state)):
        np.testing.assert_array_equal(answer, relax(SPACE, actions[1]))
    state, _ = tell(method, actions[:1], [1.0], state)
    assert state.actions.tolist() == [0, 4, 1]


def test_the_gradient_of_the_gaussian_by_hand_and_of_one_data_set() -> None:
    """d log p / d mean = z / std and d log p / d log std = z^2 - 1, with z the whitened action."""
    whitened = np.asarray([[1.0, -2.0], [0.5, 0.0]])
    after, info = tell(GAUSSIAN, np.float32(1.5 * whitened), [3, 1])
    np.testing.assert_allclose(info.advantages, [2, -2])  # against the other one
    advantages = np.asarray([[2.0], [-2.0]])
    mean = (advantages * whitened / 1.5).mean(axis=0)
    log_std = np.log(1.5) + (advantages * (whitened**2 - 1)).mean(axis=0)
    np.testing.assert_allclose(after.params.mean, mean, rtol=1e-5)
    np.testing.assert_allclose(after.params.log_std, log_std, rtol=1e-5)
    # Advantages that do not add up to 0, as after a first update, show the density's -log std.
    method = gaussian(PAIR, learning_rate=optax.sgd(1.0), normalise=False, baseline=ema())
    state, _ = tell(method, np.float32(1.5 * whitened), [0, 0])
    after, info = tell(method, np.float32(1.5 * whitened), [3, 1], state)
    np.testing.assert_allclose(info.advantages, [3, 1])
    entropies = np.asarray(state.params.log_std, float) + 0.5 * np.log(2 * np.pi * np.e)
    assert float(info.entropy) == pytest.approx(entropies.sum(), rel=1e-5)
    expected = np.log(1.5) + ([[3.0], [1.0]] * (whitened**2 - 1)).mean(axis=0)
    np.testing.assert_allclose(after.params.log_std, expected, rtol=1e-5)
    refuses("at least 2 data sets", tell, GAUSSIAN, jnp.zeros((1, 2)), [1])
    tell(gaussian(PAIR, baseline=ema()), jnp.zeros((1, 2)), [1])


def test_probabilities_and_spread_of_the_gaussian_are_those_of_samples() -> None:
    params = GaussianParams(jnp.asarray([1.0, -0.5]), jnp.log(jnp.asarray([0.8, 2.0])))
    state = GAUSSIAN.init(KEY)._replace(params=params)
    actions, _ = GAUSSIAN.sample(jax.random.key(1), state, 40_000)
    assert actions.dtype == jnp.float32
    values = np.asarray(jax.nn.sigmoid(actions))
    for p, column, bins in zip(
        GAUSSIAN.diagnostics.probabilities(state), values.T, PAIR.bins, strict=True
    ):
        counts, _ = np.histogram(column, bins, (0, 1))
        np.testing.assert_allclose(p[:bins], counts / 40_000, atol=0.01)
    # A street's value is a sample, relaxed: uniform around it.
    variance = values.var(axis=0) + np.asarray([0.25, 0.5]) ** 2 / 12
    width = np.minimum(1, np.sqrt(12 * variance))
    np.testing.assert_allclose(GAUSSIAN.diagnostics.spread(state).width, width, atol=0.02)
    np.testing.assert_allclose(GAUSSIAN.solution(state).centre[0], jax.nn.sigmoid(1.0), rtol=1e-5)


UNEVEN = space(["a", "b", "c"], bins=[3, 5, 2], groups=[["b"], ["c", "a"]])
ORDER = ["c", "a", "d", "b"]
SINGLE = space(list("abcd"), bins=4, groups=[[name] for name in ORDER])
DESCENT = attribute_descent(SINGLE)
SDR = {n: sdr(SINGLE, updates_per_group=math.ceil(4 / n), hidden=2) for n in (1, 3, 6)}


@pytest.mark.parametrize("n", SDR)
@settings(max_examples=3)
@given(seed=SEEDS)
def test_descent_is_sdr_with_one_group_per_attribute_and_brute_force_for_a_policy(seed, n) -> None:
    """The paper's remark, with SDR's own schedule, fixed groups and undecided attributes."""
    table = jnp.asarray(np.random.default_rng(seed).uniform(size=(5,) * 4), jnp.float32)

    def reward(rng_key: jax.Array, proposals: Proposal, actions: jax.Array) -> jax.Array:
        """Of all attributes together, undecided ones included, with no structure at all."""
        decided = proposals.width < 1
        return table[tuple(jnp.where(decided, jnp.floor(proposals.centre * 4), 4).astype(int).T)]

    method, per_group = SDR[n], math.ceil(4 / n)
    state, expected = method.init(jax.random.key(seed)), []

    def moved(**changes: jax.Array) -> SdrState:
        return state._replace(descent=state.descent._replace(**changes))

    for group in map(SINGLE.names.index, ORDER):
        rewards: dict[int, list[float]] = {k: [] for k in range(4)}
        for t in range(per_group):
            actions, _ = method.sample(jax.random.key(seed), state, n)
            brute_force = (jnp.arange(n) + t * n) % 4  # in place of what the policy samples
            expected.append(actions.at[:, group].set(brute_force))
            for k, r in zip(
                brute_force, reward(KEY, relax(SINGLE, expected[-1]), expected[-1]), strict=True
            ):
                rewards[int(k)].append(float(r))
            state = moved(updates=state.descent.updates + 1)  # moves on to the next group by itself
        best = max(rewards, key=lambda k: np.mean(rewards[k]))
        state = moved(fixed=state.descent.fixed.at[group].set(best))  # in place of arg max

    final, record = driven(KEY, DESCENT, reward, 4 * per_group, n)
    np.testing.assert_array_equal(record.actions, jnp.stack(expected))
    np.testing.assert_array_equal(final.current, state.descent.fixed)
    np.testing.assert_array_equal(DESCENT.solution(final), relax(SINGLE, state.descent.fixed))


@pytest.mark.parametrize(("n", "updates"), [(1, 10), (2, 6), (3, 4), (4, 4), (25, 3)])
def test_a_round_tries_every_bin_with_any_number_of_data_sets(n: int, updates: int) -> None:
    method = attribute_descent(UNEVEN)
    best = jnp.asarray([2, 1, 0])
    values = relax(UNEVEN, best).centre

    def reward(rng_key: jax.Array, proposals: Proposal, actions: jax.Array) -> jax.Array:
        distance = jnp.abs(proposals.centre - values[None, :])
        return -jnp.sum(jnp.where(proposals.width < 1, distance, 1.0), axis=1)

    state, record = driven(KEY, method, reward, updates, n)
    assert (int(state.sweeps), int(state.tried)) == (3, 0)
    np.testing.assert_array_equal(state.current, best)
    assert record.info.group.tolist() == sorted(record.info.group.tolist())
    tried = np.asarray(record.actions).reshape(-1, 3)
    assert set(tried[:, 0]) == {-1, 0, 1, 2}  # the last in the order
    assert set(tried[:, 1]) == {0, 1, 2, 3, 4}  # the first: from then on it stays decided
    earlier, _ = driven(KEY, method, reward, updates - 1, n)
    assert int(earlier.current[0]) == -1  # a sweep that is not finished decides nothing


def test_repeats_are_averaged_and_failed_bins_tried_again_but_not_forever() -> None:
    method = attribute_descent(space(["a"], bins=2), repeats=2)
    state = method.init(KEY)
    for tried, rewards in (
        ([[0], [1]], [1.0, 0.6]),
        ([[0], [1]], [0.0, jnp.nan]),
        ([[1], [0]], [0.6, 0.0]),  # bin 1 lacks a reward; the other data set is to spare
    ):
        assert int(state.current[0]) == -1
        actions, _ = method.sample(KEY, state, 2)
        np.testing.assert_array_equal(actions, tried)
        state, _ = tell(method, actions, rewards, state)
    assert int(state.current[0]) == 1  # 0.6, against the mean of 1, 0 and 0
    np.testing.assert_allclose(method.diagnostics.probabilities(state), 0.5)  # it starts again
    failing = lambda _, proposals, actions: jnp.where(proposals.centre[:, 0] == 0.75, jnp.nan, 1.0)  # noqa: E731
    state, record = driven(KEY, attribute_descent(space(["a", "b"], bins=2)), failing, 6)
    assert record.actions[:, 0, 0].tolist() == [0, 1, 1, 1, 1, 1]  # 3 times the usual 2
    assert (state.current.tolist(), int(state.sweeps)) == ([0, -1], 1)


@pytest.mark.parametrize("make", [attribute_descent, sdr])
def test_authors_code_puts_undecided_at_half(make) -> None:
    method = make(UNEVEN, width=0.02, unoptimised="half")
    _, proposal = method.sample(KEY, method.init(KEY), 2)
    np.testing.assert_array_equal(proposal.centre[:, 2], 0.5)
    np.testing.assert_allclose(proposal.width, 0.02)
