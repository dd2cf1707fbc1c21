import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sdr_jax import DataSets, drive, first_state, host_reward, make_step, relax, run, sdr, space

SPACE = space(["a", "b"], bins=[3, 5], groups=[["a"], ["b"]])
METHOD = sdr(SPACE, updates_per_group=4, hidden=8)


class Evaluate:
    """Remembers what it was asked; ends in an error at one call."""

    def __init__(self, fail_at: int = -1, error: BaseException | None = None) -> None:
        self.asked: list[DataSets] = []
        self.fail_at, self.error = fail_at, error

    def __call__(self, data_sets: DataSets) -> np.ndarray:
        self.asked.append(data_sets)
        if len(self.asked) - 1 == self.fail_at:
            assert self.error is not None
            raise self.error
        return np.full(len(data_sets.seeds), len(self.asked), np.float32)


@pytest.mark.parametrize("common", [False, True])
def test_the_host_is_asked_once_per_update_in_order(common: bool) -> None:
    evaluate = Evaluate()
    reward_fn = host_reward(evaluate, common=common)
    _, record = jax.jit(lambda key: run(key, METHOD, reward_fn, n=2))(jax.random.key(0))
    reward_fn.reraise()  # nothing to raise
    np.testing.assert_array_equal(record.rewards, np.repeat(np.arange(1.0, 9), 2).reshape(8, 2))
    assert len(evaluate.asked) == 8
    for data_sets, actions in zip(evaluate.asked, record.actions, strict=True):
        assert all(type(x) is np.ndarray for x in jax.tree.leaves(data_sets))
        np.testing.assert_array_equal(data_sets.actions, actions)
        assert data_sets.actions.dtype == np.int32
        jax.tree.map(
            lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6),
            data_sets.proposals,
            relax(SPACE, actions),
        )
        assert (data_sets.seeds.shape, data_sets.seeds.dtype) == ((2,), np.uint32)
        assert len(set(data_sets.seeds)) == 2 - common
    assert len(np.unique([data_sets.seeds for data_sets in evaluate.asked])) == 16 - 8 * common


def test_driven_it_gives_the_same_and_the_seeds_come_straight_from_the_key() -> None:
    scanned, driven = Evaluate(), Evaluate()
    key = jax.random.key(0)
    state, _ = jax.jit(lambda key: run(key, METHOD, host_reward(scanned), n=2))(key)
    *_, (last, _) = drive(key, METHOD, host_reward(driven), n=2)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-5), last, state)
    for a, b in zip(scanned.asked, driven.asked, strict=True):
        np.testing.assert_array_equal(a.actions, b.actions)
        np.testing.assert_array_equal(a.seeds, b.seeds)
    reward_key = jax.random.split(jax.random.fold_in(jax.random.split(key)[1], 0))[1]
    bits = jax.random.bits(reward_key, (2,), jnp.uint32)
    np.testing.assert_array_equal(driven.asked[0].seeds, bits)


def test_nan_is_a_failed_evaluation_and_the_loop_goes_on() -> None:
    reward_fn = host_reward(lambda data_sets: np.float32([np.nan, 1]))
    records = [record for _, record in drive(jax.random.key(0), METHOD, reward_fn, n=2)]
    assert len(records) == 8
    assert all(float(record.info.reward_mean) == 1 for record in records)


def test_no_update_leaves_the_first_state() -> None:
    key = jax.random.key(3)
    assert list(drive(key, METHOD, host_reward(Evaluate()), 0)) == []
    state, _ = run(key, METHOD, host_reward(Evaluate()), 0)
    jax.tree.map(np.testing.assert_array_equal, first_state(key, METHOD), state)


def test_an_error_comes_back_as_nan_and_is_kept() -> None:
    evaluate = Evaluate()
    reward_fn = host_reward(evaluate)
    step = make_step(METHOD, reward_fn, n=2)
    state = METHOD.init(jax.random.key(0))
    for error in (OSError("disk full"), KeyboardInterrupt(), SystemExit(3)):
        evaluate.asked.clear()
        evaluate.fail_at, evaluate.error = 1, error
        rewards = [np.asarray(step(jax.random.key(t), state)[1].rewards) for t in range(4)]
        np.testing.assert_array_equal(np.isnan(rewards).all(axis=1), [False, True, True, True])
        assert len(evaluate.asked) == 2  # what comes after the error is not evaluated
        with pytest.raises(type(error)) as caught:
            reward_fn.reraise()
        assert caught.value is error
        reward_fn.reraise()  # it is forgotten, and evaluation goes on
        _, record = step(jax.random.key(0), state)
        assert np.all(np.isfinite(record.rewards))


def test_drive_raises_the_error_before_its_update_counts() -> None:
    error, seen = OSError("worker died"), 0
    with pytest.raises(OSError) as caught:
        for _ in drive(jax.random.key(0), METHOD, host_reward(Evaluate(3, error)), n=2):
            seen += 1
    assert (caught.value, seen) == (error, 3)


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        (np.zeros(2), r"float64\[2\], not float32\[2\]"),
        (np.zeros(3, np.float32), r"float32\[3\], not float32\[2\]"),
        (np.zeros((2, 1), np.float32), r"float32\[2, 1\]"),
        ([0.0, 0.0], "list, not a NumPy array"),
        (None, "NoneType"),
    ],
)
def test_a_wrong_answer_is_an_error(returned: object, message: str) -> None:
    reward_fn = host_reward(lambda data_sets: returned)
    rewards = reward_fn(jax.random.key(0), relax(SPACE, jnp.zeros((2, 2), jnp.int32)))
    assert np.all(np.isnan(rewards))
    with pytest.raises(TypeError, match=message):
        reward_fn.reraise()
