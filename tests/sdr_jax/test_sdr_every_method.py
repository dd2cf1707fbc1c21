"""Properties that every search method has, and the table of methods."""

from functools import cache, partial
from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sdr_jax
from benchmarks.rivals import METHODS, RIVALS, make
from sdr_jax import Method, MethodName, Proposal, make_step, relax, run, space
from sdr_jax.bins import bin_mask
from sdr_jax.registry import options_of

from .conftest import KEY, SEEDS, assert_close, assert_same, driven, refuses, run_updates, tell

# Numbers of bins that differ, two included; groups of one and of several; one without an order.
GROUPS = [["b", "a"], ["d"], ["c", "e"]]
SPACE = space(list("abcde"), bins=[3, 5, 2, 10, 7], groups=GROUPS, unordered=["a"])
TARGET = jnp.asarray([0.9, 0.1, 0.25, 0.65, 0.3])

# Not Adam for SDR, which makes whole steps of the rounding of gradients near zero.
SDR = sdr_jax.sdr(SPACE, learning_rate=optax.sgd(0.3), hidden=8, baseline=sdr_jax.leave_one_out())
ALL = {name: SDR if name == "sdr" else make(name, SPACE) for name in METHODS}
PURE = {name: method for name, method in ALL.items() if method.traced}
HOST = {name: method for name, method in ALL.items() if not method.traced}
DETERMINISTIC = ("attribute_descent", "random_attributes")
LEARNING = [name for name in ALL if name not in ("random_attributes", "sdr")]


def value(proposals: Proposal) -> jax.Array:
    """Minus the mean squared distance to the target over each interval, averaged."""
    target = jnp.broadcast_to(TARGET, proposals.centre.shape)
    return -((proposals.centre - target) ** 2 + proposals.width**2 / 12).mean(axis=-1)


def reward(share: float):
    """A reward function of which a share is NaN, perhaps the first ones."""

    def reward_fn(rng_key: jax.Array, proposals: Proposal, actions: jax.Array) -> jax.Array:
        failed = jax.random.uniform(rng_key, proposals.centre.shape[:1]) < share
        return jnp.where(failed, jnp.nan, value(proposals))

    return reward_fn


@cache
def runner(name: str, updates: int, n: int):
    """Compiled once for any share of failures."""
    if name in HOST:
        return lambda key, share: driven(key, HOST[name], reward(share), updates, n)
    return jax.jit(lambda key, share: run(key, PURE[name], reward(share), updates, n))


BEST = float(value(relax(SPACE, jnp.floor(TARGET * jnp.asarray(SPACE.bins)).astype(int))))
RANDOM = float(value(Proposal(jnp.full(5, 0.5), jnp.ones(5))))


@pytest.mark.parametrize(("failing", "least"), [(0.0, 0.9), (1 / 3, 0.6)])
@pytest.mark.parametrize("name", LEARNING)
def test_it_finds_the_optimum_of_an_easy_problem(name: str, failing: float, least: float) -> None:
    for seed in range(2):
        state, _ = runner(name, 30 if name in HOST else 75, 4)(jax.random.key(seed), failing)
        reached = float(value(ALL[name].solution(state)))
        assert (reached - RANDOM) / (BEST - RANDOM) > least


@pytest.mark.parametrize("name", PURE)
def test_the_host_loop_keeps_the_record_of_run(name: str) -> None:
    _, record = runner(name, 75, 4)(jax.random.key(3), 0.0)  # compiled above
    _, other = driven(jax.random.key(3), PURE[name], reward(0), 5, 4)
    assert_close(other, jax.tree.map(lambda leaf: leaf[:5], record), rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("name", ALL)
def test_the_same_key_gives_the_same_bytes(name: str) -> None:
    first, second = (driven(jax.random.key(5), ALL[name], reward(0), 4, 3) for _ in range(2))
    if name in HOST:  # states are no arrays
        first, second = ((HOST[name].solution(state), record) for state, record in (first, second))
    for a, b in zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True):
        assert np.asarray(a).tobytes() == np.asarray(b).tobytes()


CLIPPED = optax.chain(optax.clip_by_global_norm(1.0), optax.sgd(0.1, 0.9))
SCHEDULED = optax.adamw(optax.linear_schedule(1e-2, 0.0, 3))
GROUP_BY_GROUP = [
    sdr_jax.sdr(SPACE, hidden=8, normalise=True, baseline=sdr_jax.ema(includes_current=True)),
    sdr_jax.sdr(SPACE, hidden=8, learning_rate=CLIPPED),
    sdr_jax.sdr(SPACE, hidden=8, learning_rate=SCHEDULED),
]


@pytest.mark.parametrize("method", [*PURE.values(), *GROUP_BY_GROUP])
@pytest.mark.parametrize("n", [2, 5])
def test_update_keeps_structure_shapes_and_dtypes(method: Method, n: int) -> None:
    state = jax.eval_shape(method.init, KEY)
    actions, proposals = jax.eval_shape(partial(method.sample, n=n), KEY, state)
    assert actions.shape == proposals.centre.shape == proposals.width.shape == (n, 5)
    rewards = jax.ShapeDtypeStruct((n,), jnp.float32)
    after, _ = jax.eval_shape(method.update, state, actions, rewards)
    assert jax.tree.structure(state) == jax.tree.structure(after)
    types = (jax.tree.map(lambda x: (x.shape, x.dtype, x.weak_type), s) for s in (state, after))
    assert next(types) == next(types)


@pytest.mark.parametrize("name", PURE)
def test_no_key_is_used_twice(name: str) -> None:
    # Groups of one shape, as JAX takes two selections from an array of keys for two uses of one.
    method = make(name, space(list("abcd"), bins=4, groups=[["a", "b"], ["c", "d"]]))
    with jax.debug_key_reuse(True):  # it looks while functions are traced
        state = jax.eval_shape(method.init, KEY)
        jax.eval_shape(make_step(method, reward_of_any, 4), KEY, state)


def reward_of_any(rng_key: jax.Array, proposals: Proposal, actions: jax.Array) -> jax.Array:
    return proposals.centre.sum(axis=1) + jax.random.normal(rng_key, proposals.centre.shape[:1])


@pytest.mark.parametrize("name", [name for name in PURE if name not in DETERMINISTIC])
def test_no_two_attributes_and_no_two_data_sets_share_random_numbers(name: str) -> None:
    """At first, attributes are sampled independently, and so are data sets: correlations are 0."""
    pair = space(["a", "b"], bins=8)
    method = sdr_jax.sdr(pair, hidden=8) if name == "sdr" else make(name, pair)
    _, proposals = method.sample(jax.random.key(3), method.init(KEY), 4000)
    sampled = slice(1, None, 2) if name == "intervals" else slice(None)  # others are the start
    a, b = np.asarray(proposals.centre)[sampled].T
    for first, second in ((a, b), (a[:-1], a[1:]), (b[:-1], b[1:])):
        assert abs(np.corrcoef(first, second)[0, 1]) < 0.08


def check_inside(proposal: Proposal, shape: tuple[int, ...]) -> None:
    centre, width = map(np.asarray, proposal)
    assert centre.shape == width.shape == shape
    assert np.all(centre - width / 2 >= -1e-6) and np.all(centre + width / 2 <= 1 + 1e-6)


def check_answers(method: Method, state: object) -> None:
    check_inside(method.solution(state), (5,))
    check_inside(method.diagnostics.spread(state), (5,))
    probabilities = np.asarray(method.diagnostics.probabilities(state))
    assert probabilities.shape == (5, 10) and np.all(probabilities >= 0)
    assert not np.any(probabilities[~bin_mask(SPACE)])
    np.testing.assert_allclose(probabilities.sum(axis=1), 1, rtol=1e-4)


@pytest.mark.parametrize("name", ALL)
@settings(max_examples=3)
@given(seed=SEEDS, scale=st.sampled_from([1e-3, 1.0, 1e3]))
def test_answers_stay_inside_whatever_the_rewards(name: str, seed: int, scale: float) -> None:
    method = ALL[name]
    rng = np.random.default_rng(seed)
    state = method.init(jax.random.key(seed))
    check_answers(method, state)  # before the first update
    for t in range(4):
        actions, proposals = method.sample(jax.random.fold_in(jax.random.key(seed), t), state, 4)
        check_inside(proposals, (4, 5))
        rewards = rng.normal(70, scale, 4)
        rewards[rng.uniform(size=4) < 0.3] = np.nan
        state, _ = tell(method, actions, rewards, state)
        check_answers(method, state)


@pytest.mark.parametrize("name", ALL)
@settings(max_examples=4)
@given(seed=SEEDS, failed=st.sets(st.integers(0, 4), max_size=3))
def test_an_update_with_failed_rewards_is_one_without_them(name, seed, failed) -> None:
    method, rng = ALL[name], np.random.default_rng(seed)
    # The second update has a penalty, below which rewards are clipped.
    penalty = np.asarray([-1e4, 0, 0, 0, 0])
    state = run_updates(method, lambda t, *_: rng.normal(0, 1, 5) + t * penalty, updates=2, n=5)
    actions, _ = method.sample(jax.random.key(seed), state, 5)
    finite = np.asarray([k not in failed for k in range(5)])
    rewards = np.where(finite, rng.normal(0, 1, 5), rng.choice([np.nan, np.inf, -np.inf], 5))
    with_failed, info = tell(method, actions, rewards, state)
    without, info_without = tell(method, actions[finite], rewards[finite], state)
    for answer in (method.solution, method.diagnostics.spread, method.diagnostics.probabilities):
        np.testing.assert_allclose(answer(with_failed), answer(without), atol=2e-4)
    assert info.reward_mean == pytest.approx(float(info_without.reward_mean), abs=1e-5)
    # The next proposals are the same, too, but for the turn of methods that propose two kinds in turn.
    if name in ("surrogate", "intervals"):
        history = without.evidence.history
        history = history._replace(evaluations=with_failed.evidence.history.evaluations)
        without = without._replace(evidence=without.evidence._replace(history=history))
    (a, _), (b, _) = (method.sample(jax.random.key(7), s, 2) for s in (with_failed, without))
    np.testing.assert_allclose(a, b, atol=2e-3)


@pytest.mark.parametrize("name", [name for name in ALL if name != "sdr"])  # its groups move on
def test_rewards_that_are_all_nan_decide_nothing(name: str) -> None:
    method = ALL[name]
    state = run_updates(method, lambda *_: [np.nan] * 4, updates=3, n=4)
    assert_same(method.solution(state), method.solution(method.init(KEY)))
    check_answers(method, state)


def test_the_table_has_every_method_by_its_name_and_random_attributes_stay_random() -> None:
    state, record = runner("random_attributes", 3, 2)(jax.random.key(0), 0.0)
    assert set(np.asarray(record.actions).ravel()) == {-1}
    np.testing.assert_array_equal(PURE["random_attributes"].solution(state), [[0.5] * 5, [1] * 5])
    assert tuple(sdr_jax.METHODS) == get_args(MethodName)
    assert all(callable(getattr(sdr_jax, name)) for name in sdr_jax.METHODS)
    assert "optimizer" not in options_of("sdr") and options_of("gaussian")["std"] == 1.5
    kinds = {type(v) for name in sdr_jax.METHODS for v in options_of(name).values()}
    assert kinds <= {int, float, str, bool, type(None)}


@pytest.mark.parametrize("name", METHODS)
def test_a_method_is_made_with_its_options(name: str) -> None:
    options = {} if name in RIVALS else options_of(name)
    method = make(name, SPACE, 0.2, **{k: v for k, v in options.items() if v is not None})
    _, proposals = method.sample(jax.random.key(1), method.init(jax.random.key(0)), 3)
    width = np.asarray(proposals.width)
    if name not in ("random_attributes", "intervals"):  # they relax nothing
        expected = np.tile([1 / 3, 0.2, 0.2, 0.2, 0.2], (3, 1))
        np.testing.assert_allclose(width[width < 1], expected[width < 1], rtol=1e-6)
        assert np.any(width < 1)
    a = np.asarray(proposals.centre)[:, 0][
        width[:, 0] < 1
    ]  # without an order, so no value in between
    assert set(np.round(3 * a - 0.5, 5)) <= {0, 1, 2}
    assert method.traced == (name not in RIVALS)


MODELS = [name for name, method in ALL.items() if method.diagnostics.predict is not None]


@pytest.mark.parametrize("name", MODELS)
def test_models_predict_rewards_and_their_own_errors(name: str) -> None:
    assert MODELS == ["surrogate", "intervals", "gaussian_process"]
    method = ALL[name]
    first = state = method.init(KEY)

    def evaluated(seed: int) -> tuple[jax.Array, jax.Array]:
        sample_key, noise_key = jax.random.split(jax.random.key(seed))
        actions, proposals = method.sample(sample_key, first, 60)
        return actions, value(proposals) + 0.03 * jax.random.normal(noise_key, (60,))

    actions, rewards = evaluated(1)
    assert np.all(np.isnan(np.stack(method.diagnostics.predict(state, actions))))
    for part in (slice(start, start + 10) for start in range(0, 60, 10)):
        state, _ = tell(method, actions[part], rewards[part], state)
    actions, rewards = evaluated(2)
    mean, std = map(np.asarray, method.diagnostics.predict(state, actions))
    assert np.corrcoef(mean, rewards)[0, 1] > 0.6
    assert 0.6 < np.std((rewards - mean) / std) < 1.4


BAD = {
    "surrogate": dict(temperature=[0.0, np.nan], degree=[0], pair_degree=[10]),
    "sdr": dict(
        updates_per_group=[0], unoptimised=["zero"], baseline=["none"], hidden=[0],
        learning_rate=[-1.0, 0.0, np.nan, 5000.0],
    ),
    "attribute_descent": dict(repeats=[0], unoptimised=["zero"]),
    "gaussian": dict(std=[0.0], learning_rate=[-1.0]),
    "cma_es": dict(sigma=[0.0], population=[1]),
    "tpe": dict(startup=[-1]),
    "gaussian_process": dict(startup=[0], candidates=[1]),
    "random_search": {},
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_options_are_refused(name: str) -> None:
    for option, values in {**BAD[name], "width": [2.0]}.items():
        for value in values:
            refuses(f"{option} is {value!r}", make, name, SPACE, **{option: value})


@pytest.mark.parametrize(("name", "options", "culprit"), [
    ("magic", {}, "unknown method 'magic'; choose from surrogate, sdr"),
    ("gaussian", dict(speed=1), "gaussian has no option 'speed'; its options: learning_rate"),
    ("random_search", dict(speed=1), "its options: none"),
    ("sdr", dict(baseline="none"), "must be one of ema, ema_current"),
    ("intervals", dict(caution=-1.0), "caution is -1"), ("intervals", dict(degree=0), "degree is 0"),
    ("intervals", dict(pair_degree=10), r"pair_degree is 10, but must lie in \[0, degree = 9\]"),
    ("intervals", dict(start=((0.5,), (1.0,))), "start has 1 attributes, not the 5"),
    ("intervals", dict(start=((0.1,) * 5, (1.0,) * 5)), r"an interval that is not in \[0, 1\]"),
])  # fmt: skip
def test_wrong_options_are_refused_by_name(name: str, options: dict, culprit: str) -> None:
    refuses(culprit, make, name, SPACE, **options)
