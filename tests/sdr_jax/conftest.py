"""Cheaper compilation, since these tests compile much and compute little, and helpers that they share."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import pytest
from hypothesis import strategies as st

from sdr_jax import drive
from tests.conftest import refuses as refuses
from tests.trees import assert_close as assert_close
from tests.trees import assert_same as assert_same

KEY = jax.random.key(0)
SEEDS = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module", autouse=True)
def light_compilation() -> Iterator[None]:
    """Leave most optimisations out, in processes that tests start, too; forget what was compiled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
        jax.config.update("jax_disable_most_optimizations", True)
        yield
        jax.config.update("jax_disable_most_optimizations", False)
        jax.clear_caches()


def driven(rng_key, method, reward_fn, updates=None, n=1):
    """The last state of `drive`, and the records of all its updates, stacked."""
    states, records = zip(*drive(rng_key, method, reward_fn, updates, n), strict=True)
    return states[-1], jax.tree.map(lambda *leaves: jnp.stack(leaves), *records)


def tell(method, actions, rewards, state=None):
    """The state (by default the first) after an update with these rewards, and the info of the update."""
    state = method.init(KEY) if state is None else state
    return method.update(state, jnp.asarray(actions), jnp.asarray(rewards, jnp.float32))


def run_updates(method, reward, updates: int, n: int):
    """The state after updates of n data sets each, with the rewards `reward(t, actions, proposals)`."""
    state = method.init(KEY)
    for t in range(updates):
        actions, proposals = method.sample(jax.random.key(t), state, n)
        state, _ = tell(method, actions, reward(t, actions, proposals), state)
    return state
