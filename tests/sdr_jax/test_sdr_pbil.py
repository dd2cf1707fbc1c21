import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sdr_jax import pbil, space
from sdr_jax.relaxation import bin_mask, uniform
from sdr_jax.rivals.pbil import _kernel, _rank_weights

SPACE = space(["a", "b", "c"], bins=[2, 10, 5])


def test_rank_weights_by_hand() -> None:
    rewards = jnp.asarray([0.2, -jnp.inf, 0.9, 0.5, 0.1, 0.0, 0.3, -jnp.inf])
    raw = np.log(0.5 * 6 + 0.5) - np.log([1, 2, 3])  # the better half of six
    expected = np.zeros(8)
    expected[[2, 3, 6]] = raw / raw.sum()
    np.testing.assert_allclose(_rank_weights(rewards, 0.5), expected, atol=1e-6)
    assert not np.any(_rank_weights(jnp.asarray([1.0, -jnp.inf]), 0.25))


@pytest.mark.parametrize("smoothing", [0.0, 1e-4, 0.08, 0.7, 3.0])
def test_the_kernel_is_a_distribution_that_keeps_uniform_ones(smoothing: float) -> None:
    kernel = _kernel(SPACE, smoothing)
    assert np.all(np.isfinite(kernel)) and np.all(kernel >= 0)
    kept = np.einsum("ab,abc->ac", np.asarray(uniform(SPACE)), kernel)
    np.testing.assert_allclose(kept, uniform(SPACE), atol=1e-5)
    np.testing.assert_allclose(kernel.sum(axis=2), bin_mask(SPACE), atol=1e-5)


def test_neighbours_of_a_good_bin_gain_too() -> None:
    method = pbil(SPACE)
    state = method.init(jax.random.key(0))
    actions = jnp.asarray([[0, 4, 0]] + [[1, 9, 4]] * 3)
    state, _ = method.update(state, actions, jnp.asarray([1.0, 0, 0, 0]))
    p = np.asarray(method.probabilities(state))[1]
    assert p[4] > p[3] > p[2] > p[1]
    np.testing.assert_allclose(p[3], p[5], rtol=1e-4)
    plain = pbil(SPACE, smoothing=0.0)
    p = plain.probabilities(plain.update(plain.init(jax.random.key(0)), actions, jnp.eye(4)[0])[0])
    np.testing.assert_allclose(p[1, 4], 1 - 0.9 * 0.92**4, rtol=1e-4)


def test_only_the_latest_evaluations_are_remembered() -> None:
    method = pbil(SPACE, memory=3)
    state = method.init(jax.random.key(0))
    for t in range(5):
        actions = jnp.full((1, 3), t % 2, jnp.int32)
        state, _ = method.update(state, actions, jnp.asarray([float(t)]))
    np.testing.assert_array_equal(state.rewards, [2, 3, 4])
    np.testing.assert_array_equal(state.actions[:, 0], [0, 1, 0])
