"""The pool: its regression is the natural gradient, its steps stay in their bounds, noise moves it little."""

from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sdr_jax import Proposal, pool, space
from sdr_jax.models import regression
from sdr_jax.models.regression import Centred
from sdr_jax.pool import FLOOR, basis, counted, divergence, marginal, of_streets

from .conftest import KEY, SEEDS, learnt

FEW, MANY = space(list("ab"), 3), space([f"a{k}" for k in range(23)], 10)
WIDE = ((0.5,) * 23, (0.5,) * 23)
N = 300
NOISE = 0.5  # of a reward; more than streets differ in worth
METHODS = {"uniform": pool(MANY), "start": pool(MANY, start=WIDE)}


def nothing(size: int) -> Centred:
    zero = jnp.zeros(())
    return Centred(jnp.zeros((size, size)), jnp.zeros(size), zero, zero)


def test_regression_on_all_streets_gives_the_natural_gradient() -> None:
    """Each street as often as it is likely; the gradient and Fisher matrix by jax.grad."""
    times = np.asarray([[1, 2, 3], [3, 2, 1]])  # probabilities of the bins, in sixths
    table = jnp.asarray(basis(FEW))
    streets = np.asarray(list(product(range(3), repeat=2)))
    often = times[0][streets[:, 0]] * times[1][streets[:, 1]]
    score = np.random.default_rng(0).normal(size=len(streets)).astype(np.float32)

    x = of_streets(table, jnp.asarray(streets))
    rows = np.repeat(np.arange(len(streets)), often)
    data = counted(nothing(table.shape[-1]), x[rows], jnp.asarray(score)[rows])
    std = jnp.full(table.shape[-1], 30.0)  # next to no ridge
    found = regression.posterior(data, std, jnp.asarray(0.05))[0].mean

    def log_likely(theta: jax.Array) -> jax.Array:
        logits = jnp.log(jnp.asarray(times / 6.0)) + jnp.einsum("abf,f->ab", table, theta)
        own = jax.nn.log_softmax(logits)
        return own[0][streets[:, 0]] + own[1][streets[:, 1]]

    def expected(theta: jax.Array) -> jax.Array:
        return jnp.sum(jnp.exp(log_likely(theta)) * score)

    def fisher(theta: jax.Array) -> jax.Array:
        slopes = jax.jacobian(log_likely)(theta)
        return jnp.einsum("s,sf,sg->fg", jnp.exp(log_likely(theta)), slopes, slopes)

    zero = jnp.zeros(table.shape[-1])
    natural = np.linalg.solve(fisher(zero), jax.grad(expected)(zero))
    np.testing.assert_allclose(found, natural, atol=1e-5)


@pytest.mark.parametrize("name", METHODS)
def test_pure_noise_moves_the_policy_little(name: str) -> None:
    method, moved = METHODS[name], []
    for seed in range(20):
        keys = jax.random.split(jax.random.key(seed))
        state = method.init(keys[0])
        actions, _ = method.sample(keys[0], state, N)
        after, _ = method.update(state, actions, jax.random.normal(keys[1], (N,)))
        moved.append(float(divergence(method.policy(after), method.policy(state))))
    assert np.mean(moved) <= 0.1


@given(seed=SEEDS, sharp=st.floats(0, 100), bound=st.sampled_from([0.01, 0.1]))
@settings(max_examples=15, deadline=None)
def test_a_step_stays_within_its_bound_and_leaves_every_bin_a_share(
    seed: int, sharp: float, bound: float
) -> None:
    method = BOUNDED[bound]
    key = jax.random.key(seed)
    state = method.init(key)
    for t in range(3):
        actions, _ = method.sample(jax.random.fold_in(key, t), state, 64)
        rewards = (sharp * actions[:, 0] - actions[:, 1]).astype(jnp.float32)
        after, _ = method.update(state, actions, rewards)
        before, now = method.policy(state), method.policy(after)
        assert divergence(now, before) <= bound * UNEVEN.attributes * 1.001
        np.testing.assert_allclose(now.probabilities.sum(axis=2), 1, rtol=1e-5)
        np.testing.assert_allclose(now.shares.sum(), 1, rtol=1e-5)
        least = FLOOR / np.asarray(UNEVEN.bins)[None, :, None]
        there = np.arange(UNEVEN.max_bins)[None, None] < np.asarray(UNEVEN.bins)[None, :, None]
        assert np.all(np.where(there, now.probabilities >= 0.999 * least, now.probabilities == 0))
        state = after


UNEVEN = space(list("abc"), bins=[4, 2, 3], unordered=["c"])
START = ((0.125, 0.25, 0.5), (0.25, 0.5, 1.0))
BOUNDED = {bound: pool(UNEVEN, bound=bound, start=START) for bound in (0.01, 0.1)}


def searched(method, worth, rounds: int = 4):
    """The policy after rounds of streets of a worth."""

    def reward(t: int, actions: jax.Array, proposals: Proposal) -> jax.Array:
        noise = jax.random.normal(jax.random.key(t + rounds), (N,))
        return worth(proposals.centre) + NOISE * noise

    return learnt(method, reward, rounds, N)


@pytest.mark.parametrize("name", METHODS)
def test_it_goes_where_streets_are_worth_more(name: str) -> None:
    best = jnp.asarray([0.85] * 4 + [0.5] * 4)

    def worth(centre: jax.Array) -> jax.Array:
        return -((centre[:, :8] - best[None]) ** 2).sum(axis=1)

    method = METHODS[name]
    first, last = method.init(KEY), searched(method, worth)
    middle = jnp.asarray((np.arange(10) + 0.5) / 10)
    means = [marginal(method.policy(state)) @ middle for state in (first, last)]
    assert np.all(means[1][:4] > means[0][:4] + 0.1)
    narrow = method.solution(last).width[4:8]
    assert np.all(narrow < method.solution(first).width[4:8] - 0.1)


@pytest.mark.parametrize(("better", "share"), [(True, 0.7), (False, 0.3)])
def test_the_better_component_gets_the_streets(better: bool, share: float) -> None:
    """Streets in the start's intervals are worth more, or less, whatever else is in them."""

    def worth(centre: jax.Array) -> jax.Array:
        inside = (jnp.abs(centre - 0.5) < 0.3).mean(axis=1)
        return inside if better else -inside

    found = METHODS["start"].policy(searched(METHODS["start"], worth)).shares[1]
    assert found > share if better else found < share


def test_streets_come_from_components_in_their_shares() -> None:
    method = pool(FEW, start=((0.1, 0.1), (0.1, 0.1)))
    actions, _ = method.sample(KEY, method.init(KEY), 1000)
    low = (np.asarray(actions) == 0).all(axis=1)
    # Of the start's half: the floor is in it twice. Of the others a ninth.
    assert low.mean() == pytest.approx(0.5 * 0.935**2 + 0.5 / 9, abs=0.03)


def test_failed_rewards_are_left_out() -> None:
    method = METHODS["uniform"]
    state = method.init(KEY)
    actions, _ = method.sample(KEY, state, N)
    rewards = jnp.asarray(actions[:, 0], jnp.float32)
    some, _ = method.update(state, actions, rewards.at[50:].set(jnp.nan))
    alone, _ = method.update(state, actions[:50], rewards[:50])
    np.testing.assert_allclose(some.logits, alone.logits, rtol=1e-3, atol=1e-4)
    assert np.abs(some.logits - state.logits).max() > 0.1
    none, info = method.update(state, actions, rewards * jnp.nan)
    np.testing.assert_array_equal(none.logits, state.logits)
    assert np.isnan(info.reward_mean)


@pytest.mark.parametrize(
    ("options", "says"),
    [({"bound": 0.0}, "bound is 0.0"), ({"start": ((0.5,), (1.0,))}, "start has 1 attributes")],
)
def test_options_out_of_range(options: dict, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        pool(FEW, **options)
