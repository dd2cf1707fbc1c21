"""The adapters of other libraries."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sdr_jax import cma_es, space, tpe
from sdr_jax.relaxation import bin_centres

SPACE = space(list("abc"), bins=[2, 10, 5])


@pytest.mark.parametrize(("method", "module"), [(cma_es, "cmaes"), (tpe, "optuna")])
def test_a_missing_library_is_named_with_what_to_install(monkeypatch, method, module) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=rf"{module}: pip install 'sdr-jax\[search\]'"):
        method(SPACE)


@pytest.mark.parametrize("make", [cma_es, tpe])
def test_states_stay_valid(make) -> None:
    """As with the pure methods, nothing is changed in place."""
    method, other = make(SPACE), make(SPACE)
    state = method.init(jax.random.key(0))
    for t in range(6):
        unknown, _ = other.sample(jax.random.key(t), state, 3)  # a state from elsewhere
        first, _ = method.sample(jax.random.key(t), state, 3)
        again, proposal = method.sample(jax.random.key(t), state, 3)
        np.testing.assert_array_equal(first, again)
        np.testing.assert_array_equal(first, unknown)
        left, _ = method.update(state, first, jnp.asarray([1.0, 2.0, 3.0]))
        right, _ = method.update(state, first, jnp.asarray([1.0, 2.0, 3.0]))
        jax.tree.map(np.testing.assert_array_equal, method.solution(left), method.solution(right))
        state = left
        for attribute, count in enumerate(SPACE.bins):
            allowed = bin_centres(SPACE)[attribute, :count]
            assert set(np.asarray(proposal.centre[:, attribute])) <= set(allowed)


def test_a_generation_is_filled_over_any_number_of_updates() -> None:
    method = cma_es(SPACE, population=6)
    rng = np.random.default_rng(0)
    actions = jnp.asarray(rng.uniform(size=(14, 3)), jnp.float32)
    rewards = jnp.asarray(rng.uniform(size=14), jnp.float32)
    whole, _ = method.update(method.init(jax.random.key(0)), actions, rewards)
    parts = method.init(jax.random.key(0))
    for part in (slice(0, 1), slice(1, 6), slice(6, 9), slice(9, 14)):
        parts, _ = method.update(parts, actions[part], rewards[part])
    assert (whole.optimizer.generation, len(whole.told)) == (2, 2)
    assert (parts.optimizer.generation, len(parts.told)) == (2, 2)
    np.testing.assert_array_equal(whole.optimizer.mean, parts.optimizer.mean)


def test_tpe_answers_with_the_best_it_has_seen() -> None:
    method = tpe(SPACE)
    state = method.init(jax.random.key(0))
    state, _ = method.update(
        state, jnp.asarray([[0, 1, 2], [1, 9, 4], [1, 8, 3]]), jnp.asarray([0.1, 0.9, jnp.nan])
    )
    np.testing.assert_allclose(method.solution(state).centre, [0.75, 0.95, 0.9], rtol=1e-6)
    p = np.asarray(method.probabilities(state))
    np.testing.assert_allclose(p[0, :2], [0.25, 0.75])
    np.testing.assert_allclose(p[1], [0.05] * 9 + [0.55], rtol=1e-5)
