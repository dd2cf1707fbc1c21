import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from sdr_jax import ema, gaussian, space
from sdr_jax.rivals.gaussian import GaussianParams

SPACE = space(["a", "b"], bins=[4, 2])
METHOD = gaussian(SPACE, optax.sgd(1.0), normalise=False)


def test_the_gradient_by_hand() -> None:
    """d log p / d mean = z / std and d log p / d log std = z^2 - 1, with z the whitened action."""
    state = METHOD.init(jax.random.key(0))
    whitened = np.asarray([[1.0, -2.0], [0.5, 0.0]])
    actions = jnp.asarray(1.5 * whitened, jnp.float32)
    after, info = METHOD.update(state, actions, jnp.asarray([3.0, 1.0]))
    advantages = np.asarray([2.0, -2.0])  # against the other one
    np.testing.assert_allclose(info.advantages, advantages)
    mean = (advantages[:, None] * whitened / 1.5).mean(axis=0)
    log_std = np.log(1.5) + (advantages[:, None] * (whitened**2 - 1)).mean(axis=0)
    np.testing.assert_allclose(after.params.mean, mean, rtol=1e-5)
    np.testing.assert_allclose(after.params.log_std, log_std, rtol=1e-5)


def test_probabilities_and_spread_are_those_of_samples() -> None:
    params = GaussianParams(jnp.asarray([1.0, -0.5]), jnp.log(jnp.asarray([0.8, 2.0])))
    state = METHOD.init(jax.random.key(0))._replace(params=params)
    actions, _ = METHOD.sample(jax.random.key(1), state, 40_000)
    assert actions.dtype == jnp.float32
    values = np.asarray(jax.nn.sigmoid(actions))
    p = np.asarray(METHOD.probabilities(state))
    np.testing.assert_allclose(p[0], np.histogram(values[:, 0], 4, (0, 1))[0] / 40_000, atol=0.01)
    np.testing.assert_allclose(p[1, :2], np.histogram(values[:, 1], 2, (0, 1))[0] / 4e4, atol=0.01)
    # A street's value is a sample, relaxed: uniform around it.
    variance = values.var(axis=0) + np.asarray([0.25, 0.5]) ** 2 / 12
    width = np.minimum(1, np.sqrt(12 * variance))
    np.testing.assert_allclose(METHOD.spread(state).width, width, atol=0.02)
    np.testing.assert_allclose(METHOD.solution(state).centre[0], jax.nn.sigmoid(1.0), rtol=1e-5)


def test_one_data_set_per_update_needs_a_baseline_with_memory() -> None:
    state = METHOD.init(jax.random.key(0))
    actions, _ = METHOD.sample(jax.random.key(1), state, 1)
    with pytest.raises(ValueError, match="at least 2 data sets"):
        METHOD.update(state, actions, jnp.ones(1))
    method = gaussian(SPACE, baseline=ema())
    method.update(method.init(jax.random.key(0)), actions, jnp.ones(1))
