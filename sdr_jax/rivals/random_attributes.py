"""Random attributes: no search at all, the baseline of every method."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from sdr_jax.distributions import entropy, uniform
from sdr_jax.method import Bins, Info, Method, Rewards, RngKey, basic_info, jit_method
from sdr_jax.relaxation import UNDECIDED, relax
from sdr_jax.space import Proposal, Space, Width


class NoState(NamedTuple):
    """The state of a method that keeps nothing."""


def random_attributes(space: Space, *, width: Width = None) -> Method:
    """Propose every attribute's whole range (centre 0.5, width 1), whatever the rewards are.

    Args:
        space: the attributes.
        width: has no effect, since nothing is ever decided.

    Returns:
        The method, for any number of updates; its actions are all -1.

    Source: the paper's baseline ("random attributes").
    """
    del width

    def proposal(*batch: int) -> Proposal:
        return relax(space, jnp.full((*batch, space.attributes), UNDECIDED, jnp.int32))

    def init(rng_key: RngKey) -> NoState:
        del rng_key
        return NoState()

    def sample(rng_key: RngKey, state: NoState, n: int) -> tuple[Bins, Proposal]:
        del rng_key  # each street draws from the whole range
        return jnp.full((n, space.attributes), UNDECIDED, jnp.int32), proposal(n)

    def update(state: NoState, actions: Bins, rewards: Rewards) -> tuple[NoState, Info]:
        return state, basic_info(rewards, entropy(uniform(space)))

    def solution(state: NoState) -> Proposal:
        return proposal()

    def probabilities(state: NoState) -> Float[Array, "attributes bins"]:
        return uniform(space)

    return jit_method(init, sample, update, solution, probabilities)
