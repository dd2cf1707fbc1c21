"""The optimisation loop: each step samples, takes rewards and updates the method."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Real

from common.errors import Unfinished
from sdr_jax.callback import HostReward
from sdr_jax.method import Info, Method, RngKey, State, refuse_not_finite
from sdr_jax.space import Proposal

MOST_FAILED = 0.1
"""Share of a search's evaluations that may fail; one failure is always allowed."""


@runtime_checkable
class RewardFn(Protocol):
    """Gives the rewards of data sets."""

    def __call__(
        self, rng_key: RngKey, proposals: Proposal, actions: Real[Array, "n attributes"]
    ) -> Float[Array | np.ndarray, "n"]:
        """Evaluates data sets; higher rewards are better, and NaN says that an evaluation failed.

        Args:
            rng_key: consumed.
            proposals: f32[n attributes] each.
            actions: what the method chose, [n attributes]; most rewards need the proposals only.
        """


class Record(NamedTuple):
    """The actions of one step and their rewards."""

    actions: Real[Array, "n attributes"]  # see the method's `sample`
    rewards: Float[Array, "n"]  # one per data set
    info: Info  # of the update


StepFn = Callable[[RngKey, State], tuple[State, Record]]
"""One update, from a state to the next; the key is consumed, the old state stays valid."""


def make_step(method: Method, reward_fn: RewardFn, n: int = 1) -> StepFn:
    """Makes one step, sample -> reward -> update, and jits it as a whole if the method can be traced.

    Args:
        method: the search method.
        reward_fn: the reward, in JAX or through `host_reward`.
        n: data sets per update.

    Returns:
        `step(rng_key, state) -> (state, record)`.
    """
    step = _plain_step(method, reward_fn, n)
    return jax.jit(step) if method.traced else step


def _plain_step(method: Method, reward_fn: RewardFn, n: int) -> StepFn:
    def step(rng_key: RngKey, state: State) -> tuple[State, Record]:
        sample_key, reward_key = jax.random.split(rng_key)
        actions, proposals = method.sample(sample_key, state, n)
        rewards = jnp.asarray(reward_fn(reward_key, proposals, actions), jnp.float32)
        state, info = method.update(state, actions, rewards)
        return state, Record(actions, rewards, info)

    return step


def run(
    rng_key: RngKey,
    method: Method,
    reward_fn: RewardFn,
    updates: int | None = None,
    n: int = 1,
) -> tuple[State, Record]:
    """Runs a whole optimisation as one scan; jit it as a whole for rewards written in JAX.

    Args:
        rng_key: consumed.
        method: the search method; it must not be a host adapter.
        reward_fn: the reward.
        updates: number of updates; by default as many as the method takes.
        n: data sets per update.

    Returns:
        The final state, and the records of all updates, stacked on a leading axis.

    An error in an evaluation of a `HostReward` ends the run and is raised; see `host_reward` for a run that
    is jitted as a whole.

    Raises:
        ValueError: neither the argument nor the method gives the number of updates.
        FloatingPointError: the method's numbers are no longer finite; not raised inside jit.
    """
    updates = _count(method, updates)
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


def first_state(rng_key: RngKey, method: Method) -> State:
    """The state that `run` and `drive` begin with, given the same key."""
    return method.init(jax.random.split(rng_key)[0])


def drive(
    rng_key: RngKey,
    method: Method,
    reward_fn: RewardFn,
    updates: int | None = None,
    n: int = 1,
) -> Iterator[tuple[State, Record]]:
    """Runs the same optimisation as a loop on the host, one update at a time.

    It also takes host adapters such as those in `benchmarks/rivals`. Keys are used as in `run`, so a pure
    method has the same actions and rewards. An error in an evaluation of a `HostReward` is raised before
    its update counts. Any other reward function is called with concrete arrays, so JAX need not be able to
    trace it.

    The arguments are those of `run`; `first_state` gives the state before the first update.

    Yields:
        After each update, the state and the update's record.

    Raises:
        ValueError: neither the argument nor the method gives the number of updates.
        FloatingPointError: the method's numbers are no longer finite.
    """
    updates = _count(method, updates)
    on_host = isinstance(reward_fn, HostReward)
    step = (make_step if on_host else _plain_step)(method, reward_fn, n)

    def steps() -> Iterator[tuple[State, Record]]:
        steps_key = jax.random.split(rng_key)[1]
        state = first_state(rng_key, method)
        for t in range(updates):
            key = jax.random.fold_in(steps_key, t)
            if isinstance(reward_fn, HostReward):
                # JAX would print a traceback of what the callback raises.
                reward_fn.deferring = True
                try:
                    next_state, record = step(key, state)
                    reward_fn.reraise()
                finally:
                    reward_fn.deferring = False
            else:
                next_state, record = step(key, state)
            refuse_not_finite(record.info)
            state = next_state
            yield state, record

    return steps()


@contextmanager
def on_processor() -> Iterator[None]:
    """Lets JAX compute on the processor, even where there is a GPU, if it may use both.

    To compile one update of a model for a GPU takes XLA more than a minute of CPU time, and such small arrays
    gain nothing there.
    """
    try:
        place = jax.default_device(jax.local_devices(backend="cpu")[0])
    except RuntimeError:  # JAX_PLATFORMS leaves it out
        place = nullcontext()
    with place:
        yield


def refuse_failures(failed: int, total: int, reason: str) -> None:
    """Raises an error if too many evaluations have failed for a useful answer.

    Args:
        failed: evaluations that have failed so far.
        total: evaluations of the whole search.
        reason: the message of the last failure.

    Raises:
        Unfinished: more than a tenth of the evaluations, and more than one, have failed.
    """
    if failed > max(1, int(MOST_FAILED * total)):
        raise Unfinished(
            f"{failed} of {total} evaluations failed, more than a tenth of them; the last said: "
            f"{reason}"
        )


def _count(method: Method, updates: int | None) -> int:
    updates = method.updates if updates is None else updates
    if updates is None:
        raise ValueError("this method takes any number of updates: say how many")
    return updates
