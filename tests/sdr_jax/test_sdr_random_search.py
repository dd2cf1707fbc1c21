import jax
import jax.numpy as jnp
import numpy as np

from sdr_jax import random_search, relax, space

SPACE = space(["a", "b"], bins=[3, 5])
METHOD = random_search(SPACE)


def test_it_keeps_the_best_it_has_seen() -> None:
    state = METHOD.init(jax.random.key(0))
    np.testing.assert_array_equal(METHOD.solution(state).width, 1)
    state, info = METHOD.update(state, jnp.asarray([[0, 4], [2, 1]]), jnp.asarray([0.25, 0.75]))
    assert (info.reward_mean, info.reward_best) == (0.5, 0.75)
    for reward in (0.5, 0.75, jnp.nan):  # worse, equal, unknown
        state, _ = METHOD.update(state, jnp.asarray([[1, 1]]), jnp.asarray([reward]))
    expected = relax(SPACE, jnp.asarray([2, 1]))
    jax.tree.map(np.testing.assert_array_equal, METHOD.solution(state), expected)
    jax.tree.map(np.testing.assert_array_equal, METHOD.spread(state), expected)
    state, _ = METHOD.update(state, jnp.asarray([[1, 1]]), jnp.asarray([1.0]))
    assert state.actions.tolist() == [1, 1]


def test_samples_are_uniform_over_the_bins_of_each_attribute() -> None:
    state = METHOD.init(jax.random.key(0))
    actions, proposal = METHOD.sample(jax.random.key(1), state, 20_000)
    frequencies = [np.bincount(np.asarray(column), minlength=5) / 20_000 for column in actions.T]
    np.testing.assert_allclose(frequencies, METHOD.probabilities(state), atol=0.015)
    expected = relax(SPACE, actions)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), proposal, expected)
