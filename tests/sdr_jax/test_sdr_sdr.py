import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sdr_jax import Method, ema, leave_one_out, relax, sdr, space, squared_percent
from sdr_jax.sdr import SdrState

SPACE = space(["a", "b", "c", "d"], bins=[3, 5, 2, 4], groups=[["b"], ["d", "a"], ["c"]])
GROUPS = [[1], [3, 0], [2]]
METHOD = sdr(SPACE, updates_per_group=3, hidden=8)
seeds = st.integers(0, 2**32 - 1)


def after(updates: int, seed: int = 0, method: Method = METHOD, n: int = 2) -> SdrState:
    """The state after updates with random rewards."""
    state = method.init(jax.random.key(seed))
    rng = np.random.default_rng(seed)
    for t in range(updates):
        actions, _ = method.sample(jax.random.key(t), state, n)
        rewards = jnp.asarray(rng.uniform(size=n), jnp.float32)
        state, _ = method.update(state, actions, rewards)
    return state


def test_total_updates() -> None:
    assert METHOD.updates == 9


def test_actions_are_sampled_learnt_or_undecided() -> None:
    state = after(4)  # group 0 is finished, group 1 active
    actions, proposal = METHOD.sample(jax.random.key(5), state, 64)
    assert actions.dtype == jnp.int32
    assert actions.shape == proposal.centre.shape == proposal.width.shape == (64, 4)
    learnt = np.argmax(np.asarray(METHOD.probabilities(state)), axis=1)
    assert set(np.asarray(actions[:, 1])) == {learnt[1]} == {int(state.descent.fixed[1])}
    assert set(np.asarray(actions[:, 0])) == set(range(3))
    assert set(np.asarray(actions[:, 3])) == set(range(4))
    assert set(np.asarray(actions[:, 2])) == {-1}
    assert np.all(proposal.centre[:, 2] == 0.5)
    assert np.all(proposal.width[:, 2] == 1)
    np.testing.assert_allclose(proposal.width[0, np.asarray([0, 1, 3])], [1 / 3, 1 / 5, 1 / 4])


def test_authors_code_puts_undecided_at_half() -> None:
    method = sdr(SPACE, hidden=8, unoptimised="half", width=0.02)
    _, proposal = method.sample(jax.random.key(5), method.init(jax.random.key(0)), 2)
    np.testing.assert_array_equal(proposal.centre[:, 2], 0.5)
    np.testing.assert_allclose(proposal.width, 0.02)


@given(seeds)
def test_groups_advance_and_inactive_ones_stay_bitwise_equal(seed: int) -> None:
    state = METHOD.init(jax.random.key(seed))
    rng = np.random.default_rng(seed)
    for t in range(9):
        actions, _ = METHOD.sample(jax.random.fold_in(jax.random.key(seed), t), state, 2)
        rewards = jnp.asarray(rng.uniform(size=2), jnp.float32)
        before, (state, info) = state, METHOD.update(state, actions, rewards)
        group = t // 3
        assert info.group == group
        assert state.descent.updates == t + 1
        finished = [index for members in GROUPS[: (t + 1) // 3] for index in members]
        assert np.flatnonzero(state.descent.fixed >= 0).tolist() == sorted(finished)
        for old, new in zip(
            jax.tree.leaves(before.learners),
            jax.tree.leaves(state.learners),
            strict=True,
        ):
            others = np.arange(3) != group
            np.testing.assert_array_equal(np.asarray(old)[others], np.asarray(new)[others])
        if info.grad_norm > 0:
            output = [
                s.learners.params["params"]["DenseGeneral_0"]["bias"][group]
                for s in (before, state)
            ]
            assert np.any(output[0] != output[1])
        assert state.learners.baseline.seen.tolist() == [3] * group + [t % 3 + 1] + [0] * (
            2 - group
        )


def test_padding_parameters_stay_zero() -> None:
    for layer in after(9).learners.params["params"].values():
        kernel = np.asarray(layer["kernel"])
        if kernel.ndim == 3:  # inputs: groups of 1, 2 and 1 attributes
            assert not np.any(kernel[0, 1:])
            assert not np.any(kernel[2, 1:])
        else:  # outputs: a group of one attribute with 2 bins
            assert not np.any(kernel[2, :, 1])
            assert not np.any(kernel[2, :, 0, 2:])


def test_after_the_last_group_nothing_changes() -> None:
    state = after(9)
    actions, proposal = METHOD.sample(jax.random.key(0), state, 3)
    np.testing.assert_array_equal(actions, np.tile(state.descent.fixed, (3, 1)))
    answer = METHOD.solution(state)
    np.testing.assert_array_equal(proposal.centre, np.tile(answer.centre, (3, 1)))
    later, _ = METHOD.update(state, actions, jnp.asarray([1.0, 2.0, 3.0]))
    jax.tree.map(np.testing.assert_array_equal, state, later)


def test_solution_is_arg_max_once_begun() -> None:
    state = after(4)
    best = np.argmax(np.asarray(METHOD.probabilities(state)), axis=1)
    best[2] = -1  # group 2 has not begun
    expected = relax(SPACE, jnp.asarray(best))
    jax.tree.map(np.testing.assert_array_equal, METHOD.solution(state), expected)
    nothing = METHOD.solution(METHOD.init(jax.random.key(0)))
    np.testing.assert_array_equal(nothing.width, 1)


def test_the_first_group_counts_as_begun_after_its_first_update() -> None:
    decided = [np.asarray(METHOD.solution(after(t)).width < 1).tolist() for t in (0, 1, 3, 4)]
    only_b = [False, True, False, False]
    assert decided == [[False] * 4, only_b, only_b, [True, True, False, True]]


def test_probabilities_are_distributions_over_the_bins_there_are() -> None:
    probabilities = METHOD.probabilities(after(4))
    assert probabilities.shape == (4, 5)
    np.testing.assert_allclose(probabilities.sum(axis=1), 1, rtol=1e-5)
    for row, bins in zip(np.asarray(probabilities), SPACE.bins, strict=True):
        assert np.all(row[:bins] > 0)
        assert not np.any(row[bins:])


def with_logits(state: SdrState, bias: float, action: int) -> SdrState:
    """All policies with the logit `bias` for one bin, 0 for the others."""
    params = jax.tree.map(jnp.zeros_like, state.learners.params)
    params["params"]["DenseGeneral_0"]["bias"] = (
        params["params"]["DenseGeneral_0"]["bias"].at[:, :, action].set(bias)
    )
    return state._replace(learners=state.learners._replace(params=params))


def test_spread_of_a_uniform_and_of_a_certain_policy() -> None:
    state = after(9)
    centre, width = METHOD.spread(with_logits(state, 0.0, 0))
    np.testing.assert_allclose(centre, 0.5, atol=1e-6)
    np.testing.assert_allclose(width, 1, atol=1e-6)
    certain = METHOD.spread(with_logits(state, 1e4, 1))
    expected = relax(SPACE, jnp.ones(4, jnp.int32))
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), certain, expected)


def test_spread_before_the_start_is_random() -> None:
    centre, width = METHOD.spread(METHOD.init(jax.random.key(0)))
    np.testing.assert_array_equal(centre, 0.5)
    np.testing.assert_array_equal(width, 1)


@pytest.mark.parametrize("n", [1, 2])
def test_a_constant_added_to_all_rewards_leaves_the_policies_unchanged(n: int) -> None:
    # Sums of eighths are exact, so both runs see the same advantages to the bit.
    baseline = ema(decay=0.5) if n == 1 else leave_one_out()
    method = sdr(SPACE, updates_per_group=3, hidden=8, baseline=baseline)

    def final(constant: float) -> SdrState:
        state = method.init(jax.random.key(0))
        for t in range(9):
            actions, _ = method.sample(jax.random.key(t), state, n)
            rewards = jnp.sum(actions, axis=1).astype(jnp.float32) / 8 + constant
            state, _ = method.update(state, actions, rewards)
        return state

    jax.tree.map(
        np.testing.assert_array_equal, final(0.0).learners.params, final(2.0).learners.params
    )


@pytest.mark.parametrize("failed", [False, True])
def test_info_by_hand(failed: bool) -> None:
    state = METHOD.init(jax.random.key(0))
    actions, _ = METHOD.sample(jax.random.key(0), state, 2 + failed)
    rewards = jnp.asarray([0.25, 0.75, jnp.nan][: 2 + failed])
    _, info = METHOD.update(state, actions, rewards)
    assert (info.reward_mean, info.reward_best, info.baseline) == (0.5, 0.75, 0.5)
    np.testing.assert_allclose(info.advantages, [-0.25, 0.25, 0][: 2 + failed])
    assert 0 < info.entropy <= np.log(5) + 1e-6
    assert np.isfinite(info.grad_norm)
    # The authors' code learns from squares.
    _, info = sdr(SPACE, hidden=8, transform=squared_percent).update(state, actions, rewards)
    np.testing.assert_allclose(info.advantages[:2], [625 - 3125, 5625 - 3125], rtol=1e-5)
    assert (info.reward_mean, info.baseline) == (0.5, pytest.approx(3125))


@pytest.mark.parametrize(
    ("known", "baseline"), [(0, ema()), (0, leave_one_out()), (1, leave_one_out())]
)
def test_too_few_known_rewards_teach_nothing_but_groups_move_on(known: int, baseline) -> None:
    method = sdr(SPACE, updates_per_group=2, hidden=8, baseline=baseline, normalise=True)
    before = after(1, method=method)
    actions, _ = method.sample(jax.random.key(1), before, 3)
    rewards = jnp.where(jnp.arange(3) < known, 1.0, jnp.nan)
    state, info = method.update(before, actions, rewards)
    jax.tree.map(np.testing.assert_array_equal, state.learners, before.learners)
    assert state.descent.updates == 2
    assert np.flatnonzero(state.descent.fixed >= 0).tolist() == [1]
    assert np.isnan(info.reward_mean) == (known == 0)
