"""SDR, and group coordinate descent on its own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jax.flatten_util import ravel_pytree

from sdr_jax import Method, ema, leave_one_out, relax, sdr, space
from sdr_jax.coordinate_descent import (
    Descent,
    active_group,
    concat,
    descend,
    init_descent,
)
from sdr_jax.distributions import moments
from sdr_jax.layout import by_attribute, lay_out
from sdr_jax.registry import make
from sdr_jax.rewards import LARGEST, squared_percent
from sdr_jax.sdr import SdrState

from .conftest import KEY, SEEDS, assert_same, run_updates, tell

THREE = space(["a", "b", "c"], bins=[3, 5, 2], groups=[["c"], ["b", "a"]])
LAYOUT = lay_out(THREE, updates_per_group=2)
CONCAT = jax.jit(lambda descent, sampled: concat(LAYOUT, descent, sampled))
BEST = jnp.asarray([1, 4])  # of both slots
SPACE = space(["a", "b", "c", "d"], bins=[3, 5, 2, 4], groups=[["b"], ["d", "a"], ["c"]])
METHOD = sdr(SPACE, updates_per_group=3, hidden=8)


def learn(learner: dict, group: jax.Array) -> tuple[dict, jax.Array, jax.Array]:
    return {"x": learner["x"] + 1, "y": learner["y"] * 2}, BEST, group


@jax.jit
def step(descent: Descent, learners: dict) -> tuple[Descent, dict, jax.Array]:
    return descend(LAYOUT, descent, learners, learn)


def course(updates: int) -> tuple[Descent, dict]:
    descent, learners = init_descent(THREE), {"x": jnp.zeros((2, 3)), "y": jnp.ones(2)}
    for _ in range(updates):
        descent, learners, _ = step(descent, learners)
    return descent, learners


def test_layout_by_hand() -> None:
    assert LAYOUT.members.tolist() == [[2, 3], [1, 0]]
    assert LAYOUT.bin_mask.sum(axis=2).tolist() == [[2, 1], [5, 3]]  # padding has one bin
    assert LAYOUT.updates == 4
    by_slot = jnp.asarray([[7, -1], [5, 3]])
    assert by_attribute(LAYOUT, by_slot, 3).tolist() == [3, 5, 7]


@pytest.mark.parametrize(("updates", "active", "fixed", "actions"), [
    (0, 0, [-1, -1, -1], [[-1, -1, 0], [-1, -1, 1]]),
    (1, 0, [-1, -1, -1], [[-1, -1, 0], [-1, -1, 1]]),
    (2, 1, [-1, -1, 1], [[2, 0, 1], [0, 1, 1]]),
    (3, 1, [-1, -1, 1], [[2, 0, 1], [0, 1, 1]]),
    (4, 1, [4, 1, 1], [[4, 1, 1]] * 2),
    (6, 1, [4, 1, 1], [[4, 1, 1]] * 2),  # after the end
])  # fmt: skip
def test_the_course_and_the_concat_by_hand(updates, active, fixed, actions) -> None:
    descent, learners = course(updates)
    assert (active_group(LAYOUT, descent), descent.fixed.tolist()) == (active, fixed)
    assert CONCAT(descent, jnp.asarray([[0, 2], [1, 0]])).tolist() == actions
    done = min(updates, 4)
    assert descent.updates == done
    assert learners["y"].tolist() == [2.0 ** min(done, 2), 2.0 ** max(done - 2, 0)]


@given(st.integers(0, 5), SEEDS)
def test_only_the_active_group_is_touched(updates: int, seed: int) -> None:
    descent, _ = course(updates)
    rng = np.random.default_rng(seed)
    learners = {"x": jnp.asarray(rng.normal(size=(2, 3))), "y": jnp.asarray(rng.normal(size=2))}
    moved, touched, info = step(descent, learners)
    still = np.arange(2) != int(info) if updates < 4 else np.ones(2, bool)
    for name in learners:
        old, new = np.asarray(learners[name]), np.asarray(touched[name])
        assert old[still].tobytes() == new[still].tobytes() and np.all(old[~still] != new[~still])
    assert moved.updates == min(updates + 1, 4)


def after(updates: int, method: Method = METHOD) -> SdrState:
    """The state after updates with random rewards."""
    return run_updates(
        method, lambda t, *_: jax.random.uniform(jax.random.key(t), (2,)), updates, 2
    )


def test_actions_are_sampled_fixed_or_undecided_and_the_answer_is_arg_max_once_started() -> None:
    state = after(4)  # group 0 is finished, group 1 active
    actions, proposal = METHOD.sample(jax.random.key(5), state, 64)
    assert actions.dtype == jnp.int32
    best = np.argmax(np.asarray(METHOD.diagnostics.probabilities(state)), axis=1)
    a, b, c, d = (set(np.asarray(column)) for column in actions.T)
    assert b == {best[1]} == {int(state.descent.fixed[1])}
    assert (a, c, d) == (set(range(3)), {-1}, set(range(4)))
    assert_same(proposal, relax(SPACE, actions))
    best[2] = -1  # group 2 has not started
    assert_same(METHOD.solution(state), relax(SPACE, best))
    wide = moments(SPACE, METHOD.diagnostics.probabilities(state))
    np.testing.assert_allclose(
        METHOD.diagnostics.spread(state), np.where(best < 0, [[0.5], [1]], wide)
    )
    start = METHOD.init(KEY)
    for answer in (METHOD.solution(start), METHOD.diagnostics.spread(start)):
        np.testing.assert_array_equal(answer, [[0.5] * 4, [1] * 4])


@given(SEEDS)
def test_groups_advance_and_inactive_ones_stay_bitwise_equal(seed: int) -> None:
    state = METHOD.init(jax.random.key(seed))
    rng = np.random.default_rng(seed)
    for t in range(9):
        actions, _ = METHOD.sample(jax.random.fold_in(jax.random.key(seed), t), state, 2)
        before, (state, info) = state, tell(METHOD, actions, rng.uniform(size=2), state)
        group = t // 3
        assert (info.group, state.descent.updates) == (group, t + 1)
        finished = [index for members in SPACE.groups[: (t + 1) // 3] for index in members]
        assert np.flatnonzero(state.descent.fixed >= 0).tolist() == sorted(finished)
        others = [other for other in range(3) if other != group]
        old, new = jax.device_get((before.learners, state.learners))
        assert_same(*(jax.tree.map(lambda x: x[others], s) for s in (old, new)))  # noqa: B023
        if info.grad_norm > 0:
            old, new = (s.learners.params["params"]["DenseGeneral_0"] for s in (before, state))
            assert np.any(old["bias"][group] != new["bias"][group])
        updates = [3] * group + [t % 3 + 1] + [0] * (2 - group)
        assert state.learners.baseline.updates.tolist() == updates


def test_after_the_last_group_nothing_changes_and_initial_weights_are_those_of_flax() -> None:
    assert METHOD.updates == 9
    state = after(9)
    actions, proposal = METHOD.sample(KEY, state, 3)
    np.testing.assert_array_equal(actions, np.tile(state.descent.fixed, (3, 1)))
    np.testing.assert_array_equal(proposal.centre, np.tile(METHOD.solution(state).centre, (3, 1)))
    assert_same(state, tell(METHOD, actions, [1, 2, 3], state)[0])
    params = state.learners.params["params"]
    assert not np.any(params["Dense_0"]["kernel"][::2, 1:])  # groups of 1, 2 and 1 attributes
    outputs = params["DenseGeneral_0"]["kernel"][2]  # of a group of one attribute with 2 bins
    assert not np.any(outputs[:, 1]) and not np.any(outputs[:, 0, 2:])
    # The likeliest of ten bins has about 0.18 at first, as the docstring says.
    ten = sdr(space([f"x{k}" for k in range(7)]))
    likeliest = [
        np.max(ten.diagnostics.probabilities(ten.init(jax.random.key(k))), axis=1) for k in range(8)
    ]
    assert np.mean(likeliest) == pytest.approx(0.18, abs=0.03)


@pytest.mark.parametrize("failed", [False, True])
def test_info_by_hand(failed: bool) -> None:
    actions, _ = METHOD.sample(KEY, METHOD.init(KEY), 2 + failed)
    rewards = [0.25, 0.75, np.nan][: 2 + failed]
    _, info = tell(METHOD, actions, rewards)
    assert (info.reward_mean, info.reward_best, info.baseline) == (0.5, 0.75, 0.5)
    np.testing.assert_allclose(info.advantages, [-0.25, 0.25, 0][: 2 + failed])
    assert 0 < info.entropy <= np.log(5) + 1e-6 and np.isfinite(info.grad_norm)
    # The authors' code learns from squares.
    _, info = tell(sdr(SPACE, hidden=8, squared_reward=True), actions, rewards)
    np.testing.assert_allclose(info.advantages[:2], [625 - 3125, 5625 - 3125], rtol=1e-5)
    assert (info.reward_mean, info.baseline) == (0.5, pytest.approx(3125))
    # The worse of two negative rewards is not the better one.
    squares = squared_percent(jnp.asarray([-0.2, -0.1, 0.3, -1e9, 1e15]))
    np.testing.assert_allclose(squares, [-400, -100, 900, -LARGEST, LARGEST], rtol=1e-6)


@pytest.mark.parametrize(("finite", "baseline"), [
    (0, ema()), (0, leave_one_out()), (1, leave_one_out()),
])  # fmt: skip
def test_too_few_finite_rewards_change_no_policy_but_groups_move_on(finite: int, baseline) -> None:
    method = sdr(SPACE, updates_per_group=2, hidden=8, baseline=baseline, normalise=True)
    before = after(1, method=method)
    actions, _ = method.sample(jax.random.key(1), before, 3)
    state, info = tell(method, actions, np.where(np.arange(3) < finite, 1, np.nan), before)
    assert_same(state.learners, before.learners)
    assert (state.descent.updates, np.flatnonzero(state.descent.fixed >= 0)) == (2, [1])
    assert np.isnan(info.reward_mean) == (finite == 0)


@pytest.mark.parametrize(("finite", "baseline"), [(0, ema()), (1, leave_one_out())])
def test_a_group_whose_evaluations_all_failed_stays_random(finite: int, baseline) -> None:
    method = sdr(SPACE, updates_per_group=2, hidden=8, baseline=baseline)

    def reward(t: int, *_: object) -> np.ndarray:
        return np.where(np.arange(3) < (3 if t >= 2 else finite), np.arange(3), np.nan)

    state = run_updates(method, reward, 3, n=3)  # group 1 has had one update
    for answer in (method.solution(state), method.diagnostics.spread(state)):
        np.testing.assert_array_equal(answer.width[1:3], [1, 1])
    assert np.all(np.asarray(method.solution(state).width)[[0, 3]] < 1)


@pytest.mark.parametrize("method", [sdr(SPACE), make("sdr", SPACE)], ids=["function", "registry"])
def test_the_papers_numbers(method: Method) -> None:
    """256 hidden units; Adam's first step is its rate, 0.01; a baseline with decay 0.9."""
    state = method.init(KEY)
    assert state.learners.params["params"]["Dense_0"]["kernel"].shape[2] == 256
    actions = [[0, 1, 0, 0], [1, 3, 1, 2]]
    moved, _ = tell(method, actions, [0, 1], state)
    old, new = (ravel_pytree(s.learners.params)[0] for s in (state, moved))
    assert np.abs(new - old).max() == pytest.approx(0.01, rel=0.01)
    baselines = []
    for reward in (0.0, 1.0, 1.0):
        state, info = tell(method, actions, [reward] * 2, state)
        baselines.append(float(info.baseline))
    np.testing.assert_allclose(baselines, [0, 0, 0.1], atol=1e-6)
