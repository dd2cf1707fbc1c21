import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sdr_jax import Policy, space
from sdr_jax.coordinate_descent import take
from sdr_jax.policy import entropy, init_policies, log_prob, mask_logits, sample_bins

MASK = jnp.asarray([[True, True, False, False], [True] * 4, [True] * 4])
PRESENT = jnp.asarray([True, True, False])
seeds = st.integers(0, 2**32 - 1)


def random_logits(seed: int) -> jax.Array:
    return mask_logits(3 * jax.random.normal(jax.random.key(seed), (3, 4)), MASK)


def test_the_paper_sizes() -> None:
    params = Policy(attributes=7, bins=10).init(jax.random.key(0), jnp.zeros(7))
    count = sum(leaf.size for leaf in jax.tree.leaves(params))
    assert count == (7 + 1) * 256 + (256 + 1) * 7 * 10
    assert Policy(7, 10).apply(params, jnp.zeros(7)).shape == (7, 10)


def test_log_prob_and_entropy_by_hand() -> None:
    logits = mask_logits(jnp.log(jnp.asarray([[0.25, 0.75, 9, 9], [0.1, 0.2, 0.3, 0.4]])), MASK[:2])
    present = jnp.asarray([True, True])
    actual = log_prob(logits, jnp.asarray([[0, 3], [1, 0]]), present)
    np.testing.assert_allclose(actual, np.log([0.25 * 0.4, 0.75 * 0.1]), rtol=1e-5)
    p = np.asarray([0.25, 0.75, 0.1, 0.2, 0.3, 0.4])
    assert float(entropy(logits, present)) == pytest.approx(-np.sum(p * np.log(p)), rel=1e-5)


@given(seeds)
def test_probabilities_of_all_joint_actions_sum_to_one(seed: int) -> None:
    actions = jnp.asarray([(a, b, 0) for a in range(2) for b in range(4)])
    total = jnp.exp(log_prob(random_logits(seed), actions, PRESENT)).sum()
    assert float(total) == pytest.approx(1, abs=1e-5)


@given(seeds)
def test_padding_has_no_effect_and_gradients_are_finite(seed: int) -> None:
    raw = 3 * jax.random.normal(jax.random.key(seed), (3, 4))

    def both(raw: jax.Array, padding: int) -> jax.Array:
        logits = mask_logits(raw, MASK)
        actions = jnp.asarray([[1, 2, padding]])
        return log_prob(logits, actions, PRESENT).sum() + entropy(logits, PRESENT)

    grads = jax.grad(both)(raw, 3)
    assert np.all(np.isfinite(grads))
    assert not np.any(grads[~np.asarray(MASK)])
    assert not np.any(grads[2])
    assert both(raw, 3) == both(raw, -1)
    assert both(raw, 3) == both(raw.at[2].add(5.0), 3)


@given(seeds)
def test_masked_bins_are_never_sampled(seed: int) -> None:
    actions = sample_bins(jax.random.key(seed), random_logits(seed), 64)
    assert actions.dtype == jnp.int32
    assert actions[:, 0].max() < 2


def test_samples_follow_the_logits() -> None:
    logits = random_logits(3)
    actions = sample_bins(jax.random.key(0), logits, 20_000)
    frequencies = [np.bincount(np.asarray(column), minlength=4) / 20_000 for column in actions.T]
    np.testing.assert_allclose(frequencies, jax.nn.softmax(logits), atol=0.015)


SPACE = space(["a", "b", "c"], bins=[3, 5, 2], groups=[["c"], ["b", "a"]])


def test_a_padded_policy_is_its_own_size_policy() -> None:
    params, inputs = init_policies(jax.random.key(1), SPACE, hidden=16)
    assert np.all((inputs >= 0) & (inputs < 1))
    assert inputs[0, 1] == 0
    first = take(params, jnp.asarray(0))
    padded = Policy(2, 5, 16).apply(first, inputs[0])
    own_shapes = jax.eval_shape(Policy(1, 2, 16).init, jax.random.key(0), jnp.zeros(1))
    own = jax.tree.map(lambda leaf, to: leaf[tuple(map(slice, to.shape))], first, own_shapes)
    np.testing.assert_allclose(padded[:1, :2], Policy(1, 2, 16).apply(own, inputs[0, :1]))
    assert not np.any(padded[1:])
    for leaf, own_leaf in zip(jax.tree.leaves(first), jax.tree.leaves(own), strict=True):
        assert np.abs(leaf).sum() == pytest.approx(np.abs(own_leaf).sum())
