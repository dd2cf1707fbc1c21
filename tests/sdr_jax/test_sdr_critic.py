from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sdr_jax import space
from sdr_jax.critic import critic, regression
from sdr_jax.critic.features import evaluate
from sdr_jax.relaxation import bin_mask

SPACE = space(["a", "b", "c", "d"], bins=[3, 5, 2, 4], groups=[["b"], ["d", "a"], ["c"]])
MODEL = critic.make_critic(SPACE, 3, 2)
EVERY = np.asarray(list(product(range(3), range(5), range(2), range(4))))
OBSERVE = jax.jit(lambda state, actions, rewards: critic.observe(MODEL, state, actions, rewards))
POSTERIOR = jax.jit(lambda state: critic.posterior(MODEL, state))
BEST = jax.jit(lambda belief: critic.best_bins(MODEL, belief))
DRAW_BEST = jax.jit(lambda key, belief: critic.draw_best(key, MODEL, belief, 200))
MEAN = jax.jit(lambda belief: critic.mean_model(MODEL, belief))
VALUES = jax.jit(lambda function, policy: critic.values(MODEL, function, policy))


def some(seed: int, n: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """Random data sets and rewards: a and d agree or not, b is best in the middle."""
    rng = np.random.default_rng(seed)
    actions = rng.integers(0, SPACE.bins, (n, 4)).astype(np.int32)
    a, b, _, d = ((actions + 0.5) / SPACE.bins).T
    rewards = 3 * (a - 0.5) * (d - 0.5) - (b - 0.5) ** 2 + 0.05 * rng.normal(size=n)
    return actions, (40 + rewards).astype(np.float32)


def columns(actions: np.ndarray) -> np.ndarray:
    x = np.asarray(evaluate(MODEL.layout, jnp.asarray(actions)), np.float64)
    return np.concatenate([x, x[:, [1, 4, 7, 10]] @ np.asarray([[1], [1], [0], [1]])], axis=1)


def test_the_layout_by_hand() -> None:
    assert MODEL.layout.pairs.tolist() == [[3, 0]]
    assert len(MODEL.effect) == 4 * 3 + 4 + 1
    assert MODEL.effect.tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 4, 5]
    np.testing.assert_allclose(np.bincount(MODEL.effect, weights=MODEL.variance)[:5], 1, rtol=1e-6)
    # Two bins have no second cosine to share.
    assert np.flatnonzero(MODEL.bend).tolist() == [1, 4, 10]


def test_the_posterior_is_that_of_the_textbook() -> None:
    """(X'X / noise + D^-1)^-1 X'y / noise, X centred, in double precision."""
    actions, rewards = some(0)
    state = OBSERVE(critic.init_critic(MODEL), jnp.asarray(actions), jnp.asarray(rewards))
    belief = POSTERIOR(state)
    x = columns(actions)
    x -= x.mean(axis=0)
    y = rewards.astype(np.float64) - rewards.mean()
    prior = MODEL.variance * np.asarray(state.scales)[MODEL.effect]
    there = prior > 0
    precision = x.T[there] @ x[:, there] / float(state.noise) + np.diag(1 / prior[there])
    mean = np.linalg.solve(precision, x.T[there] @ y / float(state.noise))
    np.testing.assert_allclose(np.asarray(belief.mean)[there], mean, atol=1e-3)
    draws = np.asarray(regression.draw(jax.random.key(0), belief, 20_000))[:, there]
    expected = np.linalg.inv(precision)
    np.testing.assert_allclose(np.cov(draws.T), expected, atol=0.05 * np.diag(expected).max())


def test_rewards_in_parts_and_failed_ones_make_no_difference_to_what_is_known() -> None:
    actions, rewards = some(1)
    once = OBSERVE(critic.init_critic(MODEL), jnp.asarray(actions), jnp.asarray(rewards))
    holes = np.where(np.arange(16) % 3 == 0, np.nan, rewards).astype(np.float32)
    kept = np.isfinite(holes)
    with_holes = OBSERVE(critic.init_critic(MODEL), jnp.asarray(actions), jnp.asarray(holes))
    alone = OBSERVE(
        critic.init_critic(MODEL), jnp.asarray(actions[kept]), jnp.asarray(rewards[kept])
    )
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-4), with_holes, alone
    )
    nothing = OBSERVE(once, jnp.asarray(actions), jnp.full(16, jnp.nan))
    jax.tree.map(np.testing.assert_array_equal, nothing.statistics, once.statistics)


def test_more_rewards_explain_more_until_the_noise_is_left() -> None:
    state = critic.init_critic(MODEL)
    for seed in range(12):
        actions, rewards = some(seed)
        state = OBSERVE(state, jnp.asarray(actions), jnp.asarray(rewards))
    assert float(jnp.sqrt(state.noise)) == pytest.approx(0.05, rel=0.4)
    scales = np.asarray(state.scales)
    assert scales[4] > 3 * scales[2]  # the pair matters, c does not
    assert scales[1] > 1.5 * scales[2]  # so does b, less


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_expectations_under_a_policy_are_those_of_enumeration(seed: int) -> None:
    rng = np.random.default_rng(seed)
    weights = rng.normal(size=len(MODEL.effect)).astype(np.float32)
    belief = regression.Posterior(
        jnp.asarray(weights), jnp.eye(len(weights)), jnp.zeros(len(weights))
    )
    function = MEAN(belief)
    policy = rng.uniform(size=(4, 5)) * bin_mask(SPACE)
    policy = (policy / policy.sum(axis=1, keepdims=True)).astype(np.float32)
    q = np.asarray(VALUES(function, jnp.asarray(policy)))
    there = np.append(MODEL.variance[:-1] > 0, True)
    every = columns(EVERY)[:, there] @ weights[there]
    chances = policy[np.arange(4)[None, :], EVERY]
    for attribute, count in enumerate(SPACE.bins):
        others = np.delete(chances, attribute, axis=1).prod(axis=1)
        exact = [np.sum((others * every)[EVERY[:, attribute] == k]) for k in range(count)]
        actual = q[attribute, :count]
        np.testing.assert_allclose(actual - actual[0], exact - exact[0], atol=1e-3)


def test_what_all_attributes_bend_is_learnt_before_each_one_is() -> None:
    """Twelve attributes, twenty noisy rewards: hardly any is known alone, yet all keep off the ends."""
    wide = space([f"x{i}" for i in range(12)], bins=10, groups=[[f"x{i}"] for i in range(12)])
    model = critic.make_critic(wide)
    rng = np.random.default_rng(0)
    actions = rng.integers(0, 10, (20, 12)).astype(np.int32)
    rewards = -(((actions + 0.5) / 10 - 0.5) ** 2).sum(axis=1) + 0.1 * rng.normal(size=20)

    @jax.jit
    def best_of(actions: jax.Array, rewards: jax.Array) -> jax.Array:
        state = critic.observe(model, critic.init_critic(model), actions, rewards)
        return critic.best_bins(model, critic.posterior(model, state))

    best = np.asarray(best_of(jnp.asarray(actions), jnp.asarray(rewards, jnp.float32)))
    assert np.mean((best == 0) | (best == 9)) < 0.2


def test_the_best_of_drawn_models_spread_as_the_posterior_does() -> None:
    state = critic.init_critic(MODEL)
    for seed in range(3):
        actions, rewards = some(seed)
        state = OBSERVE(state, jnp.asarray(actions), jnp.asarray(rewards))
    belief = POSTERIOR(state)
    drawn = np.asarray(DRAW_BEST(jax.random.key(0), belief))
    agree = (drawn[:, 0] >= 1) == (drawn[:, 3] >= 2)
    assert np.mean(agree) > 0.9  # a and d go together, at either end
    certain = belief._replace(scale=jnp.zeros_like(belief.scale))
    same = np.asarray(DRAW_BEST(jax.random.key(0), certain))
    np.testing.assert_array_equal(same, np.tile(BEST(belief), (200, 1)))


@pytest.mark.parametrize(
    ("attributes", "size", "expected"), [(23, 3, 1), (8, 10, 3), (4, 4, 3), (8, 2, 1), (3, 10, 9)]
)
def test_interactions_are_as_fine_as_their_number_allows(
    attributes: int, size: int, expected: int
) -> None:
    names = [f"x{i}" for i in range(attributes)]
    assert critic.make_critic(space(names, bins=size)).layout.pair_degree == expected
    apart = space(names, bins=size, groups=[[name] for name in names])
    assert len(critic.make_critic(apart).layout.pairs) == 0
