import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sdr_jax import host_reward, make_step, relax, run, sdr, space

SPACE = space(["a", "b"], bins=[3, 5], groups=[["a"], ["b"]])
METHOD = sdr(SPACE, updates_per_group=4, hidden=8)


class Evaluate:
    """Remembers what it was asked; ends in an error at one call."""

    def __init__(self, fail_at: int = -1, error: BaseException | None = None) -> None:
        self.unit: list[np.ndarray] = []
        self.seeds: list[np.ndarray] = []
        self.fail_at, self.error = fail_at, error

    def __call__(self, unit: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        self.unit.append(unit)
        self.seeds.append(seeds)
        if len(self.unit) - 1 == self.fail_at:
            assert self.error is not None
            raise self.error
        return np.full(len(seeds), len(self.unit), np.float32)


def test_the_host_is_asked_once_per_update_in_order() -> None:
    evaluate = Evaluate()
    reward_fn = host_reward(evaluate, streets=3)
    _, record = jax.jit(lambda key: run(key, METHOD, reward_fn, n=2))(jax.random.key(0))
    reward_fn.reraise()  # nothing to raise
    assert len(evaluate.unit) == 8
    np.testing.assert_array_equal(record.rewards, np.repeat(np.arange(1.0, 9), 2).reshape(8, 2))
    for unit, seeds, actions in zip(evaluate.unit, evaluate.seeds, record.actions, strict=True):
        assert isinstance(unit, np.ndarray)
        assert (unit.shape, unit.dtype) == ((2, 3, 2), np.float32)
        assert isinstance(seeds, np.ndarray)
        assert (seeds.shape, seeds.dtype) == ((2,), np.uint32)
        centre, width = (np.asarray(field)[:, None] for field in relax(SPACE, actions))
        assert np.all(np.abs(unit - centre) <= width / 2 + 1e-6)
    assert len(np.unique(evaluate.seeds)) == 16
    assert len(np.unique(evaluate.unit)) == 8 * 2 * 3 * 2


def test_an_error_comes_back_as_nan_and_is_kept() -> None:
    evaluate = Evaluate()
    reward_fn = host_reward(evaluate, streets=1)
    step = make_step(METHOD, reward_fn, n=2)
    state = METHOD.init(jax.random.key(0))
    for error in (OSError("disk full"), KeyboardInterrupt(), SystemExit(3)):
        evaluate.unit.clear()
        evaluate.fail_at, evaluate.error = 1, error
        rewards = [np.asarray(step(jax.random.key(t), state)[1].rewards) for t in range(4)]
        np.testing.assert_array_equal(np.isnan(rewards).all(axis=1), [False, True, True, True])
        assert len(evaluate.unit) == 2  # what comes after the error is not evaluated
        with pytest.raises(type(error)) as caught:
            reward_fn.reraise()
        assert caught.value is error
        reward_fn.reraise()  # it is forgotten, and evaluation goes on
        _, record = step(jax.random.key(0), state)
        assert np.all(np.isfinite(record.rewards))


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
    reward_fn = host_reward(lambda unit, seeds: returned, streets=1)
    rewards = reward_fn(jax.random.key(0), relax(SPACE, jnp.zeros((2, 2), jnp.int32)))
    assert np.all(np.isnan(rewards))
    with pytest.raises(TypeError, match=message):
        reward_fn.reraise()


def test_the_state_from_before_an_error_goes_on() -> None:
    evaluate = Evaluate()
    reward_fn = host_reward(lambda unit, seeds: evaluate(unit, seeds) * 0 + unit[:, 0, 0], 1)
    step = make_step(METHOD, reward_fn, n=2)

    def final(fail_at: int) -> object:
        evaluate.unit.clear()
        evaluate.fail_at, evaluate.error = fail_at, OSError("worker died")
        state, t = METHOD.init(jax.random.key(0)), 0
        while t < 8:
            try:
                new_state, _ = step(jax.random.key(t), state)
                reward_fn.reraise()
            except OSError:
                continue
            state, t = new_state, t + 1
        return state

    jax.tree.map(np.testing.assert_array_equal, final(-1), final(3))


def test_common_random_numbers_are_shared_within_an_update_only() -> None:
    evaluate = Evaluate()
    reward_fn = host_reward(evaluate, streets=3, common=True)
    jax.jit(lambda key: run(key, METHOD, reward_fn, n=2)[1].actions)(jax.random.key(0))
    reward_fn.reraise()
    seeds = np.stack(evaluate.seeds)
    np.testing.assert_array_equal(seeds[:, 0], seeds[:, 1])
    assert len(np.unique(seeds)) == 8
    # The same place within the interval, whatever the interval: b is cut into fifths.
    places = np.stack(evaluate.unit)[:, :, :, 1] * 5 % 1
    decided = slice(4, 8)  # b is its group's turn
    np.testing.assert_allclose(places[decided, 0], places[decided, 1], atol=1e-4)
