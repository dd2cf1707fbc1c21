"""The optimisation loop on the host, for rewards from a renderer, a training run or another program."""

from collections.abc import Iterator
from contextlib import nullcontext

import jax

from sdr_jax.callback import HostReward
from sdr_jax.method import Method, Record, RewardFn, RngKey, State, refuse_not_finite
from sdr_jax.run import first_state, make_step, updates_of


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
        ValueError: neither the argument nor the method gives the number of updates.
        FloatingPointError: the method's numbers are no longer finite.
    """
    updates = updates_of(method, updates)  # before the first step is asked for
    return _steps(rng_key, method, reward_fn, updates, n)


def _steps(
    rng_key: RngKey, method: Method, reward_fn: RewardFn, updates: int, n: int
) -> Iterator[tuple[State, Record]]:
    on_host = isinstance(reward_fn, HostReward)
    step = make_step(method, reward_fn, n, jit=on_host)
    steps_key = jax.random.split(rng_key)[1]
    state = first_state(rng_key, method)
    for t in range(updates):
        with reward_fn.raising() if isinstance(reward_fn, HostReward) else nullcontext():
            next_state, record = step(jax.random.fold_in(steps_key, t), state)
        refuse_not_finite(record.info)
        state = next_state
        yield state, record
