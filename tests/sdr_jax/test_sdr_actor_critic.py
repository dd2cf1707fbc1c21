import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sdr_jax import Proposal, actor_critic, bins, critic, run, space
from sdr_jax.actor_critic import follow, stratified

SPACE = space(["a", "b", "c", "d"], bins=[3, 5, 2, 4], groups=[["b"], ["d", "a"], ["c"]])
ALONE = space(["a", "b"], bins=[3, 5], groups=[["a"], ["b"]])
STRATIFIED = jax.jit(lambda key, p: stratified(key, SPACE, p, 7))


def policy(seed: int) -> np.ndarray:
    p = np.random.default_rng(seed).uniform(0.02, 1, (4, 5)) * bins.mask(SPACE)
    return (p / p.sum(axis=1, keepdims=True)).astype(np.float32)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_strata_keep_to_the_policy(seed: int) -> None:
    p = policy(seed)
    actions = np.asarray(STRATIFIED(jax.random.key(seed), jnp.asarray(p)))
    counts = np.stack([(actions == k).sum(axis=0) for k in range(5)], axis=1)
    assert np.all(np.abs(counts - 7 * p) < 2)  # a stratum may be cut at either end of a bin
    assert not np.any(counts[~bins.mask(SPACE)])


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
    model = critic.critic(ALONE)
    rng = np.random.default_rng(0)
    actions = rng.integers(0, ALONE.bins, (30, 2)).astype(np.int32)
    rewards = 0.3 * actions[:, 0] - 0.1 * (actions[:, 1] - 3) ** 2 + 0.3 * rng.normal(size=30)
    state = critic.init(model)
    state = critic.observe(model, state, jnp.asarray(actions), jnp.asarray(rewards, jnp.float32))
    belief = critic.posterior(model, state)
    start = jnp.zeros(2, jnp.int32)
    logits = np.asarray(follow(model, belief, start, 1.0))
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
    twice = np.asarray(follow(model, belief, start, 2.0))
    mask = bins.mask(ALONE)
    np.testing.assert_allclose(twice[mask], logits[mask] / 2, rtol=1e-4, atol=1e-5)
    assert np.all(np.isneginf(logits[~mask]))


def test_an_effect_is_found_and_what_has_none_stays_wide() -> None:
    """Only b matters, and noise hides the rest."""
    method = actor_critic(SPACE)

    def reward(rng_key: jax.Array, proposals: Proposal) -> jax.Array:
        noise = 0.2 * jax.random.normal(rng_key, proposals.centre.shape[:1])
        return 70 - 4 * jnp.abs(proposals.centre[:, 1] - 0.7) + noise

    state, record = jax.jit(lambda key: run(key, method, reward, 20, 4))(jax.random.key(0))
    solution, spread = method.solution(state), method.spread(state)
    np.testing.assert_allclose(solution.centre[1], 0.7, atol=1e-6)
    np.testing.assert_allclose(spread.width[1], 0.2, atol=0.15)
    others = np.asarray([0, 2, 3])
    assert np.mean(np.asarray(spread.width)[others]) > 0.6
    entropy = np.asarray(record.info.entropy)
    assert entropy[0] == pytest.approx(np.log([3, 5, 2, 4]).sum(), rel=1e-5)
    assert entropy[-1] < entropy[0] - 1


def test_interactions_within_a_group_are_learnt() -> None:
    """Where d and a agree in sign it is good; neither matters alone."""
    method = actor_critic(SPACE)

    def reward(rng_key: jax.Array, proposals: Proposal) -> jax.Array:
        return (proposals.centre[:, 0] - 0.5) * (proposals.centre[:, 3] - 0.5)

    state, _ = jax.jit(lambda key: run(key, method, reward, 15, 4))(jax.random.key(1))
    centre = method.solution(state).centre
    assert float(reward(jax.random.key(0), Proposal(centre[None], centre[None]))[0]) > 0.12


@pytest.mark.parametrize(
    ("options", "culprit"),
    [
        (dict(temperature=0.0), "temperature is 0.0"),
        (dict(temperature=float("nan")), "temperature is nan"),
        (dict(degree=0), "degree is 0"),
        (dict(pair_degree=10), "pair_degree is 10"),
        (dict(width=2.0), "width is 2.0"),
    ],
)
def test_bad_options_are_refused(options: dict, culprit: str) -> None:
    with pytest.raises(ValueError, match=culprit):
        actor_critic(SPACE, **options)
