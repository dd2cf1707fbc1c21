"""Random search, the rival every method has to beat: try bins at random, keep the best."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sdr_jax.method import Info, Method
from sdr_jax.space import UNDECIDED, Proposal, Space, check_relaxation, relax


class SearchState(NamedTuple):
    """The best that has been seen."""

    actions: Int[Array, "attributes"]  # its bins, -1 before the first update
    reward: Float[Array, ""]  # its reward, minus infinity before the first update


def random_search(space: Space, width: float | tuple[float, ...] | None = None) -> Method:
    """Uniform bins for all attributes at once; the answer is the best data set seen.

    Groups play no part. `solution` and `spread` are the same: one reward says nothing of how sure
    the best bin is. Under noisy rewards the best is partly the luckiest. NaN rewards are passed by.

    Args:
        space: the attributes and their bins.
        width: of the relaxed bins, see `relax`.

    Returns:
        The method, for any number of updates.

    Raises:
        ValueError: a width outside [0, 1].

    Source: the paper's comparison of searches ("random search").
    """
    check_relaxation(space, width, "random")

    def init(rng_key: Key[Array, ""]) -> SearchState:
        del rng_key  # nothing is random before the first sample
        undecided = jnp.full(space.attributes, UNDECIDED, jnp.int32)
        return SearchState(undecided, jnp.asarray(-jnp.inf, jnp.float32))

    def sample(
        rng_key: Key[Array, ""], state: SearchState, n: int
    ) -> tuple[Int[Array, "n attributes"], Proposal]:
        shape = (n, space.attributes)
        bins = jnp.broadcast_to(jnp.asarray(space.bins, jnp.int32), shape)
        actions = jax.random.randint(rng_key, shape, 0, bins, jnp.int32)
        return actions, relax(space, actions, width)

    def update(
        state: SearchState, actions: Int[Array, "n attributes"], rewards: Float[Array, "n"]
    ) -> tuple[SearchState, Info]:
        comparable = jnp.where(jnp.isnan(rewards), -jnp.inf, rewards)
        best = jnp.argmax(comparable)
        better = comparable[best] > state.reward
        info = Info(
            reward_mean=rewards.mean(),
            reward_best=rewards.max(),
            baseline=jnp.asarray(jnp.nan, jnp.float32),
            advantages=jnp.zeros_like(rewards),
            entropy=jnp.asarray(sum(map(math.log, space.bins)), jnp.float32),
            grad_norm=jnp.zeros((), jnp.float32),
            group=jnp.zeros((), jnp.int32),
        )
        next_state = SearchState(
            jnp.where(better, actions[best], state.actions),
            jnp.where(better, comparable[best], state.reward),
        )
        return next_state, info

    def solution(state: SearchState) -> Proposal:
        return relax(space, state.actions, width)

    def probabilities(state: SearchState) -> Float[Array, "attributes bins"]:
        bins = np.asarray(space.bins, np.float32)[:, None]
        return jnp.asarray((np.arange(space.max_bins) < bins) / bins)

    answer = jax.jit(solution)
    return Method(
        init=jax.jit(init),
        sample=jax.jit(sample, static_argnames="n"),
        update=jax.jit(update),
        solution=answer,
        spread=answer,
        probabilities=jax.jit(probabilities),
        updates=None,
    )
