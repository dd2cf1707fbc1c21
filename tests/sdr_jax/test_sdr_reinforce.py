import itertools

import jax
import jax.numpy as jnp
import numpy as np
import optax
from hypothesis import given
from hypothesis import strategies as st

from sdr_jax import leave_one_out, reinforce_loss, sdr, space
from sdr_jax.coordinate_descent import take
from sdr_jax.policy import Policy, log_prob, mask_logits

BINS = (2, 3)
MASK = jnp.asarray([[True, True, False], [True] * 3])
PRESENT = jnp.asarray([True, True])
ACTIONS = jnp.asarray(list(itertools.product(*map(range, BINS))), jnp.int32)  # all 6
seeds = st.integers(0, 2**32 - 1)


def expected_reward(raw: jax.Array, rewards: jax.Array) -> jax.Array:
    return jnp.sum(jnp.exp(log_prob(mask_logits(raw, MASK), ACTIONS, PRESENT)) * rewards)


@jax.jit
def exact_and_estimated(
    raw: jax.Array, rewards: jax.Array, shift: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """The gradient by enumeration, and the mean over all actions of the estimator's."""

    def estimate(actions: jax.Array, reward: jax.Array) -> jax.Array:
        def loss(raw: jax.Array) -> jax.Array:
            log_probs = log_prob(mask_logits(raw, MASK), actions[None], PRESENT)
            return reinforce_loss(log_probs, reward[None] + shift)

        return -jax.grad(loss)(raw)

    probabilities = jnp.exp(log_prob(mask_logits(raw, MASK), ACTIONS, PRESENT))
    estimates = jax.vmap(estimate)(ACTIONS, rewards)
    return jax.grad(expected_reward)(raw, rewards), jnp.tensordot(probabilities, estimates, 1)


def test_by_hand() -> None:
    def loss(x: jax.Array) -> jax.Array:
        return reinforce_loss(x * jnp.asarray([1.0, 2.0]), jnp.asarray([3.0, -1.0]))

    assert loss(jnp.asarray(1.0)) == -0.5
    assert jax.grad(loss)(jnp.asarray(1.0)) == -0.5


def test_a_failed_data_set_is_left_out_of_the_mean() -> None:
    def grad(log_probs: list[float], advantages: list[float]) -> jax.Array:
        return jax.grad(reinforce_loss)(jnp.asarray(log_probs), jnp.asarray(advantages))

    with_it = grad([1.0, 5.0, 2.0], [3.0, jnp.nan, -1.0])
    np.testing.assert_array_equal(with_it[jnp.asarray([0, 2])], grad([1.0, 2.0], [3.0, -1.0]))
    assert with_it[1] == 0
    assert not np.any(grad([1.0, 2.0], [jnp.nan, jnp.nan]))


def test_no_gradient_flows_into_advantages() -> None:
    assert jax.grad(lambda a: reinforce_loss(jnp.ones(1), a))(jnp.ones(1)) == 0


@given(seeds, st.integers(-5, 5))
def test_mean_estimate_is_the_exact_gradient_whatever_the_baseline(seed: int, shift: int) -> None:
    rng = np.random.default_rng(seed)
    raw = jnp.asarray(rng.normal(size=(2, 3)), jnp.float32)
    rewards = jnp.asarray(rng.normal(size=6), jnp.float32)
    exact, estimated = exact_and_estimated(raw, rewards, jnp.float32(shift))
    np.testing.assert_allclose(estimated, exact, atol=3e-6)


SPACE = space(["a", "b"], bins=list(BINS))
METHOD = sdr(SPACE, optax.sgd(1.0), hidden=8, baseline=leave_one_out())
PAIRS = jnp.asarray(list(itertools.product(range(6), repeat=2)))


@jax.jit
def exact_and_mean_update(seed: jax.Array, rewards: jax.Array) -> tuple[dict, dict]:
    """The policy's exact gradient, and the mean over all pairs of what one update adds to it."""
    state = METHOD.init(jax.random.key(seed))
    params, inputs = take((state.learners.params, state.inputs), jnp.asarray(0))
    net = Policy(2, 3, 8)

    def pair_probability(pair: jax.Array) -> jax.Array:
        logits = mask_logits(net.apply(params, inputs), MASK)
        return jnp.exp(log_prob(logits, ACTIONS[pair], PRESENT).sum())

    def step(pair: jax.Array) -> dict:
        after, _ = METHOD.update(state, ACTIONS[pair], rewards[pair])
        return jax.tree.map(jnp.subtract, take(after.learners.params, jnp.asarray(0)), params)

    exact = jax.grad(lambda params: expected_reward(net.apply(params, inputs), rewards))(params)
    probabilities, steps = jax.vmap(pair_probability)(PAIRS), jax.vmap(step)(PAIRS)
    return exact, jax.tree.map(lambda leaf: jnp.tensordot(probabilities, leaf, 1), steps)


@given(seeds)
def test_mean_sgd_update_of_the_whole_method_is_the_exact_gradient(seed: int) -> None:
    rewards = jnp.asarray(np.random.default_rng(seed).normal(size=6), jnp.float32)
    exact, mean = exact_and_mean_update(jnp.uint32(seed), rewards)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-5), exact, mean)
