"""The callback through which a search evaluates data sets on the host."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import io_callback
from jaxtyping import Array, Float, Key, Real

from sdr_jax.rewards import LARGEST
from sdr_jax.space import Proposal


class DataSets(NamedTuple):
    """The data sets that one update evaluates, in NumPy."""

    actions: np.ndarray  # [n attributes], see the method's `sample`
    proposals: Proposal  # f32[n attributes] each
    seeds: np.ndarray  # u32[n], for everything that is random in an evaluation


class HostReward:
    """A reward function that calls the host; made by `host_reward`."""

    def __init__(self, evaluate: Callable[[DataSets], np.ndarray], common: bool) -> None:
        self._evaluate = evaluate
        self._common = common
        self._error: BaseException | None = None
        self._deferring = False  # whether errors wait for `reraise` rather than leave the callback

    def __call__(
        self,
        rng_key: Key[Array, ""],
        proposals: Proposal,
        actions: Real[Array, "n attributes"],
    ) -> Float[Array, "n"]:
        """Draw seeds and let the host evaluate the data sets; the key is consumed."""
        n = len(proposals.centre)
        shape = () if self._common else (n,)
        seeds = jnp.broadcast_to(jax.random.bits(rng_key, shape, jnp.uint32), (n,))
        result = jax.ShapeDtypeStruct((n,), jnp.float32)
        return io_callback(self._on_host, result, actions, proposals, seeds, ordered=True)

    def reraise(self) -> None:
        """Raise the error of a failed evaluation, if there is one, and forget it.

        It waits for evaluations that still run. `run` and `drive` call it.
        """
        with suppress(jax.errors.JaxRuntimeError):  # what the callback raised
            jax.effects_barrier()
        error, self._error = self._error, None
        if error is not None:
            raise error

    @contextmanager
    def raising(self) -> Iterator[None]:
        """Raise errors of evaluations at the end of the block.

        Raised inside the callback, they would reach the caller too, but JAX would print a traceback first.
        """
        self._error, self._deferring = None, True
        try:
            yield
            self.reraise()
        finally:
            self._deferring = False

    def _on_host(self, *arguments: Any) -> np.ndarray:
        """Evaluate in the callback, which must not call JAX."""
        # Some versions of JAX pass their own arrays.
        data_sets = DataSets(*jax.tree.map(np.asarray, arguments))
        n = len(data_sets.seeds)
        if self._error is None or not self._deferring:
            try:
                rewards = self._evaluate(data_sets)
                _check(rewards, n)
                return rewards
            except BaseException as error:
                self._error = error
                if not self._deferring:
                    raise
        return np.full(n, np.nan, np.float32)


def host_reward(evaluate: Callable[[DataSets], np.ndarray], *, common: bool = False) -> HostReward:
    """Make a `reward_fn` of a host function that renders, trains and evaluates.

    Each call calls `evaluate` exactly once, in order (an ordered `io_callback`), since a reward is
    noisy and costly. Keys stay in JAX; the host gets seeds. Ordered callbacks work under jit, scan and
    cond, not under vmap.

    A reward that is not finite says that the evaluation failed; methods leave it out. An error in `evaluate`,
    Ctrl-C included, ends the optimisation: `run` and `drive` raise it. Where your own jitted code calls the
    reward function, or `run` as a whole is jitted, JAX raises `JaxRuntimeError` with the error's text, and
    `reraise()` then raises the error itself. A wrong type, shape or dtype of the rewards is an error, too,
    and so is a reward beyond 1e15.

        for state, record in drive(key, method, host_reward(evaluate), n=4):
            ...

    Args:
        evaluate: returns the rewards of data sets, f32[n] in NumPy. It must not call JAX in this process:
            that can deadlock, and always does on one core.
        common: whether the data sets of one call share their seed. The seed then has the same effect on
            all rewards of an update, which cancels when they are compared.

    Returns:
        The reward function.
    """
    return HostReward(evaluate, common)


def _check(rewards: object, n: int) -> None:
    if not isinstance(rewards, np.ndarray):
        raise TypeError(f"evaluate returned {type(rewards).__name__}, not a NumPy array")
    if rewards.dtype != np.float32 or rewards.shape != (n,):
        raise TypeError(f"evaluate returned {rewards.dtype}{list(rewards.shape)}, not float32[{n}]")
    beyond = rewards[np.isfinite(rewards) & (np.abs(rewards) > LARGEST)]
    if len(beyond):
        raise ValueError(
            f"evaluate returned a reward of {beyond[0]:g}, but it must lie within +-{LARGEST:g}"
        )
