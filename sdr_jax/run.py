"""The whole optimisation: sample, reward, update, and again."""

from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key, Real

from sdr_jax.method import Info, Method, State
from sdr_jax.space import Proposal


@runtime_checkable
class RewardFn(Protocol):
    """Scores data sets."""

    def __call__(self, rng_key: Key[Array, ""], proposals: Proposal) -> Float[Array, "n"]:
        """The key is consumed; proposals are f32[n attributes] each; higher is better."""


class Record(NamedTuple):
    """What one step tried and got."""

    actions: Real[Array, "n attributes"]  # see the method's `sample`
    rewards: Float[Array, "n"]  # one per data set
    info: Info  # of the update


@runtime_checkable
class StepFn(Protocol):
    """One update, from one state to the next."""

    def __call__(self, rng_key: Key[Array, ""], state: State) -> tuple[State, Record]:
        """The key is consumed. The state given stays valid, should the rewards turn out NaN."""


def make_step(method: Method, reward_fn: RewardFn, n: int = 1, *, compiled: bool = True) -> StepFn:
    """One jitted step = sample -> reward -> update, for loops on the host and for `run`.

    Args:
        method: what learns.
        reward_fn: what scores, in JAX or through `host_reward`.
        n: data sets per update.
        compiled: False for host adapters such as `cma_es` and rewards that JAX cannot trace.

    Returns:
        `step(rng_key, state) -> (state, record)`.
    """

    def step(rng_key: Key[Array, ""], state: State) -> tuple[State, Record]:
        sample_key, reward_key = jax.random.split(rng_key)
        actions, proposals = method.sample(sample_key, state, n)
        rewards = jnp.asarray(reward_fn(reward_key, proposals), jnp.float32)
        state, info = method.update(state, actions, rewards)
        return state, Record(actions, rewards, info)

    return jax.jit(step) if compiled else step


def run(
    rng_key: Key[Array, ""],
    method: Method,
    reward_fn: RewardFn,
    updates: int | None = None,
    n: int = 1,
) -> tuple[State, Record]:
    """Runs a whole optimisation as one scan; jit it as a whole for rewards written in JAX.

    A loop on the host gets the same result, and may stop and go on anywhere, with
    `init_key, steps_key = split(rng_key)` and `step(fold_in(steps_key, t), state)` for update t.

    Args:
        rng_key: consumed.
        method: what learns.
        reward_fn: what scores.
        updates: how many updates; by default as many as the method takes.
        n: data sets per update.

    Returns:
        The final state, and the records of all updates, stacked on a leading axis.

    Raises:
        ValueError: no number of updates, neither here nor in the method.
    """
    updates = method.updates if updates is None else updates
    if updates is None:
        raise ValueError("this method takes any number of updates: say how many")
    init_key, steps_key = jax.random.split(rng_key)
    step = make_step(method, reward_fn, n)

    def body(state: State, t: Int[Array, ""]) -> tuple[State, Record]:
        return step(jax.random.fold_in(steps_key, t), state)

    return jax.lax.scan(body, method.init(init_key), jnp.arange(updates))


def run_on_host(
    rng_key: Key[Array, ""],
    method: Method,
    reward_fn: RewardFn,
    updates: int | None = None,
    n: int = 1,
) -> tuple[State, Record]:
    """Runs a whole optimisation as a plain loop, for any method and any reward.

    It takes host adapters such as `cma_es` and rewards that JAX cannot trace, which `run` does not.
    Keys are used as `run` uses them, so a pure method tries and gets the same here as there.

    Args:
        rng_key: consumed.
        method: what learns, pure or a host adapter.
        reward_fn: what scores; called with concrete arrays, outside of jit.
        updates: how many updates; by default as many as the method takes.
        n: data sets per update.

    Returns:
        The final state, and the records of all updates, stacked on a leading axis.

    Raises:
        ValueError: no number of updates, neither here nor in the method; or fewer than one.
    """
    updates = method.updates if updates is None else updates
    if updates is None:
        raise ValueError("this method takes any number of updates: say how many")
    if updates < 1:
        raise ValueError(f"updates is {updates}, but must be at least 1")
    init_key, steps_key = jax.random.split(rng_key)
    state = method.init(init_key)
    step = make_step(method, reward_fn, n, compiled=False)
    records = []
    for t in range(updates):
        state, record = step(jax.random.fold_in(steps_key, t), state)
        records.append(record)
    return state, jax.tree.map(lambda *leaves: jnp.stack(leaves), *records)
