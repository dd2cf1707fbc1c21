import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sdr_jax import Baseline, ema, identity, leave_one_out, squared_percent
from sdr_jax.baseline import normalised

rewards_lists = st.lists(
    st.lists(st.integers(-100, 100), min_size=3, max_size=3), min_size=1, max_size=6
)


def advantages(baseline: Baseline, updates: list) -> list[list[float]]:
    state, out = baseline.init(), []
    for rewards in updates:
        values, state = baseline.advantage(state, jnp.asarray(rewards, jnp.float32))
        out.append(values.tolist())
    return out


def test_ema_by_hand() -> None:
    # Baselines: 1 (the first reward), 1, then 0.9 * 1 + 0.1 * 2 = 1.1.
    assert np.ravel(advantages(ema(), [[1.0], [2.0], [2.0]])) == pytest.approx([0, 1, 0.9])


def test_ema_of_the_authors_code_by_hand() -> None:
    # Baselines: 1, 0.9 * 1 + 0.1 * 2 = 1.1, 0.9 * 1.1 + 0.1 * 2 = 1.19.
    actual = advantages(ema(includes_current=True), [[1.0], [2.0], [2.0]])
    assert np.ravel(actual) == pytest.approx([0, 0.9, 0.81])


def test_several_data_sets_enter_the_ema_as_their_mean() -> None:
    actual = advantages(ema(decay=0.5), [[1.0, 3.0], [4.0, 4.0], [3.0, 3.0]])
    np.testing.assert_allclose(actual, [[-1, 1], [2, 2], [0, 0]])


def test_leave_one_out_by_hand() -> None:
    actual = advantages(leave_one_out(), [[1.0, 2.0, 6.0]])
    np.testing.assert_allclose(actual, [[1 - 4, 2 - 3.5, 6 - 1.5]], rtol=1e-6)


@pytest.mark.parametrize("baseline", [ema(), ema(includes_current=True), leave_one_out()])
@given(rewards_lists, st.integers(-100, 100))
def test_a_constant_added_to_all_rewards_changes_no_advantage(
    baseline: Baseline, updates: list, constant: int
) -> None:
    shifted = [[reward + constant for reward in rewards] for rewards in updates]
    np.testing.assert_allclose(
        advantages(baseline, shifted), advantages(baseline, updates), atol=1e-3
    )


@given(rewards_lists)
def test_the_ema_of_the_paper_has_not_seen_the_update(updates: list) -> None:
    other_end = [*updates, [7.0, 7.0, 7.0]], [*updates, [8.0, 9.0, 7.0]]
    one, two = (np.asarray(advantages(ema(), rewards))[-1] for rewards in other_end)
    np.testing.assert_allclose(two - one, [1, 2, 0], atol=1e-4)


def test_bad_options_are_refused() -> None:
    with pytest.raises(ValueError, match=r"1\.5"):
        ema(decay=1.5)
    with pytest.raises(ValueError, match="at least 2"):
        advantages(leave_one_out(), [[1.0]])


def test_normalise_by_hand() -> None:
    np.testing.assert_allclose(
        normalised(jnp.asarray([3.0, -4.0])), np.asarray([3, -4]) / 12.5**0.5, rtol=1e-5
    )


@given(st.lists(st.integers(-1000, 1000), min_size=3, max_size=3), st.integers(1, 1000))
def test_normalised_advantages_forget_the_scale_and_stay_finite(values: list, scale: int) -> None:
    raw = jnp.asarray(values, jnp.float32)
    actual = normalised(raw)
    np.testing.assert_allclose(normalised(scale * raw), actual, atol=1e-4)
    assert np.all(np.isfinite(actual))
    assert float(jnp.mean(actual**2)) == pytest.approx(1.0 if any(values) else 0.0, abs=1e-4)


def test_one_or_equal_advantages_do_not_explode() -> None:
    np.testing.assert_allclose(normalised(jnp.asarray([0.02])), [1], atol=1e-3)
    np.testing.assert_allclose(normalised(jnp.full(3, -0.02)), [-1, -1, -1], atol=1e-3)
    np.testing.assert_allclose(normalised(jnp.zeros(3)), [0, 0, 0])


def test_transforms_by_hand() -> None:
    rewards = jnp.asarray([0.0, 0.1, 0.5])
    np.testing.assert_allclose(squared_percent(rewards), [0, 100, 2500], rtol=1e-6)
    np.testing.assert_array_equal(identity(rewards), rewards)
