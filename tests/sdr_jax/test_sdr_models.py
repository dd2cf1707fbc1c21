"""The model of effects, its features, and the methods that follow a model of the reward."""

from functools import partial
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sdr_jax
from sdr_jax import Method, Proposal, space, surrogate
from sdr_jax.bins import bin_mask
from sdr_jax.models import effects, history, regression
from sdr_jax.models.choices import choices, integrated, runs
from sdr_jax.models.features import Features, evaluate, maximise, maximise_each
from sdr_jax.models.intervals import FIRST_REACH
from sdr_jax.models.surrogate import follow, stratified
from sdr_jax.registry import make

from .conftest import KEY, SEEDS, assert_close, assert_same, driven, refuses, run_updates, tell

SPACE = space(["a", "b", "c", "d"], bins=[3, 5, 2, 4], groups=[["b"], ["d", "a"], ["c"]])
EVERY = np.asarray(list(product(range(3), range(5), range(2), range(4))), np.int32)
MODEL = effects.make_effects(SPACE, 3, 2)
LAYOUT = MODEL.layout
SURROGATE = surrogate(SPACE)

BEST_OF = jax.jit(lambda key, weights: maximise(key, SPACE, LAYOUT, weights))
WAYS = effects.observe, effects.posterior, effects.best_bins, effects.mean_model, effects.values
OBSERVE, POSTERIOR, BEST, MEAN, VALUES = (jax.jit(partial(way, MODEL)) for way in WAYS)
STRATIFIED = jax.jit(lambda key, p: stratified(key, SPACE, p, 7))


def some(seed: int, n: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """Random data sets and rewards: a and d agree or not, b is best in the middle."""
    rng = np.random.default_rng(seed)
    actions = rng.integers(0, SPACE.bins, (n, 4)).astype(np.int32)
    a, b, _, d = ((actions + 0.5) / SPACE.bins).T
    rewards = 3 * (a - 0.5) * (d - 0.5) - (b - 0.5) ** 2 + 0.05 * rng.normal(size=n)
    return actions, (40 + rewards).astype(np.float32)


def observed(updates: int) -> effects.EffectsState:
    state = effects.init_effects(MODEL)
    for seed in range(updates):
        state = OBSERVE(state, *some(seed))
    return state


def fit(model: effects.Effects, actions: np.ndarray, rewards: np.ndarray) -> regression.Posterior:
    observe, posterior = (jax.jit(partial(way, model)) for way in WAYS[:2])
    return posterior(observe(effects.init_effects(model), np.int32(actions), np.float32(rewards)))


def ridge(x: np.ndarray, y: np.ndarray, noise: float, prior: np.ndarray) -> tuple:
    """Mean and covariance (X'X / noise + D^-1)^-1 of the weights, in double precision."""
    covariance = np.linalg.inv(x.T @ x / noise + np.diag(1 / prior))
    return covariance @ x.T @ y / noise, covariance


def centred(actions: np.ndarray, rewards: np.ndarray, prior: np.ndarray) -> tuple:
    """The features that exist, and the rewards, minus their means."""
    x, y = columns(actions)[:, prior > 0], rewards.astype(np.float64)
    return x - x.mean(axis=0), y - y.mean()


def random_policy(seed: int) -> np.ndarray:
    p = np.random.default_rng(seed).uniform(0.02, 1, (4, 5)) * bin_mask(SPACE)
    return (p / p.sum(axis=1, keepdims=True)).astype(np.float32)


def evaluated(layout: Features, actions: np.ndarray) -> np.ndarray:
    return np.asarray(evaluate(layout, jnp.asarray(actions)), np.float64)


def columns(actions: np.ndarray) -> np.ndarray:
    x = evaluated(MODEL.layout, actions)
    return np.concatenate([x, x[:, [1, 4, 7, 10]] @ np.asarray([[1], [1], [0], [1]])], axis=1)


def test_features_by_hand() -> None:
    assert LAYOUT.pairs.tolist() == [[3, 0]]
    x = evaluated(LAYOUT, [[0, 2, 1, 3]])[0]
    assert x.shape == LAYOUT.variance.shape == (4 * 3 + 4,)
    a = np.sqrt(2) * np.cos(np.pi / 6 * np.asarray([1, 2]))
    d = np.sqrt(2) * np.cos(np.pi * 7 / 8 * np.asarray([1, 2, 3]))
    np.testing.assert_allclose(x[:3], [*a, 0], atol=1e-6)  # three bins have two cosines
    np.testing.assert_allclose(x[6:9], [-1, 0, 0], atol=1e-6)  # two bins have one
    np.testing.assert_allclose(x[9:], [*d, *np.outer(d[:2], a).ravel()], atol=1e-6)
    np.testing.assert_allclose(LAYOUT.variance[:3], [1, 1 / 4, 0])
    np.testing.assert_allclose(LAYOUT.variance[12:], np.outer([1, 1 / 4], [1, 1 / 4]).ravel())
    # Over the bins they have mean zero and are orthogonal.
    x = evaluated(LAYOUT, EVERY)
    np.testing.assert_allclose(x.mean(axis=0), 0, atol=1e-6)
    np.testing.assert_allclose(x.T @ x / len(x), np.diag(LAYOUT.variance > 0), atol=1e-5)


@settings(max_examples=10)
@given(seed=SEEDS)
def test_the_best_bins_are_those_of_enumeration(seed: int) -> None:
    normal = np.random.default_rng(seed).normal(size=len(LAYOUT.variance))
    weights = (normal * np.sqrt(LAYOUT.variance)).astype(np.float32)
    best = BEST_OF(jax.random.key(seed), weights)
    reached = evaluated(LAYOUT, best[None, :])[0] @ weights
    assert reached == pytest.approx((evaluated(LAYOUT, EVERY) @ weights).max(), abs=1e-4)


def test_interactions_are_as_fine_as_their_number_allows() -> None:
    assert MODEL.effect.tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 4, 5]
    np.testing.assert_allclose(np.bincount(MODEL.effect, weights=MODEL.variance)[:5], 1, rtol=1e-6)
    # Two bins have no second cosine to share.
    assert np.flatnonzero(MODEL.shared[:, 0]).tolist() == [1, 4, 10]
    for n, size, expected in ((39, 3, 0), (23, 3, 1), (8, 10, 3), (4, 4, 3), (8, 2, 1), (3, 10, 9)):
        names = [f"x{i}" for i in range(n)]
        assert effects.make_effects(space(names, bins=size)).layout.pair_degree == expected
        apart = space(names, bins=size, groups=[[name] for name in names])
        assert len(effects.make_effects(apart).layout.pairs) == 0


def test_the_posterior_is_that_of_the_textbook() -> None:
    state = observed(1)
    belief = POSTERIOR(state)
    prior = MODEL.variance * np.asarray(state.scales)[MODEL.effect]
    exists, data = prior > 0, centred(*some(0), prior)
    mean, covariance = ridge(*data, float(state.noise), prior[exists])
    np.testing.assert_allclose(np.asarray(belief.mean)[exists], mean, atol=1e-3)
    draws = np.asarray(regression.draw(KEY, belief, 20_000))[:, exists]
    np.testing.assert_allclose(np.cov(draws.T), covariance, atol=0.05 * np.diag(covariance).max())


def test_a_step_towards_the_evidence_by_hand() -> None:
    """Of expectation maximisation, in double precision: the posterior's spread counts, and kinds pull."""
    state, exists = observed(1), MODEL.variance > 0
    x, y = centred(*some(0), MODEL.variance)
    variance = y @ y / 15
    # Four attributes, a pair, shared.
    first = 0.7 * variance * np.asarray([*[0.7 / 4] * 4, 0.3, 0.7 / 4])
    prior = (MODEL.variance * first[MODEL.effect])[exists]
    mean, covariance = ridge(x, y, 0.3 * variance, prior)
    squares = (mean**2 + np.diag(covariance)) / MODEL.variance[exists]
    of = MODEL.effect[exists]
    kind = squares[of < 4].mean(), squares[of == 4].mean()
    scales = [(squares[of == k].sum() + 4 * kind[k == 4]) / (np.sum(of == k) + 4) for k in range(5)]
    np.testing.assert_allclose(state.scales, [*scales, kind[0]], rtol=2e-3)
    left = np.sum((y - x @ mean) ** 2) + np.trace(x @ covariance @ x.T)
    noise = (left + 4 * 0.3 * variance) / (15 + 4)
    assert float(state.noise) == pytest.approx(noise, rel=2e-3)


def test_failed_rewards_make_no_difference_and_more_explain_more_until_the_noise_is_left() -> None:
    (actions, rewards), start = some(1), effects.init_effects(MODEL)
    once = OBSERVE(start, actions, rewards)
    finite = np.arange(16) % 3 != 0
    with_holes = OBSERVE(start, actions, np.where(finite, rewards, np.nan).astype(np.float32))
    without = OBSERVE(start, actions[finite], rewards[finite])
    assert (with_holes.history.evaluations, without.history.evaluations) == (16, finite.sum())
    history = without.history._replace(evaluations=with_holes.history.evaluations)
    assert_close(with_holes, without._replace(history=history), rtol=1e-3, atol=1e-4)
    assert_same(OBSERVE(once, actions, jnp.full(16, jnp.nan)).statistics, once.statistics)
    state = observed(12)
    assert float(jnp.sqrt(state.noise)) == pytest.approx(0.05, rel=0.4)
    _, b, c, _, pair, _ = np.asarray(state.scales)
    assert pair > 3 * c and b > 1.5 * c  # c does not matter, the pair does, and b, less


@settings(max_examples=10)
@given(seed=SEEDS)
def test_expectations_under_a_policy_are_those_of_enumeration(seed: int) -> None:
    size = len(MODEL.effect)
    weights = np.random.default_rng(seed).normal(size=size).astype(np.float32)
    belief = regression.Posterior(jnp.asarray(weights), jnp.eye(size), jnp.zeros(size))
    policy = random_policy(seed)
    q = np.asarray(VALUES(MEAN(belief), policy))
    exists = np.append(MODEL.variance[:-1] > 0, True)
    every = columns(EVERY)[:, exists] @ weights[exists]
    chances = policy[np.arange(4)[None, :], EVERY]
    for k, count in enumerate(SPACE.bins):
        weighted = np.delete(chances, k, axis=1).prod(axis=1) * every
        exact = np.bincount(EVERY[:, k], weights=weighted)
        np.testing.assert_allclose(q[k, :count] - q[k, 0], exact - exact[0], atol=1e-3)


def test_the_expected_reward_and_its_spread_are_those_of_the_weights_posterior() -> None:
    state, actions = observed(12), jnp.asarray(EVERY[:7])
    belief = effects.posterior(MODEL, state)
    mean, std = effects.predict(MODEL, state, belief, actions)
    centre, covariance = state.statistics.mean, np.asarray(regression.covariance(belief))
    count = float(state.statistics.evaluations)
    off = columns(EVERY[:7]) - np.asarray(centre)
    # Of the weights, the mean of so many rewards, and the noise of one.
    variance = np.einsum("nf,fg,ng->n", off, covariance, off) + float(state.noise) * (1 + 1 / count)
    np.testing.assert_allclose(std, np.sqrt(variance), rtol=1e-3)
    one = [effects.value(MODEL, state, belief, row) for row in actions]
    np.testing.assert_allclose(mean, one, rtol=1e-5)
    nothing = effects.init_effects(MODEL)
    blank = effects.predict(MODEL, nothing, effects.posterior(MODEL, nothing), actions)
    assert np.isnan(blank).all()


def test_the_best_of_drawn_models_spread_as_the_posterior_does() -> None:
    belief = POSTERIOR(observed(3))

    @jax.jit
    def best_of_draws(belief):
        weights = effects.draw_weights(jax.random.key(0), MODEL, belief, 200)
        return maximise_each(jax.random.key(0), SPACE, MODEL.layout, weights)

    a, _, _, d = np.asarray(best_of_draws(belief)).T
    assert np.mean((a >= 1) == (d >= 2)) > 0.9  # they go together, at either end
    same = np.asarray(best_of_draws(belief._replace(scale=jnp.zeros_like(belief.scale))))
    np.testing.assert_array_equal(same, np.tile(BEST(belief), (200, 1)))


def test_strata_keep_to_the_policy_and_every_action_is_drawn_from_it() -> None:
    p = random_policy(3)
    samples = np.asarray(jax.vmap(lambda key: STRATIFIED(key, p))(jax.random.split(KEY, 4000)))
    counts = np.stack([(samples == k).sum(axis=1) for k in range(5)], axis=2)
    assert np.all(np.abs(counts - 7 * p) < 2)  # a stratum may be cut at either end of a bin
    assert not np.any(counts[:, ~bin_mask(SPACE)])
    first = samples[:, 0]
    shares = np.stack([(first == k).mean(axis=0) for k in range(5)], axis=1)
    np.testing.assert_allclose(shares, p, atol=0.03)
    # Attributes are independent: joint shares are products.
    joint = np.mean((first[:, 0] == 1) & (first[:, 3] == 2))
    assert joint == pytest.approx(p[0, 1] * p[3, 2], abs=0.03)


def test_the_policy_is_where_the_gradient_of_reward_plus_entropy_vanishes() -> None:
    """Two attributes that do not interact: the objective's gradient, by autodiff."""
    alone = space(["a", "b"], bins=[3, 5], groups=[["a"], ["b"]])
    model, rng = effects.make_effects(alone), np.random.default_rng(0)
    actions = rng.integers(0, alone.bins, (30, 2))
    rewards = 0.3 * actions[:, 0] - 0.1 * (actions[:, 1] - 3) ** 2 + 0.3 * rng.normal(size=30)
    belief = fit(model, actions, rewards)
    start, mask = jnp.zeros(2, jnp.int32), bin_mask(alone)
    followed = jax.jit(lambda tau: follow(model, belief, start, tau), static_argnums=0)
    logits, twice = (np.asarray(followed(tau)) for tau in (1.0, 2.0))

    def objective(free: jax.Array, table: np.ndarray, tau: float) -> jax.Array:
        p = jax.nn.softmax(free)
        return p @ table - tau * p @ jnp.log(p)

    q = np.asarray(effects.mean_model(model, belief).main)
    for row, table, count in zip(logits, q, alone.bins, strict=True):
        row, table = row[:count], table[:count]
        gradient = jax.grad(objective)(jnp.asarray(row), table, np.ptp(table) / np.ptp(row))
        np.testing.assert_allclose(gradient, 0, atol=1e-5 * np.ptp(table))
    # The temperature divides.
    np.testing.assert_allclose(twice[mask], logits[mask] / 2, rtol=1e-4, atol=1e-5)
    assert np.all(np.isneginf(logits[~mask]))


def test_the_temperature_is_the_posteriors_spread_of_the_bins() -> None:
    """The policy of an attribute by itself is softmax(Q / tau), tau from the covariance in closed form."""
    alone = space(["a"], bins=6)
    model, rng = effects.make_effects(alone), np.random.default_rng(1)
    actions = rng.integers(0, 6, (12, 1)).astype(np.int32)
    rewards = 0.1 * actions[:, 0] + 0.5 * rng.normal(size=12)
    state, _ = tell(surrogate(alone), actions, rewards)
    belief = fit(model, actions, rewards)
    x = evaluated(model.layout, np.arange(6)[:, None])
    basis = np.concatenate([x, x @ model.shared], axis=1)
    basis -= basis.mean(axis=0)
    covariance = np.asarray(regression.covariance(belief), np.float64)
    tau = np.sqrt(np.mean(np.einsum("kf,fg,kg->k", basis, covariance, basis)))
    q, logits = basis @ np.asarray(belief.mean), np.asarray(state.logits)[0]
    assert np.ptp(q) / np.ptp(logits) == pytest.approx(tau, rel=0.35)  # of 32 draws
    assert np.argmax(logits) == np.argmax(q)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_every_second_data_set_is_a_thompson_draw_whatever_the_updates_hold(n: int) -> None:
    """a and d go together, at either end: the policy is at one, draws of the model at both."""
    method = SURROGATE
    state = method.init(KEY)
    for seed in range(3):
        state, _ = tell(method, *some(seed), state)
    ends: tuple[list[bool], ...] = [], []
    for parity in range(2):
        history = state.evidence.history._replace(evaluations=jnp.int32(48 + parity))
        later = state._replace(evidence=state.evidence._replace(history=history))
        for key in range(60 // n):
            actions, _ = method.sample(jax.random.key(key), later, n)
            for k, a in enumerate(np.asarray(actions)[:, 0]):
                ends[(parity + k) % 2].append(a >= 1)
    policy, thompson = map(np.mean, ends)
    assert abs(policy - 0.5) > 0.4 and 0.1 < thompson < 0.9


def test_an_effect_is_found_and_what_has_none_stays_wide() -> None:
    """Only b matters, and noise hides the rest."""

    def reward(rng_key: jax.Array, proposals: Proposal, actions: jax.Array) -> jax.Array:
        noise = 0.2 * jax.random.normal(rng_key, proposals.centre.shape[:1])
        return 70 - 4 * jnp.abs(proposals.centre[:, 1] - 0.7) + noise

    state, record = driven(KEY, SURROGATE, reward, 20, 4)
    np.testing.assert_allclose(SURROGATE.solution(state).centre[1], 0.7, atol=1e-6)
    a, b, c, d = np.asarray(SURROGATE.diagnostics.spread(state).width)
    assert b == pytest.approx(0.2, abs=0.15) and np.mean([a, c, d]) > 0.6
    entropy = np.asarray(record.info.entropy)
    assert entropy[0] == pytest.approx(np.log([3, 5, 2, 4]).sum(), rel=1e-5)
    assert entropy[-1] < entropy[0] - 1


def test_interactions_within_a_group_are_found() -> None:
    """Where d and a agree in sign it is good; neither matters alone."""
    both = lambda _, proposals, actions: (proposals.centre[:, [0, 3]] - 0.5).prod(axis=1)  # noqa: E731
    state, _ = driven(jax.random.key(1), SURROGATE, both, 15, 4)
    a, _, _, d = SURROGATE.solution(state).centre
    assert (a - 0.5) * (d - 0.5) > 0.12


PAIR = sdr_jax.space(["a", "b"], [8, 8])
START = ((0.5, 0.3), (1.0, 0.2))


def test_runs_of_bins_by_hand():
    centre, width = runs(10)
    assert [np.isclose(width, k / 10).sum() for k in (10, 8, 4, 2, 1)] == [1, 2, 4, 9, 10]
    np.testing.assert_allclose(centre[np.isclose(width, 0.4)], [0.2, 0.4, 0.6, 0.8])
    np.testing.assert_allclose(runs(2), [[0.5, 0.25, 0.75], [1, 0.5, 0.5]])
    np.testing.assert_allclose(runs(3, in_order=False)[1], [1, *[1 / 3] * 3])


@given(st.lists(st.integers(2, 12), min_size=1, max_size=4), st.integers(0, 99))
def test_choices_differ_and_hold_the_start_once(bins, seed):
    rng = np.random.default_rng(seed)
    names = [f"x{k}" for k in range(len(bins))]
    width = rng.choice([0.2, 1.0], len(bins))
    start = rng.uniform(width / 2, 1 - width / 2), width
    chosen = choices(space(names, bins, unordered=names[1:]), start)
    intervals = [part[np.arange(len(bins)), chosen.start] for part in (chosen.centre, chosen.width)]
    np.testing.assert_allclose(intervals, start, atol=1e-5)
    for centre, width, count in zip(chosen.centre, chosen.width, chosen.space.bins, strict=True):
        centre, width = centre[:count], width[:count]
        assert len(np.unique(np.stack([centre, width]).round(5), axis=1).T) == count
        assert (centre[0], width[0]) == (0.5, 1)
        assert np.all(centre - width / 2 > -1e-6) and np.all(centre + width / 2 < 1 + 1e-6)


@given(st.lists(st.integers(2, 12), min_size=2, max_size=4), st.integers(0, 99))
def test_without_relaxation_choices_are_single_values(bins, seed):
    rng = np.random.default_rng(seed)
    names = [f"x{k}" for k in range(len(bins))]
    start = rng.uniform(0.1, 0.9, len(bins)).astype(np.float32), np.full(len(bins), 0.2, np.float32)
    chosen = choices(space(names, bins, unordered=names[1:2]), start, 0.0)
    for k, (width, count) in enumerate(zip(chosen.width, chosen.space.bins, strict=True)):
        np.testing.assert_allclose(width[:count], 1 / bins[k] if k == 1 else 0)
        centres = chosen.centre[k, :count]
        np.testing.assert_allclose(centres[: bins[k]], (np.arange(bins[k]) + 0.5) / bins[k])
        assert len(np.unique(centres.round(5))) == count
    centre = chosen.centre[np.arange(len(bins)), chosen.start]
    np.testing.assert_allclose(np.delete(centre, 1), np.delete(start[0], 1), atol=1e-6)
    assert chosen.space.bins[1] == bins[1] and abs(centre[1] - start[0][1]) <= 0.5 / bins[1] + 1e-6


@given(st.floats(0, 1), st.floats(0.01, 1))
def test_features_of_an_interval_are_means_over_it(place, width):
    low = place * (1 - width)
    x = low + width * (np.arange(4000) + 0.5) / 4000
    features = np.asarray(integrated(low + width / 2, width, 5))
    cosines = np.sqrt(2) * np.cos(np.pi * np.arange(1, 6)[:, None] * x).mean(axis=1)
    np.testing.assert_allclose(features[:5], cosines, atol=1e-4)
    assert features[5] == pytest.approx(-np.log2(max(width, 1 / 16)) / 4, abs=1e-5)


def searched(method, value, noise=0.0):
    """The state after data sets whose rewards are ``value(centre, width)`` and noise."""
    rng = np.random.default_rng(0)

    def reward(t, actions, proposals):
        return value(*map(np.asarray, proposals)) + noise * rng.normal(size=8)

    return run_updates(method, reward, updates=12, n=8)


def test_an_attribute_stays_at_its_start_unless_a_move_helps():
    method = sdr_jax.registry.make("intervals", PAIR, start=START)
    _, first = method.sample(KEY, method.init(KEY), 4)
    np.testing.assert_allclose(first.centre[:2], [START[0], [0.5, 0.5]])  # and random attributes
    np.testing.assert_allclose(first.width[:2], [START[1], [1, 1]])
    # Only the first matters, and is best at its high end.
    state = searched(method, lambda centre, width: centre[:, 0], noise=0.05)
    centre, width = np.asarray(method.solution(state))
    assert centre[0] > 0.8 and width[0] <= 0.25
    for answer in (
        method.diagnostics.spread(state),
        method.solution(searched(method, lambda c, w: 0 * c[:, 0])),
    ):
        assert [float(part[1]) for part in answer] == pytest.approx([0.3, 0.2])
    # Noise alone moves nothing for certain.
    unsure = method.diagnostics.spread(searched(method, lambda c, w: 0 * c[:, 0], noise=1.0))
    np.testing.assert_allclose(np.stack(unsure), START, atol=1e-6)
    p = np.asarray(method.diagnostics.probabilities(state))
    assert p.shape == (2, 8) and p[0, 6:].sum() > 0.4
    # Narrow intervals lose where variety pays, and the second starts narrow.
    state = searched(method, lambda centre, width: width.sum(axis=1), noise=0.02)
    assert np.asarray(method.solution(state).width).min() >= 0.5


@pytest.mark.parametrize(("sign", "base"), [(-1, START), (1, ((0.5, 0.5), (1.0, 1.0)))])
@pytest.mark.parametrize("n", [3, 8])
def test_a_search_begins_at_the_better_of_its_start_and_random_attributes(sign, base, n):
    method = sdr_jax.registry.make("intervals", PAIR, start=START)
    proposed = []

    def reward(t, actions, proposals):
        proposed.append(proposals)
        rewards = sign * np.asarray(proposals.width[:, 1]) + 0.1 * np.arange(n)
        return np.where((t == 0) & (np.arange(n) == 1), np.nan, rewards)  # one failed

    state = run_updates(method, reward, updates=9 // n + 1, n=n)
    widths = np.concatenate([np.asarray(proposals.width) for proposals in proposed])
    np.testing.assert_allclose(np.unique(widths[:8, 1]), [0.2, 1.0], rtol=1e-6)
    assert len(np.unique(widths[8:], axis=0)) > 2 or n == 3
    _, *intervals, _, _ = choices(PAIR, tuple(np.asarray(START, np.float32)))
    answer = [np.asarray(part)[np.arange(2), np.asarray(state.base)] for part in intervals]
    np.testing.assert_allclose(answer, base)


@pytest.mark.parametrize("n", [1, 8])
def test_a_start_that_always_fails_is_no_answer(n):
    method = sdr_jax.registry.make("intervals", PAIR, start=START)

    def reward(t, actions, proposals):
        centre, width = map(np.asarray, proposals)
        fails = np.isclose(centre[:, 1], START[0][1]) & np.isclose(width[:, 1], START[1][1])
        return np.where(fails, np.nan, centre[:, 0])

    state = run_updates(method, reward, updates=24 // n, n=n)
    assert float(method.solution(state).width[1]) != pytest.approx(START[1][1])


def test_a_data_set_that_fails_is_not_proposed_again_and_again():
    """One attribute of two bins, one data set per update: the second bin fails."""
    method = sdr_jax.surrogate(sdr_jax.space(["a"], bins=2))
    proposed = []

    def reward(t, actions, proposals):
        proposed.append(int(actions[0, 0]))
        return np.where(actions[:, 0] == 1, np.nan, 0.1 * t)

    run_updates(method, reward, updates=20, n=1)
    assert 0 in proposed[-6:]


def test_without_relaxation_every_data_set_is_of_single_values():
    method = sdr_jax.registry.make("intervals", PAIR, 0.0, start=START)
    _, first = method.sample(KEY, method.init(KEY), 8)
    np.testing.assert_allclose(first.centre[::2], [START[0]] * 4)
    assert len(np.unique(first.centre[1::2])) > 2  # and anywhere, in turn
    state = searched(method, lambda centre, width: centre[:, 0] - 9 * width.sum(axis=1), noise=0.05)
    proposals = method.sample(KEY, state, 16)[1]
    for answer in (first, proposals, method.solution(state), method.diagnostics.spread(state)):
        assert (np.asarray(answer.width) == 0).all()
    assert method.solution(state).centre[0] > 0.8
    with pytest.raises(ValueError, match=r"width is 1.5, but must lie in \[0, 1\]"):
        sdr_jax.registry.make("intervals", PAIR, 1.5)


@pytest.mark.parametrize("width", [0.0, (0.0, 0.1)])
def test_single_values_without_a_start_are_none(width):
    method = sdr_jax.registry.make("intervals", PAIR, width)
    assert method.init(KEY).reach == 1  # as without a start, all attributes change
    with_start = sdr_jax.registry.make("intervals", PAIR, width, start=START)
    assert with_start.init(KEY).reach == FIRST_REACH
    random = sdr_jax.registry.make("intervals", PAIR, start=((0.5, 0.5), (1.0, 1.0)))
    assert random.init(KEY).reach == 1  # random attributes are no start


LOWEST = jax.jit(history.lowest)


def padded(*rewards: float) -> jax.Array:
    return jnp.asarray([*rewards, *[np.nan] * (150 - len(rewards))], jnp.float32)


@pytest.mark.parametrize(
    ("rewards", "lowest"),
    [
        # The quartiles of -1000 and 1 to 9 are 2.25 and 6.75, their median 4.5.
        ([*range(1, 10), -1000], 1),
        ([*range(1, 10), -17.9], -np.inf),  # 5 x 4.5 below it
        ([*range(1, 10), -18.1], 1),
        ([*range(1, 10), *[-1000] * 9], 1),  # a penalty counts once
        ([*range(1, 10), *range(-1006, -1000)], 1),  # more than a quarter are penalties that differ
        ([0, 0, 0, 1, 1, 0.5, -1e6, -1e6, -1e6, np.nan], 0),
        ([*range(1, 7), -1000], -np.inf),  # too few
        ([*range(0, 160, 5), *[200] * 5, *np.arange(200, 201, 0.01)], -np.inf),  # it has come near
        ([5.0] * 9, -np.inf), ([5.0] * 9 + [-1000], -np.inf),
        ([-1000, *[np.nan] * 9], -np.inf), ([np.nan] * 9, -np.inf),
    ],
)  # fmt: skip
def test_what_is_far_below_the_others_by_hand(rewards: list[float], lowest: float) -> None:
    assert float(LOWEST(padded(*rewards))) == lowest


def test_penalties_count_as_the_worst_of_the_others_from_the_beginning() -> None:
    """The same statistics as if those had been the rewards, even if penalties came first."""
    actions, rewards = some(0, 24)
    crashed = np.arange(24) % 4 == 0
    with_penalty = np.where(crashed, np.float32(-1e6), rewards)
    as_worst = np.where(crashed, rewards[~crashed].min(), rewards)
    state, expected = effects.init_effects(MODEL), effects.init_effects(MODEL)
    for part in np.split(np.arange(24), 6):
        state = OBSERVE(state, actions[part], with_penalty[part])
        expected = OBSERVE(expected, actions[part], as_worst[part])
    assert (int(state.history.clipped), int(expected.history.clipped)) == (6, 0)
    both = (s.statistics._replace(offset=0, level=0) for s in (state, expected))
    assert_close(*both, rtol=1e-4, atol=1e-3)
    assert_close(sum(state.statistics[-1:] + state.statistics[3:4]), as_worst.mean(), rtol=1e-4)
    assert float(state.noise) == pytest.approx(float(expected.noise), rel=1.0)
    # Were they no penalties, they would count as what they are.
    more = -np.linspace(1e6, 4e6, 24, dtype=np.float32)
    assert int(OBSERVE(state, actions, more).history.clipped) == 0


def test_evaluations_that_are_not_kept_count_too(monkeypatch) -> None:
    monkeypatch.setattr(history, "CAPACITY", 12)
    observe = jax.jit(lambda *arguments: effects.observe(MODEL, *arguments))
    state, (actions, rewards) = effects.init_effects(MODEL), some(0, 32)
    rewards[3], rewards[30] = -1e6, -1e6
    for part in np.split(np.arange(32), 4):
        state = observe(state, actions[part], rewards[part])
    assert state.history.rewards.shape == (12,) and int(state.history.clipped) == 1
    counted = np.maximum(rewards, rewards[:8][rewards[:8] > -1e6].min())
    square = float(state.statistics.square)
    assert square == pytest.approx(31 * counted.var(ddof=1), rel=1e-3)


BANDIT = space(["a", "b"], [4, 3])
BANDIT_METHODS = {name: make(name, BANDIT) for name in ("surrogate", "intervals")}


@pytest.mark.parametrize(("share", "penalty"), [(0, 0), (0.05, -1e6), (0.25, -1000), (0.45, -1e6)])
@pytest.mark.parametrize("name", BANDIT_METHODS)
def test_penalties_do_not_decide_the_answer(name: str, share: float, penalty: float) -> None:
    """A crash says nothing of where it happened; 0 is the best answer, random attributes are at -1."""
    method, best = BANDIT_METHODS[name], np.asarray([0.625, 1 / 6])

    def value(proposal: Proposal) -> np.ndarray:
        centre, width = map(np.asarray, proposal)
        errors = (centre - best) ** 2 + np.maximum(width**2 - [1 / 16, 1 / 9], 0) / 12
        return -errors.sum(axis=-1) / (0.125**2 + (1 / 3) ** 2 + (2 - 1 / 16 - 1 / 9) / 12)

    losses, clipped = [], []
    for seed in range(3):
        rng = np.random.default_rng(seed)

        def reward(t: int, actions: jax.Array, proposals: Proposal) -> np.ndarray:
            noisy = value(proposals) + 0.1 * rng.normal(size=10)  # noqa: B023
            return np.where(rng.random(10) < share, penalty, noisy)  # noqa: B023

        state = run_updates(method, reward, updates=20, n=10)
        losses.append(-value(method.solution(state)))
        clipped.append(int(state.evidence.history.clipped))
    assert np.mean(losses) < 0.25
    assert (min(clipped) > 0) == (share > 0)


@pytest.mark.parametrize("name", BANDIT_METHODS)
def test_a_flat_reward_decides_nothing_and_the_search_goes_on_looking(name: str) -> None:
    method = BANDIT_METHODS[name]
    state = run_updates(method, lambda *_: [0.1] * 10, updates=2, n=10)
    for answer in (method.solution(state), method.diagnostics.spread(state)):
        np.testing.assert_allclose(answer, [[0.5, 0.5], [1, 1]], rtol=1e-6)
    p = np.asarray(method.diagnostics.probabilities(state))
    assert np.all(p[bin_mask(BANDIT)] > 0.1)
    sampled = [method.sample(jax.random.key(seed), state, 10)[0] for seed in (8, 9)]
    assert len(np.unique(np.concatenate(sampled), axis=0)) > 5
    # One reward that differs is enough to prefer something.
    state, _ = tell(method, sampled[0], [0.2] + [np.nan] * 9, state)
    assert np.any(np.asarray(method.solution(state).width) < 1)


def test_interactions_are_only_as_many_as_fit() -> None:
    names = [f"x{i}" for i in range(100)]

    def columns(attributes: int) -> int:
        method = surrogate(space(names[:attributes], 10), degree=4)
        return jax.eval_shape(method.init, KEY).evidence.statistics.mean.shape[0]

    assert columns(100) == 1 + 400  # none of 4950 pairs in one group
    for name in BANDIT_METHODS:
        refuses("makes 19800 features of 4950 pairs", make, name, space(names, 10), pair_degree=2)
    assert columns(8) == 1 + 8 * 4 + 28 * 9


def test_values_without_an_order_have_no_neighbours() -> None:
    """One-hot features by another name: the prior's covariance is the same for any two of them."""
    apart = space(["a", "b"], [5, 4], unordered=["a"])
    layout = effects.make_effects(apart, 2, 1).layout
    prior = layout.basis[0] * layout.variance[:4] @ layout.basis[0].T
    np.testing.assert_allclose(prior, 5 * np.eye(5) - 1, atol=1e-4)
    np.testing.assert_allclose(layout.variance[4:8], [1, 1 / 4, 0, 0])  # the other has an order


def reached(method: Method, sign: int) -> tuple[float, np.ndarray, np.ndarray]:
    """The reach, and what data sets change and how wide, after better and better or worse updates."""
    rewards = [np.where(np.arange(8) % 2, -1.0, 1.0), 0.1, *(sign * k for k in (5, 10, 20, 40))]
    state = run_updates(method, lambda t, *_: np.broadcast_to(rewards[t], 8), updates=6, n=8)
    actions, proposals = method.sample(jax.random.key(99), state, 64)
    changed = np.asarray(actions) != np.asarray(state.answer)
    return float(state.reach), changed.mean(axis=1), np.asarray(proposals.width)[changed]


def test_the_reach_grows_with_success_and_shrinks_without():
    many = space([str(k) for k in range(24)], 8)
    method = make("intervals", many, start=((0.25,) * 24, (0.2,) * 24))
    (better, far, widths), (worse, near, _) = (reached(method, sign) for sign in (1, -1))
    assert better > 0.9 and far.mean() > 0.5
    assert worse < 0.1 and 0 < near.mean() < 0.2
    # Intervals of all widths are tried: 1, 2, 4 or 8 bins, or the start's own.
    assert min(np.isclose(widths, k).mean() for k in (1 / 8, 1 / 4, 1 / 2, 1)) > 0.05


NOISE_FREE = {
    "quadratic": lambda values, best: -np.sum((values - best) ** 2),
    "absolute": lambda values, best: -np.abs(values - best).sum(),
    "linear": lambda values, best: np.sign(best - 0.5) @ values,
}


def noise_free(name: str, attributes: int, n: int, reward: str, offset: float, total: int) -> tuple:
    """The search after so many noise-free rewards, and how near its answer comes to the best: 0 to 1."""
    bins, best = 10, np.random.default_rng(attributes).uniform(0.1, 0.9, attributes)
    attribute_space = space([str(k) for k in range(attributes)], bins)
    search = sdr_jax.AskTell(attribute_space, make(name, attribute_space, 0.0), n=n, seed=1)
    while len(search.history) < total:
        for trial in search.ask():
            values = np.asarray(trial.proposal.centre, float)
            search.tell(trial.id, offset + float(NOISE_FREE[reward](values, best)))
    centres = (np.arange(bins) + 0.5) / bins
    single = [[NOISE_FREE[reward](np.where(np.arange(attributes) == k, c, best), best) for c in centres]
              for k in range(attributes)]  # fmt: skip
    highest = NOISE_FREE[reward](centres[np.argmax(single, axis=1)], best)
    middling = np.mean([NOISE_FREE[reward](np.full(attributes, c), best) for c in centres])
    reached = NOISE_FREE[reward](np.asarray(search.solution().centre, float), best)
    return search, (reached - middling) / (highest - middling)


@pytest.mark.parametrize(
    ("name", "attributes", "n", "reward", "offset", "total"),
    [
        ("surrogate", 3, 8, "linear", 10, 1200),
        *(
            pytest.param(*case, 5000, marks=pytest.mark.slow)
            for case in [
                ("surrogate", 2, 4, "quadratic", 0),
                ("surrogate", 4, 8, "absolute", 10),
                ("surrogate", 8, 16, "linear", 100),
                ("surrogate", 4, 8, "quadratic", 0),
                ("intervals", 2, 16, "quadratic", 0),
                ("intervals", 4, 8, "absolute", 10),
                ("intervals", 8, 16, "linear", 100),
                ("intervals", 3, 4, "quadratic", 10),
            ]
        ),
    ],
)
def test_noise_free_rewards_end_finite_and_at_the_optimum(
    name: str, attributes: int, n: int, reward: str, offset: float, total: int
) -> None:
    search, reached = noise_free(name, attributes, n, reward, offset, total)
    parts = search.state.evidence.statistics, search.state.evidence.scales, search.state.belief
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(parts))
    assert reached > 0.98


def test_statistics_keep_their_digits_far_from_zero() -> None:
    """Merged update by update, they are those of double precision, although the spread is small."""
    rng = np.random.default_rng(0)
    x = (5 + 0.01 * rng.normal(size=(64, 3))).astype(np.float32)
    y = (100 + 0.01 * rng.normal(size=64)).astype(np.float32)
    y[5] = np.nan
    statistics = regression.empty(3)
    for part in np.split(np.arange(64), 8):
        statistics = regression.add(statistics, jnp.asarray(x[part]), jnp.asarray(y[part]))
    valid = np.isfinite(y)
    x_off, y_off = (np.float64(v[valid]) - np.float64(v[valid]).mean(axis=0) for v in (x, y))
    np.testing.assert_allclose(statistics.gram, x_off.T @ x_off, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(statistics.moment, x_off.T @ y_off, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(statistics.square, y_off @ y_off, rtol=1e-3)
    assert float(statistics.offset + statistics.level) == pytest.approx(np.nanmean(y), rel=1e-6)


def test_a_model_that_is_not_finite_says_so() -> None:
    state, _ = tell(SURROGATE, np.zeros((2, 4), np.int32), [0.0, 1.0])
    statistics = state.evidence.statistics
    broken = statistics._replace(gram=jnp.full_like(statistics.gram, jnp.nan))
    state = state._replace(evidence=state.evidence._replace(statistics=broken))
    _, info = tell(SURROGATE, np.ones((2, 4), np.int32), [0.0, 1.0], state)
    assert not info.finite
