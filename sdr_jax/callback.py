"""The one door to the host, behind which everything without a gradient lives."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import io_callback
from jaxtyping import Array, ArrayLike, Float, Key

from sdr_jax.space import Proposal, draw


class HostReward:
    """A reward function that asks the host; made by `host_reward`."""

    def __init__(
        self,
        evaluate: Callable[[np.ndarray, np.ndarray], np.ndarray],
        streets: int,
        common: bool,
    ) -> None:
        self._evaluate = evaluate
        self._streets = streets
        self._common = common
        self._error: BaseException | None = None

    def __call__(self, rng_key: Key[Array, ""], proposals: Proposal) -> Float[Array, "n"]:
        """Draws streets and seeds, and has the host score them; the key is consumed."""
        unit_key, seed_key = jax.random.split(rng_key)
        n = proposals.centre.shape[0]
        if self._common:
            unit = jax.vmap(lambda one: draw(unit_key, one, self._streets))(proposals)
            seeds = jnp.broadcast_to(jax.random.bits(seed_key, (), jnp.uint32), (n,))
        else:
            unit = draw(unit_key, proposals, self._streets)
            seeds = jax.random.bits(seed_key, (n,), jnp.uint32)
        result = jax.ShapeDtypeStruct((n,), jnp.float32)
        return io_callback(self._on_host, result, unit, seeds, ordered=True)

    def reraise(self) -> None:
        """Raises the error that an evaluation ended with, if any, and forgets it.

        It waits for evaluations still running. To be called after every step of a loop, outside of
        jit, before the new state is used.
        """
        jax.effects_barrier()
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _on_host(self, unit: ArrayLike, seeds: ArrayLike) -> np.ndarray:
        """Runs in the callback: nothing may be raised, and JAX not be called, in here."""
        unit, seeds = np.asarray(unit), np.asarray(seeds)  # some versions of JAX pass its own
        n = len(seeds)
        if self._error is None:
            try:
                rewards = self._evaluate(unit, seeds)
                _check(rewards, n)
                return rewards
            except BaseException as error:  # an interrupt, too, must not be raised in here
                self._error = error
        return np.full(n, np.nan, np.float32)


def host_reward(
    evaluate: Callable[[np.ndarray, np.ndarray], np.ndarray], streets: int, *, common: bool = False
) -> HostReward:
    """Makes a `reward_fn` of a host function that renders, trains and scores.

    Every call makes exactly one call of `evaluate`, in order (an ordered `io_callback`): a reward
    is noisy and costly, and may be neither repeated nor left out. Keys stay in JAX; the host gets
    seeds. Ordered callbacks work under jit, scan and cond, not under vmap.

    An error in `evaluate`, Ctrl-C included, does not surface inside the callback: its rewards come
    back as NaN, so do those of later calls, which are not evaluated; the error is kept until
    `reraise()` raises it. A wrong type, shape or dtype of the rewards is such an error, too.

        reward_fn = host_reward(evaluate, streets=12)
        step = make_step(method, reward_fn, n=4)
        new_state, record = step(key, state)
        reward_fn.reraise()

    Args:
        evaluate: `(unit f32[n streets attributes], seeds u32[n]) -> f32[n]` in NumPy. It must not
            call JAX in this process: that can deadlock.
        streets: streets per data set.
        common: whether the data sets of one call share their random numbers: the same seed, and
            streets at the same places of their intervals. What a seed adds to a reward, it then adds
            to all, and a comparison within the update is spared it.

    Returns:
        The reward function.

    Raises:
        ValueError: fewer than one street.
    """
    if streets < 1:
        raise ValueError(f"streets is {streets}, but must be at least 1")
    return HostReward(evaluate, streets, common)


def _check(rewards: object, n: int) -> None:
    if not isinstance(rewards, np.ndarray):
        raise TypeError(f"evaluate returned {type(rewards).__name__}, not a NumPy array")
    if rewards.dtype != np.float32 or rewards.shape != (n,):
        raise TypeError(f"evaluate returned {rewards.dtype}{list(rewards.shape)}, not float32[{n}]")
