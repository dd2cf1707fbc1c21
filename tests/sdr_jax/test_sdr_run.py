"""The loop, in JAX and on the host, and its callback."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sdr_jax import (
    AskTell,
    DataSets,
    Method,
    Proposal,
    drive,
    first_state,
    host_reward,
    leave_one_out,
    make_step,
    random_search,
    relax,
    run,
    sdr,
    space,
)

from .conftest import KEY, assert_close, assert_same, refuses

TARGET = jnp.asarray([0.85, 0.15, 0.05, 0.85, 0.05])
FIVE = space(list("abcde"), bins=[10, 10, 10, 10, 4], groups=[["a", "b"], ["c", "d", "e"]])
PAIR = space(["a", "b"], bins=[3, 5], groups=[["a"], ["b"]])
METHOD = sdr(PAIR, updates_per_group=4, hidden=8)


def bandit(rng_key: jax.Array, proposals: Proposal, actions: jax.Array) -> jax.Array:
    noise = 0.01 * jax.random.normal(rng_key, (len(proposals.centre),))
    return 1 - jnp.abs(proposals.centre - TARGET[None, :]).mean(axis=1) + noise


def centres(method: Method, seeds: int, n: int, reward_fn: object = bandit) -> np.ndarray:
    """The centres of the answers for so many seeds, f32[seeds attributes]."""
    whole = jax.jit(lambda key: run(key, method, reward_fn, n=n)[0])
    states = [whole(jax.random.key(seed)) for seed in range(seeds)]
    return np.stack([method.solution(state).centre for state in states])


def test_the_whole_method_learns_under_one_jit() -> None:
    method = sdr(FIVE, baseline=leave_one_out(), normalise=True)
    actual = centres(method, 2, n=4)
    # Within a bin and a half of the optimum for every attribute and seed.
    assert np.abs(actual[:, :4] - TARGET[None, :4]).max() < 0.16
    assert np.abs(actual[:, 4] - 0.125).max() < 1e-6


# The nearer the building the better, but never in front of the tree.
TABLE = jnp.asarray([[0] * 4, [0.75, 0, 0, 0], [0.5, 0.5, 0, 0], [0.25, 0.25, 0.25, 0]])


@pytest.mark.parametrize(
    ("groups", "expected"), [([["building", "tree"]], 0.75), ([["building"], ["tree"]], 0.5)]
)
def test_correlated_attributes_need_a_common_group(groups: list, expected: float) -> None:
    pair = space(["building", "tree"], bins=4, groups=groups)
    method = sdr(pair, baseline=leave_one_out(), updates_per_group=80)

    def table(rng_key: jax.Array, proposals: Proposal, actions: jax.Array) -> jax.Array:
        # An undecided attribute is random: draw its bin.
        random = jax.random.uniform(rng_key, proposals.centre.shape)
        bins = 4 * (proposals.centre + (random - 0.5) * proposals.width)
        return TABLE[tuple(jnp.clip(bins.astype(int), 0, 3).T)]

    bins = (centres(method, 1, n=16, reward_fn=table)[0] * 4).astype(int)
    assert TABLE[tuple(bins)] == expected


class Evaluate:
    """Records its calls; one call raises an error."""

    def __init__(self, fail_at: int = -1, error: BaseException | None = None) -> None:
        self.calls: list[DataSets] = []
        self.fail_at, self.error = fail_at, error

    def __call__(self, data_sets: DataSets) -> np.ndarray:
        self.calls.append(data_sets)
        if len(self.calls) - 1 == self.fail_at:
            raise self.error
        return np.full(len(data_sets.seeds), len(self.calls), np.float32)


@pytest.mark.parametrize("common", [False, True])
def test_the_host_is_called_once_per_update_in_order(common: bool) -> None:
    evaluate = Evaluate()
    reward_fn = host_reward(evaluate, common=common)
    _, record = jax.jit(lambda key: run(key, METHOD, reward_fn, n=2))(KEY)
    reward_fn.reraise()  # nothing to raise
    np.testing.assert_array_equal(record.rewards, np.repeat(np.arange(1.0, 9), 2).reshape(8, 2))
    assert len(evaluate.calls) == 8 and record.info.group.tolist() == [0] * 4 + [1] * 4
    for data_sets, actions in zip(evaluate.calls, record.actions, strict=True):
        assert all(type(x) is np.ndarray for x in jax.tree.leaves(data_sets))
        assert data_sets.actions.dtype == np.int32
        np.testing.assert_array_equal(data_sets.actions, actions)
        np.testing.assert_allclose(data_sets.proposals, relax(PAIR, actions), atol=1e-6)
        assert (data_sets.seeds.shape, data_sets.seeds.dtype) == ((2,), np.uint32)
        assert len(set(data_sets.seeds)) == 2 - common
    assert len(np.unique([data_sets.seeds for data_sets in evaluate.calls])) == 16 - 8 * common


def test_driven_it_gives_the_same_and_the_seeds_come_straight_from_the_key() -> None:
    scanned, looped = Evaluate(), Evaluate()
    state, _ = jax.jit(lambda key: run(key, METHOD, host_reward(scanned), n=2))(KEY)
    *_, (last, _) = drive(KEY, METHOD, host_reward(looped), n=2)
    assert_close(last, state, atol=1e-5)
    for a, b in zip(scanned.calls, looped.calls, strict=True):
        assert_same((a.actions, a.seeds), (b.actions, b.seeds))
    reward_key = jax.random.split(jax.random.fold_in(jax.random.split(KEY)[1], 0))[1]
    bits = jax.random.bits(reward_key, (2,), jnp.uint32)
    np.testing.assert_array_equal(looped.calls[0].seeds, bits)


def test_updates_must_be_known_and_none_leaves_the_first_state() -> None:
    assert list(drive(KEY, METHOD, host_reward(Evaluate()), 0)) == []
    state, _ = run(KEY, METHOD, host_reward(Evaluate()), 0)
    assert_same(first_state(KEY, METHOD), state)
    endless = KEY, random_search(FIVE), bandit
    for loop, updates, message in (
        (run, (), "how many"), (drive, (), "how many"),
        (run, (-3,), "updates is -3"), (drive, (-3,), "updates is -3"),
        (run, (2, 0), "n is 0"), (drive, (2, 0), "n is 0"),
    ):  # fmt: skip
        refuses(message, loop, *endless, *updates)


@pytest.mark.parametrize("loop", [run, lambda *arguments: list(drive(*arguments))])
@pytest.mark.parametrize("shape", [(3, 1), (), (1,)])
def test_rewards_of_a_wrong_shape_are_an_error_and_not_broadcast(loop, shape: tuple) -> None:
    def reward(*_: object) -> jax.Array:
        return jnp.zeros(shape)

    refuses(r"the rewards have the shape .* must have \(3,\)", loop, KEY, METHOD, reward, 2, 3)


@pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt(), SystemExit(3)])
@pytest.mark.parametrize("way", ["run", "jitted run", "step"])
def test_an_evaluation_that_raises_ends_the_run(way: str, error: BaseException) -> None:
    evaluate = Evaluate(1, error)
    reward_fn = host_reward(evaluate)

    def steps() -> None:
        step, state = make_step(METHOD, reward_fn, n=2), METHOD.init(KEY)
        for t in range(4):
            state, _ = jax.block_until_ready(step(jax.random.key(t), state))

    def whole(key: jax.Array) -> object:
        return run(key, METHOD, reward_fn, n=2)[1].rewards

    if way == "run":  # not jitted as a whole, it raises the error itself
        with pytest.raises(type(error)) as caught:
            whole(KEY)
    else:
        loop = steps if way == "step" else lambda: jax.block_until_ready(jax.jit(whole)(KEY))
        refuses(type(error).__name__, loop, error=jax.errors.JaxRuntimeError)
        with pytest.raises(type(error)) as caught:
            reward_fn.reraise()
    assert caught.value is error
    assert len(evaluate.calls) == 2  # nothing is evaluated after the error
    reward_fn.reraise()  # the error is forgotten, and evaluation continues
    actions = jnp.zeros((2, 2), jnp.int32)
    assert np.all(np.isfinite(reward_fn(KEY, relax(PAIR, actions), actions)))


def test_numbers_that_are_not_finite_are_an_error_and_no_answer() -> None:
    def update(state: jax.Array, actions: jax.Array, rewards: jax.Array) -> tuple:
        state, info = random_search(FIVE).update(state, actions, rewards)
        return state, info._replace(finite=jnp.asarray(False))

    broken = random_search(FIVE)._replace(update=update)
    loops = (
        lambda: run(KEY, broken, bandit, updates=1),
        lambda: next(drive(KEY, broken, bandit, updates=1)),
        lambda: AskTell(FIVE, broken).tell(0, 1.0),
    )
    for loop in loops:
        refuses("numbers that are not finite", loop, error=FloatingPointError)


def test_drive_raises_the_error_before_its_update_counts(capfd) -> None:
    steps = drive(KEY, METHOD, host_reward(Evaluate(3, OSError("worker died"))), n=2)
    assert len([next(steps) for _ in range(3)]) == 3
    refuses("worker died", next, steps, error=OSError)
    assert "Traceback" not in capfd.readouterr().err  # JAX prints what a callback raises


def test_an_error_in_drive_hides_no_error_of_a_later_run() -> None:
    evaluate = Evaluate(0, OSError("worker died"))
    reward_fn = host_reward(evaluate)
    refuses("worker died", next, drive(KEY, METHOD, reward_fn, n=2), error=OSError)
    evaluate.fail_at, evaluate.error = 1, OSError("disk full")
    refuses("disk full", run, KEY, METHOD, reward_fn, n=2, error=OSError)


def test_an_error_that_nobody_asked_for_is_not_that_of_a_later_run() -> None:
    reward_fn = host_reward(evaluate := Evaluate(0, OSError("disk full")))
    with pytest.raises(jax.errors.JaxRuntimeError):
        jax.block_until_ready(jax.jit(lambda key: run(key, METHOD, reward_fn, n=2)[0])(KEY))
    assert len(list(drive(KEY, METHOD, reward_fn, n=2))) == 8 and len(evaluate.calls) == 9


@pytest.mark.parametrize(("returned", "message"), [
    (np.zeros(2), r"float64\[2\], not float32\[2\]"),
    (np.zeros(3, np.float32), r"float32\[3\], not float32\[2\]"),
    (np.zeros((2, 1), np.float32), r"float32\[2, 1\]"),
    ([0.0, 0.0], "list, not a NumPy array"), (None, "NoneType"),
])  # fmt: skip
def test_a_wrong_answer_is_an_error(returned: object, message: str) -> None:
    def once(answer: object) -> None:
        next(drive(KEY, METHOD, host_reward(lambda data_sets: answer), n=2))

    refuses(message, once, returned, error=TypeError)
    beyond = np.asarray([np.nan, -1e31], np.float32)
    refuses(r"a reward of -1e\+31, but it must lie within \+-1e\+15", once, beyond)
