"""Random search: random bins are tried, and the best are kept."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sdr_jax.bins import random_bins
from sdr_jax.distributions import entropy, uniform
from sdr_jax.method import Bins, Info, Method, Rewards, RngKey, basic_info, jit_method
from sdr_jax.relaxation import UNDECIDED, check_relaxation, relax
from sdr_jax.space import Proposal, Space, Width


class SearchState(NamedTuple):
    """The best data set so far."""

    actions: Int[Array, "attributes"]  # its bins, -1 before the first update
    reward: Float[Array, ""]  # its reward, minus infinity before the first update


def random_search(space: Space, *, width: Width = None) -> Method:
    """Propose uniformly random bins for all attributes; the answer is the best data set so far.

    Groups have no effect. `solution` and `spread` are the same, since one reward gives no estimate of
    uncertainty. Under noisy rewards the best is partly the luckiest.

    Args:
        space: the attributes and their bins.
        width: width of the relaxed bins, see `relax`.

    Returns:
        The method, for any number of updates.

    Raises:
        ValueError: a width outside [0, 1].

    Source: the paper's comparison of searches ("random search").
    """
    check_relaxation(space, width, "random")

    def init(rng_key: RngKey) -> SearchState:
        del rng_key  # nothing is random before the first sample
        undecided = jnp.full(space.attributes, UNDECIDED, jnp.int32)
        return SearchState(undecided, jnp.asarray(-jnp.inf, jnp.float32))

    def sample(rng_key: RngKey, state: SearchState, n: int) -> tuple[Bins, Proposal]:
        actions = random_bins(rng_key, space, n)
        return actions, relax(space, actions, width)

    def update(state: SearchState, actions: Bins, rewards: Rewards) -> tuple[SearchState, Info]:
        comparable = jnp.where(jnp.isfinite(rewards), rewards, -jnp.inf)
        best = jnp.argmax(comparable)
        better = comparable[best] > state.reward
        info = basic_info(rewards, entropy(uniform(space)))
        next_state = SearchState(
            jnp.where(better, actions[best], state.actions),
            jnp.where(better, comparable[best], state.reward),
        )
        return next_state, info

    def solution(state: SearchState) -> Proposal:
        return relax(space, state.actions, width)

    def probabilities(state: SearchState) -> Float[Array, "attributes bins"]:
        return uniform(space)

    return jit_method(init, sample, update, solution, probabilities)
