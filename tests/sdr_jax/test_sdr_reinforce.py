"""The policy, baselines, and REINFORCE."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sdr_jax import Baseline, ema, leave_one_out, reinforce_loss, sdr, space
from sdr_jax.baseline import init_baseline
from sdr_jax.distributions import entropy
from sdr_jax.layout import init_policies
from sdr_jax.policy import Policy, log_prob, mask_logits, sample_bins
from sdr_jax.trees import take
from sdr_jax.variance_reduction import normalised

from .conftest import SEEDS, assert_close, refuses

MASK = jnp.asarray([[True, True, False, False], [True] * 4, [True, False, False, False]])
REWARDS = st.lists(st.tuples(*[st.integers(-100, 100)] * 3), min_size=1, max_size=6)
BINS = jnp.asarray([[True, True, False], [True] * 3])
ACTIONS = jnp.asarray(list(itertools.product(range(2), range(3))), jnp.int32)  # all 6
SPACE = space(["a", "b"], bins=[2, 3])
METHOD = sdr(SPACE, learning_rate=optax.sgd(1.0), hidden=8, baseline=leave_one_out())
PAIRS = jnp.asarray(list(itertools.product(range(6), repeat=2)))


def test_log_prob_and_entropy_by_hand() -> None:
    logits = mask_logits(jnp.log(jnp.asarray([[0.25, 0.75, 9, 9], [0.1, 0.2, 0.3, 0.4]])), MASK[:2])
    actual = log_prob(logits, jnp.asarray([[0, 3], [1, 0]]))
    np.testing.assert_allclose(actual, np.log([0.25 * 0.4, 0.75 * 0.1]), rtol=1e-5)
    p = np.asarray([0.25, 0.75, 0.1, 0.2, 0.3, 0.4])
    assert float(entropy(jax.nn.softmax(logits))) == pytest.approx(-np.sum(p * np.log(p)), rel=1e-5)


@given(SEEDS)
def test_a_padded_slot_of_one_bin_has_no_effect_and_gradients_are_finite(seed: int) -> None:
    raw = 3 * jax.random.normal(jax.random.key(seed), (3, 4))
    total, grads = with_gradient(raw)
    assert np.all(np.isfinite(grads))
    assert not np.any(grads[~np.asarray(MASK)]) and not np.any(grads[2])
    assert total == with_gradient(raw.at[2].add(5.0))[0]
    without = mask_logits(raw, MASK)[:2]
    expected = log_prob(without, ACTION[:, :2]).sum() + entropy(jax.nn.softmax(without))
    np.testing.assert_allclose(total, expected, rtol=1e-5)


ACTION = jnp.asarray([[1, 2, 0]])


@jax.jit
@jax.value_and_grad
def with_gradient(raw: jax.Array) -> jax.Array:
    logits = mask_logits(raw, MASK)
    return log_prob(logits, ACTION).sum() + entropy(jax.nn.softmax(logits))


@given(SEEDS)
def test_samples_follow_the_logits_and_probabilities_sum_to_one(seed: int) -> None:
    logits = mask_logits(3 * jax.random.normal(jax.random.key(seed), (3, 4)), MASK)
    actions = sample_bins(jax.random.key(seed), logits, 20_000)
    assert actions.dtype == jnp.int32
    every = jnp.asarray([(a, b, 0) for a in range(2) for b in range(4)])
    assert float(jnp.exp(log_prob(logits, every)).sum()) == pytest.approx(1, abs=1e-5)
    frequencies = np.stack([np.bincount(column, minlength=4) for column in actions.T]) / 20_000
    np.testing.assert_allclose(frequencies, jax.nn.softmax(logits), atol=0.02)
    assert not np.any(frequencies[~np.asarray(MASK)])


def test_a_padded_policy_equals_the_policy_without_padding() -> None:
    padded_space = space(["a", "b", "c"], bins=[3, 5, 2], groups=[["c"], ["b", "a"]])
    params, inputs = init_policies(jax.random.key(1), padded_space, hidden=16)
    size = sum(leaf.size for leaf in jax.tree.leaves(params))
    assert size == 2 * ((2 + 1) * 16 + (16 + 1) * 2 * 5)  # of two groups, as in the paper
    assert np.all((inputs >= 0) & (inputs < 1)) and inputs[0, 1] == 0
    first = take(params, jnp.asarray(0))
    padded = Policy(2, 5, 16).apply(first, inputs[0])
    shapes = jax.eval_shape(Policy(1, 2, 16).init, jax.random.key(0), jnp.zeros(1))
    small = jax.tree.map(lambda leaf, to: leaf[tuple(map(slice, to.shape))], first, shapes)
    np.testing.assert_allclose(padded[:1, :2], Policy(1, 2, 16).apply(small, inputs[0, :1]))
    assert not np.any(padded[1:])
    sums = (jax.tree.map(lambda leaf: np.abs(leaf).sum(), tree) for tree in (first, small))
    assert_close(*sums, rtol=1e-6)


def test_each_group_has_a_policy_and_inputs_of_its_own() -> None:
    """Groups of one size, and groups of one size after padding, begin with different weights and inputs."""
    alike = space(
        list("abcdef"), bins=[3, 3, 3, 3, 2, 3], groups=[["a", "b"], ["c", "d"], ["e", "f"]]
    )
    params, inputs = init_policies(jax.random.key(1), alike, hidden=16)
    for leaf in (inputs, *(leaf for leaf in jax.tree.leaves(params) if np.any(leaf))):
        assert len(np.unique(np.asarray(leaf).reshape(3, -1), axis=0)) == 3


def advantages(baseline: Baseline, updates: list) -> list[list[float]]:
    state, out = init_baseline(), []
    for rewards in updates:
        values, state = baseline.advantage(state, jnp.asarray(rewards, jnp.float32))
        out.append(values.tolist())
    return out


@pytest.mark.parametrize(("baseline", "updates", "expected"), [
    # Baselines: 1 (the first reward), 1, then 0.9 * 1 + 0.1 * 2 = 1.1.
    (ema(), [[1], [2], [2]], [[0], [1], [0.9]]),
    # Of the authors' code: 1, 0.9 * 1 + 0.1 * 2 = 1.1, 0.9 * 1.1 + 0.1 * 2 = 1.19.
    (ema(includes_current=True), [[1], [2], [2]], [[0], [0.9], [0.81]]),
    # Several data sets enter as their mean.
    (ema(decay=0.5), [[1, 3], [4, 4], [3, 3]], [[-1, 1], [2, 2], [0, 0]]),
    (leave_one_out(), [[1, 2, 6]], [[1 - 4, 2 - 3.5, 6 - 1.5]]),
])  # fmt: skip
def test_baselines_by_hand(baseline: Baseline, updates: list, expected: list) -> None:
    np.testing.assert_allclose(advantages(baseline, updates), expected, rtol=1e-6, atol=1e-6)
    refuses(r"1\.5", ema, decay=1.5)


@pytest.mark.parametrize("baseline", [ema(), ema(includes_current=True), leave_one_out()])
@given(REWARDS, st.integers(-100, 100))
def test_a_constant_added_to_all_rewards_changes_no_advantage(baseline, updates, constant) -> None:
    shifted = [[reward + constant for reward in rewards] for rewards in updates]
    expected = advantages(baseline, updates)
    np.testing.assert_allclose(advantages(baseline, shifted), expected, atol=1e-3)


@given(st.lists(st.integers(-1000, 1000), min_size=3, max_size=3), st.integers(1, 1000))
def test_normalised_advantages_forget_the_scale_and_stay_finite(values: list, scale: int) -> None:
    raw = jnp.asarray(values, jnp.float32)
    actual = normalised(raw)
    np.testing.assert_allclose(normalised(scale * raw), actual, atol=1e-4)
    size = np.sqrt(np.mean(np.square(values)))
    np.testing.assert_allclose(actual * size, raw, rtol=1e-4, atol=1e-4)
    assert np.all(np.isfinite(actual))
    np.testing.assert_allclose(normalised(jnp.asarray([0.02])), 1, rtol=1e-4)  # does not explode


def test_the_loss_by_hand_leaves_failed_data_sets_out() -> None:
    log_probs, rewards = jnp.asarray([1.0, 2.0]), jnp.asarray([3.0, -1.0])
    loss, slope = jax.value_and_grad(lambda x: reinforce_loss(x * log_probs, rewards))(1.0)
    assert loss == slope == -0.5
    of_log_probs, of_advantages = jax.grad(reinforce_loss, (0, 1))(log_probs, rewards)
    assert not np.any(of_advantages)  # no gradient flows into them
    failed = jax.grad(reinforce_loss)(jnp.asarray([1, 5.0, 2]), jnp.asarray([3, jnp.nan, -1]))
    np.testing.assert_array_equal(failed, [of_log_probs[0], 0, of_log_probs[1]])
    assert not np.any(jax.grad(reinforce_loss)(log_probs, jnp.full(2, jnp.nan)))


@jax.jit
def exact_and_mean_update(seed: jax.Array, rewards: jax.Array, shift: jax.Array) -> tuple:
    """The policy's exact gradient, and the mean over all pairs of what one update adds to it."""
    state = METHOD.init(jax.random.key(seed))
    params, inputs = take((state.learners.params, state.inputs), jnp.asarray(0))
    net = Policy(2, 3, 8)

    def log_probs(params: dict) -> jax.Array:
        return log_prob(mask_logits(net.apply(params, inputs), BINS), ACTIONS)

    def step(pair: jax.Array) -> dict:
        after, _ = METHOD.update(state, ACTIONS[pair], rewards[pair] + shift)
        return jax.tree.map(jnp.subtract, take(after.learners.params, jnp.asarray(0)), params)

    exact = jax.grad(lambda params: jnp.sum(jnp.exp(log_probs(params)) * rewards))(params)
    probabilities = jnp.exp(log_probs(params)[PAIRS].sum(axis=1))
    steps = jax.vmap(step)(PAIRS)
    return exact, jax.tree.map(lambda leaf: jnp.tensordot(probabilities, leaf, 1), steps)


@given(SEEDS, st.integers(-5, 5))
def test_mean_sgd_update_of_the_whole_method_is_the_exact_gradient(seed: int, shift: int) -> None:
    rewards = jnp.asarray(np.random.default_rng(seed).normal(size=6), jnp.float32)
    assert_close(*exact_and_mean_update(jnp.uint32(seed), rewards, jnp.float32(shift)), atol=2e-5)
