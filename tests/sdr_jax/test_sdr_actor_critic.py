import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sdr_jax import space
from sdr_jax.critic import critic
from sdr_jax.critic.actor_critic import follow, stratified
from sdr_jax.critic.regression import Posterior
from sdr_jax.relaxation import bin_mask

SPACE = space(["a", "b", "c", "d"], bins=[3, 5, 2, 4], groups=[["b"], ["d", "a"], ["c"]])
ALONE = space(["a", "b"], bins=[3, 5], groups=[["a"], ["b"]])
STRATIFIED = jax.jit(lambda key, p: stratified(key, SPACE, p, 7))


def policy(seed: int) -> np.ndarray:
    p = np.random.default_rng(seed).uniform(0.02, 1, (4, 5)) * bin_mask(SPACE)
    return (p / p.sum(axis=1, keepdims=True)).astype(np.float32)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_strata_keep_to_the_policy(seed: int) -> None:
    p = policy(seed)
    actions = np.asarray(STRATIFIED(jax.random.key(seed), jnp.asarray(p)))
    counts = np.stack([(actions == k).sum(axis=0) for k in range(5)], axis=1)
    assert np.all(np.abs(counts - 7 * p) < 2)  # a stratum may be cut at either end of a bin
    assert not np.any(counts[~bin_mask(SPACE)])


def test_every_stratified_action_is_drawn_from_the_policy() -> None:
    p = policy(3)
    keys = jax.random.split(jax.random.key(0), 4000)
    first = np.asarray(jax.vmap(lambda key: STRATIFIED(key, jnp.asarray(p)))(keys))[:, 0]
    shares = np.stack([(first == k).mean(axis=0) for k in range(5)], axis=1)
    np.testing.assert_allclose(shares, p, atol=0.03)
    # Attributes are independent: joint shares are products.
    joint = np.mean((first[:, 0] == 1) & (first[:, 3] == 2))
    assert joint == pytest.approx(p[0, 1] * p[3, 2], abs=0.03)


def test_the_policy_is_where_the_gradient_of_reward_plus_entropy_vanishes() -> None:
    """Two attributes that do not interact: the objective's gradient, by autodiff."""
    model = critic.make_critic(ALONE)
    rng = np.random.default_rng(0)
    actions = rng.integers(0, ALONE.bins, (30, 2)).astype(np.int32)
    rewards = 0.3 * actions[:, 0] - 0.1 * (actions[:, 1] - 3) ** 2 + 0.3 * rng.normal(size=30)

    @jax.jit
    def fitted(actions: jax.Array, rewards: jax.Array) -> Posterior:
        return critic.posterior(
            model, critic.observe(model, critic.init_critic(model), actions, rewards)
        )

    belief = fitted(jnp.asarray(actions), jnp.asarray(rewards, jnp.float32))
    start = jnp.zeros(2, jnp.int32)
    followed = jax.jit(lambda tau: follow(model, belief, start, tau), static_argnums=0)
    logits = np.asarray(followed(1.0))
    q = np.asarray(critic.mean_model(model, belief).alone)
    for attribute, count in enumerate(ALONE.bins):
        own, table = logits[attribute, :count], q[attribute, :count]
        tau = np.ptp(table) / np.ptp(own)

        def objective(free: jax.Array, table: np.ndarray = table, tau: float = tau) -> jax.Array:
            p = jax.nn.softmax(free)
            return p @ table - tau * p @ jnp.log(p)

        gradient = jax.grad(objective)(jnp.asarray(own))
        np.testing.assert_allclose(gradient, 0, atol=1e-5 * np.ptp(table))
    # The temperature divides.
    twice = np.asarray(followed(2.0))
    mask = bin_mask(ALONE)
    np.testing.assert_allclose(twice[mask], logits[mask] / 2, rtol=1e-4, atol=1e-5)
    assert np.all(np.isneginf(logits[~mask]))
