"""What every method keeps to, whatever its idea."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sdr_jax
from sdr_jax import Method, Proposal, drive, run, run_on_host, space
from sdr_jax.relaxation import bin_mask

# Numbers of bins that differ, two included; groups of one and of several.
SPACE = space(list("abcde"), bins=[3, 5, 2, 10, 7], groups=[["b", "a"], ["d"], ["c", "e"]])
TARGET = jnp.asarray([0.9, 0.1, 0.25, 0.65, 0.3])

PURE = {
    "random_attributes": sdr_jax.random_attributes(SPACE),
    "random_search": sdr_jax.random_search(SPACE),
    "actor_critic": sdr_jax.actor_critic(SPACE),
    "attribute_descent": sdr_jax.attribute_descent(SPACE),
    "gaussian": sdr_jax.gaussian(SPACE),
    "linear": sdr_jax.linear(SPACE),
    "pbil": sdr_jax.pbil(SPACE),
    # Not Adam, which makes whole steps of the rounding of gradients near zero.
    "sdr": sdr_jax.sdr(SPACE, optax.sgd(0.3), hidden=8, baseline=sdr_jax.leave_one_out()),
}
HOST = {"cma_es": sdr_jax.cma_es(SPACE), "tpe": sdr_jax.tpe(SPACE)}
ALL = PURE | HOST
LEARNING = [name for name in ALL if name not in ("random_attributes", "sdr")]


def value(proposals: Proposal) -> jax.Array:
    """Minus the mean squared distance to the target over each interval, averaged."""
    target = jnp.broadcast_to(TARGET, proposals.centre.shape)
    return -((proposals.centre - target) ** 2 + proposals.width**2 / 12).mean(axis=-1)


def easy(rng_key: jax.Array, proposals: Proposal) -> jax.Array:
    return value(proposals)


def hard_to_score(rng_key: jax.Array, proposals: Proposal) -> jax.Array:
    """Every third reward is NaN, the first ones included."""
    failed = jax.random.uniform(rng_key, (proposals.centre.shape[0],)) < 1 / 3
    return jnp.where(failed, jnp.nan, value(proposals))


@cache
def runner(name: str, reward: str, updates: int, n: int):
    fn = {"easy": easy, "hard_to_score": hard_to_score}[reward]
    if name in HOST:
        return lambda key: run_on_host(key, HOST[name], fn, updates, n)
    return jax.jit(lambda key: run(key, PURE[name], fn, updates, n))


BEST = float(
    value(
        Proposal(
            jnp.asarray(
                [(np.floor(t * k) + 0.5) / k for t, k in zip(TARGET, SPACE.bins, strict=True)],
                jnp.float32,
            ),
            jnp.asarray([1 / k for k in SPACE.bins], jnp.float32),
        )
    )
)
RANDOM = float(value(Proposal(jnp.full(5, 0.5), jnp.ones(5))))


@pytest.mark.parametrize("reward", ["easy", "hard_to_score"])
@pytest.mark.parametrize("name", LEARNING)
def test_it_finds_the_optimum_of_an_easy_problem(name: str, reward: str) -> None:
    for seed in range(2):
        updates = 30 if name in HOST else 75
        state, _ = runner(name, reward, updates, 4)(jax.random.key(seed))
        found = float(value(ALL[name].solution(state)))
        assert (found - RANDOM) / (BEST - RANDOM) > {"easy": 0.9, "hard_to_score": 0.6}[reward]


@pytest.mark.parametrize("name", PURE)
def test_the_host_loop_keeps_the_record_of_run(name: str) -> None:
    _, record = runner(name, "easy", 75, 4)(jax.random.key(3))  # compiled above
    _, other = run_on_host(jax.random.key(3), PURE[name], easy, 5, 4)
    if jnp.issubdtype(record.actions.dtype, jnp.integer):
        np.testing.assert_array_equal(other.actions, record.actions[:5])
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b[:5], rtol=1e-3, atol=1e-4), other, record
    )


@pytest.mark.parametrize("name", ALL)
def test_the_same_key_gives_the_same_bytes(name: str) -> None:
    first, second = (run_on_host(jax.random.key(5), ALL[name], easy, 4, 3) for _ in range(2))
    if name in HOST:  # states are no arrays
        first, second = ((HOST[name].solution(state), record) for state, record in (first, second))
    for a, b in zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True):
        assert np.asarray(a).tobytes() == np.asarray(b).tobytes()


GROUP_BY_GROUP = [
    sdr_jax.sdr(SPACE, hidden=8, normalise=True, baseline=sdr_jax.ema(includes_current=True)),
    sdr_jax.sdr(SPACE, optax.chain(optax.clip_by_global_norm(1.0), optax.sgd(0.1, 0.9)), hidden=8),
    sdr_jax.sdr(SPACE, optax.adamw(optax.linear_schedule(1e-2, 0.0, 3)), hidden=8),
]


@pytest.mark.parametrize("method", [*PURE.values(), *GROUP_BY_GROUP])
@pytest.mark.parametrize("n", [2, 5])
def test_update_keeps_structure_shapes_and_dtypes(method: Method, n: int) -> None:
    state = jax.eval_shape(method.init, jax.random.key(0))
    actions, proposals = jax.eval_shape(
        lambda key, state: method.sample(key, state, n), jax.random.key(0), state
    )
    assert actions.shape == proposals.centre.shape == proposals.width.shape == (n, 5)
    rewards = jax.ShapeDtypeStruct((n,), jnp.float32)
    next_state, _ = jax.eval_shape(method.update, state, actions, rewards)
    assert jax.tree.structure(state) == jax.tree.structure(next_state)
    for a, b in zip(jax.tree.leaves(state), jax.tree.leaves(next_state), strict=True):
        assert (a.shape, a.dtype, a.weak_type) == (b.shape, b.dtype, b.weak_type)


def check_answers(method: Method, state: object) -> None:
    for centre, width in (method.solution(state), method.spread(state)):
        assert centre.shape == width.shape == (5,)
        assert np.all(np.isfinite(centre)) and np.all(np.isfinite(width))
        assert np.all(centre - width / 2 >= -1e-6)
        assert np.all(centre + width / 2 <= 1 + 1e-6)
    probabilities = np.asarray(method.probabilities(state))
    assert probabilities.shape == (5, 10)
    assert np.all(probabilities >= 0)
    assert not np.any(probabilities[~bin_mask(SPACE)])
    np.testing.assert_allclose(probabilities.sum(axis=1), 1, rtol=1e-4)


@pytest.mark.parametrize("name", ALL)
@settings(max_examples=3)
@given(seed=st.integers(0, 2**32 - 1), scale=st.sampled_from([1e-3, 1.0, 1e3]))
def test_answers_stay_inside_whatever_the_rewards(name: str, seed: int, scale: float) -> None:
    method = ALL[name]
    rng = np.random.default_rng(seed)
    state = method.init(jax.random.key(seed))
    check_answers(method, state)  # before the first update
    for t in range(4):
        actions, proposals = method.sample(jax.random.fold_in(jax.random.key(seed), t), state, 4)
        assert np.all(proposals.centre - proposals.width / 2 >= -1e-6)
        assert np.all(proposals.centre + proposals.width / 2 <= 1 + 1e-6)
        rewards = rng.normal(70, scale, 4)
        rewards[rng.uniform(size=4) < 0.3] = np.nan
        state, _ = method.update(state, actions, jnp.asarray(rewards, jnp.float32))
        check_answers(method, state)


@pytest.mark.parametrize("name", ALL)
@settings(max_examples=4)
@given(seed=st.integers(0, 2**32 - 1), failed=st.sets(st.integers(0, 4), max_size=3))
def test_learning_with_failed_rewards_is_learning_from_the_others(name, seed, failed) -> None:
    method = ALL[name]
    rng = np.random.default_rng(seed)
    state = method.init(jax.random.key(seed))
    for t in range(2):
        actions, _ = method.sample(jax.random.key(t), state, 5)
        rewards = rng.normal(0, 1, 5).astype(np.float32)
        if t == 0:
            state, _ = method.update(state, actions, jnp.asarray(rewards))
    known = np.asarray([k not in failed for k in range(5)])
    holes = np.where(known, rewards, rng.choice([np.nan, np.inf])).astype(np.float32)
    left, info = method.update(state, actions, jnp.asarray(holes))
    right, alone = method.update(state, actions[known], jnp.asarray(rewards[known]))
    answers = [
        (method.solution(s), method.spread(s), method.probabilities(s)) for s in (left, right)
    ]
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=2e-4), *answers)
    assert info.reward_mean == pytest.approx(float(alone.reward_mean), abs=1e-5)
    # What it proposes next is the same, too.
    (a, _), (b, _) = (method.sample(jax.random.key(7), s, 2) for s in (left, right))
    np.testing.assert_allclose(a, b, atol=2e-3)


@pytest.mark.parametrize("name", [name for name in ALL if name != "sdr"])  # its groups move on
def test_rewards_that_are_all_nan_decide_nothing(name: str) -> None:
    method = ALL[name]
    state = method.init(jax.random.key(0))
    before = method.solution(state)
    for t in range(3):
        actions, _ = method.sample(jax.random.key(t), state, 4)
        state, _ = method.update(state, actions, jnp.full(4, jnp.nan))
    jax.tree.map(np.testing.assert_array_equal, method.solution(state), before)
    check_answers(method, state)


def test_random_attributes_stay_random() -> None:
    state, record = runner("random_attributes", "easy", 3, 2)(jax.random.key(0))
    assert set(np.asarray(record.actions).ravel()) == {-1}
    centre, width = PURE["random_attributes"].solution(state)
    np.testing.assert_array_equal(centre, 0.5)
    np.testing.assert_array_equal(width, 1)


def test_the_host_loop_must_know_how_many_updates() -> None:
    with pytest.raises(ValueError, match="how many"):
        drive(jax.random.key(0), PURE["random_search"], easy)
    with pytest.raises(ValueError, match="updates is 0"):
        run_on_host(jax.random.key(0), PURE["random_search"], easy, 0)
