"""The optimisation loop, in JAX or on the host: each step samples, takes rewards and updates the method."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from sdr_jax.callback import HostReward
from sdr_jax.method import Method, Record, RewardFn, RngKey, State, refuse_not_finite

StepFn = Callable[[RngKey, State], tuple[State, Record]]
"""One update, from a state to the next; the key is consumed, the old state stays valid."""


def make_step(method: Method, reward_fn: RewardFn, n: int = 1, *, jit: bool = True) -> StepFn:
    """Make one step, sample -> reward -> update, and jit it as a whole if the method can be traced.

    Args:
        method: the search method.
        reward_fn: the reward, in JAX or through `host_reward`.
        n: data sets per update (K in the paper's estimate of the gradient).
        jit: False for a reward function that JAX cannot trace.

    Returns:
        `step(rng_key, state) -> (state, record)`. It raises ValueError if the rewards are not f32[n].

    Raises:
        ValueError: n below 1.
    """
    if n < 1:
        raise ValueError(f"n is {n}, but must be at least 1")

    def step(rng_key: RngKey, state: State) -> tuple[State, Record]:
        sample_key, reward_key = jax.random.split(rng_key)
        actions, proposals = method.sample(sample_key, state, n)
        rewards = jnp.asarray(reward_fn(reward_key, proposals, actions), jnp.float32)
        if rewards.shape != (n,):
            raise ValueError(f"the rewards have the shape {rewards.shape}, but must have ({n},)")
        state, info = method.update(state, actions, rewards)
        return state, Record(actions, rewards, info)

    return jax.jit(step) if jit and method.traced else step


def run(
    rng_key: RngKey,
    method: Method,
    reward_fn: RewardFn,
    updates: int | None = None,
    n: int = 1,
) -> tuple[State, Record]:
    """Run a whole optimisation as one scan; jit it as a whole for rewards written in JAX.

    An error in an evaluation of a `HostReward` ends the run and is raised; see `host_reward` for a run that
    is jitted as a whole.

    Args:
        rng_key: consumed.
        method: the search method; it must not be a host adapter.
        reward_fn: the reward.
        updates: number of updates; by default as many as the method takes.
        n: data sets per update.

    Returns:
        The final state, and the records of all updates, stacked on a leading axis.

    Raises:
        ValueError: neither the argument nor the method gives the number of updates, it is below 0, n is
            below 1, or the rewards do not have the shape (n,).
        FloatingPointError: the method's numbers are no longer finite; not raised inside jit.
    """
    updates = updates_of(method, updates)
    steps_key = jax.random.split(rng_key)[1]
    step = make_step(method, reward_fn, n)

    def body(state: State, t: Int[Array, ""]) -> tuple[State, Record]:
        return step(jax.random.fold_in(steps_key, t), state)

    try:
        state, records = jax.lax.scan(body, first_state(rng_key, method), jnp.arange(updates))
        if not isinstance(records.rewards, jax.core.Tracer):
            refuse_not_finite(records.info)  # it waits for the run
        return state, records
    except jax.errors.JaxRuntimeError:
        if isinstance(reward_fn, HostReward):
            reward_fn.reraise()
        raise


def drive(
    rng_key: RngKey,
    method: Method,
    reward_fn: RewardFn,
    updates: int | None = None,
    n: int = 1,
) -> Iterator[tuple[State, Record]]:
    """Run the optimisation of `run` as a loop on the host, one update at a time.

    It also takes host adapters such as those in `benchmarks/rivals`. Keys are used as in `run`, so a pure
    method has the same actions and rewards. An error in an evaluation of a `HostReward` is raised before
    its update counts. Any other reward function is called with concrete arrays, so JAX need not be able to
    trace it.

    The arguments are those of `run`; `first_state` gives the state before the first update.

    Yields:
        After each update, the state and the update's record.

    Raises:
        ValueError: neither the argument nor the method gives the number of updates, it is below 0, n is
            below 1, or the rewards do not have the shape (n,).
        FloatingPointError: the method's numbers are no longer finite.
    """
    # These raise before the first step is asked for.
    updates = updates_of(method, updates)
    step = make_step(method, reward_fn, n, jit=isinstance(reward_fn, HostReward))
    return _steps(rng_key, method, reward_fn, updates, step)


def _steps(
    rng_key: RngKey, method: Method, reward_fn: RewardFn, updates: int, step: StepFn
) -> Iterator[tuple[State, Record]]:
    steps_key = jax.random.split(rng_key)[1]
    state = first_state(rng_key, method)
    for t in range(updates):
        with reward_fn.raising() if isinstance(reward_fn, HostReward) else nullcontext():
            next_state, record = step(jax.random.fold_in(steps_key, t), state)
        refuse_not_finite(record.info)
        state = next_state
        yield state, record


def first_state(rng_key: RngKey, method: Method) -> State:
    """The state that `run` and `drive` begin with, from the same key."""
    return method.init(jax.random.split(rng_key)[0])


def updates_of(method: Method, updates: int | None) -> int:
    """The number of updates: the argument, or as many as the method takes.

    Raises:
        ValueError: neither is given, or the number is below 0.
    """
    updates = method.updates if updates is None else updates
    if updates is None:
        raise ValueError("this method takes any number of updates: say how many")
    if updates < 0:
        raise ValueError(f"updates is {updates}, but must be at least 0")
    return updates


@contextmanager
def on_cpu() -> Iterator[None]:
    """Let JAX compute on the CPU, even where there is a GPU, if it may use both.

    Compiling one update of a model for a GPU takes XLA more than a minute of CPU time, and such small
    arrays gain nothing there.
    """
    try:
        place = jax.default_device(jax.local_devices(backend="cpu")[0])
    except RuntimeError:  # JAX_PLATFORMS leaves it out
        place = nullcontext()
    with place:
        yield
