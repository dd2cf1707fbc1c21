"""Random attributes: a method that learns nothing and is the baseline of every search."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from sdr_jax.distributions import entropy, uniform
from sdr_jax.method import Bins, Info, Method, Rewards, RngKey, basic_info, jit_method
from sdr_jax.relaxation import UNDECIDED, relax
from sdr_jax.space import Proposal, Space, Width


class NothingLearnt(NamedTuple):
    """The state of a method that keeps nothing."""


def random_attributes(space: Space, *, width: Width = None) -> Method:
    """Proposes every attribute's whole range (centre 0.5, width 1), whatever the rewards are.

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

    def init(rng_key: RngKey) -> NothingLearnt:
        del rng_key
        return NothingLearnt()

    def sample(rng_key: RngKey, state: NothingLearnt, n: int) -> tuple[Bins, Proposal]:
        del rng_key  # each street draws from the whole range
        return jnp.full((n, space.attributes), UNDECIDED, jnp.int32), proposal(n)

    def update(state: NothingLearnt, actions: Bins, rewards: Rewards) -> tuple[NothingLearnt, Info]:
        return state, basic_info(rewards, entropy(uniform(space)))

    def solution(state: NothingLearnt) -> Proposal:
        return proposal()

    def probabilities(state: NothingLearnt) -> Float[Array, "attributes bins"]:
        return uniform(space)

    return jit_method(init, sample, update, solution, probabilities)
