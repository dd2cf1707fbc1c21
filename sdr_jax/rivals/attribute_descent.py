"""Attribute descent: all bins of one attribute after the other are tried, and the best is kept."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sdr_jax.distributions import entropy, uniform
from sdr_jax.method import Bins, Info, Method, Rewards, RngKey, basic_info, jit_method
from sdr_jax.relaxation import UNDECIDED, check_relaxation, relax
from sdr_jax.space import Proposal, Space, Width

PATIENCE = 3
"""With failed rewards, a sweep takes at most so many times its usual number of data sets."""

NEVER = np.iinfo(np.int32).max


class DescentState(NamedTuple):
    """The progress of the descent; a sweep over an attribute's bins may be partly done."""

    current: Int[Array, "attributes"]  # the bin of each attribute, -1 before its first sweep
    sums: Float[Array, "bins"]  # rewards of the active attribute's bins, summed in this sweep
    counts: Int[Array, "bins"]  # number of these rewards
    tried: Int[Array, ""]  # data sets of this sweep, failed ones included
    sweeps: Int[Array, ""]  # sweeps finished


def attribute_descent(
    space: Space,
    *,
    width: Width = None,
    repeats: int = 1,
    unoptimised: str = "random",
) -> Method:
    """Coordinate search by brute force, in the order of the groups.

    A sweep tries every bin of one attribute `repeats` times, with the others at their current bins, and
    keeps the bin with the highest mean reward. Attributes without a sweep are undecided. After the
    last attribute it starts again with the first. This is SDR with one group per attribute and brute
    force in place of the policy.

    An update's n data sets try the n bins with the fewest rewards so far, in order; a sweep takes as many
    updates as it needs. The next sweep needs the result of this one, so data sets left over in its last
    update are further repeats. The bin of a failed evaluation is tried again, until the sweep has taken
    three times its usual number of data sets. Then it ends with the rewards that it has; without any, the
    attribute stays as it was.

    `solution` and `spread` are the same; both change at the ends of sweeps only.

    Args:
        space: the attributes, their bins, and groups for the order.
        width: width of the relaxed bins, see `relax`.
        repeats: the least number of data sets per bin and sweep.
        unoptimised: the value of undecided attributes, see `relax`.

    Returns:
        The method, for any number of updates; a round of all attributes takes the sum over attributes of
        ceil(repeats * K / n) updates, if no reward is NaN.

    Raises:
        ValueError: fewer than one repeat, or an option out of range.

    Source: section "Discussion", "Difference with attribute descent"; Yao et al. 2019, "Simulating
        content consistent vehicle datasets with attribute descent".
    """
    if repeats < 1:
        raise ValueError(f"repeats is {repeats}, but must be at least 1")
    check_relaxation(space, width, unoptimised)
    order = np.asarray([index for group in space.groups for index in group], np.int32)
    group_of = np.asarray(
        [group for group, indices in enumerate(space.groups) for _ in indices], np.int32
    )
    sizes = np.asarray(space.bins, np.int32)

    def turn(state: DescentState) -> Array:
        return state.sweeps % space.attributes

    def active_attribute(state: DescentState) -> Array:
        return jnp.asarray(order)[turn(state)]

    def init(rng_key: RngKey) -> DescentState:
        del rng_key  # nothing is random but the streets
        return DescentState(
            current=jnp.full(space.attributes, UNDECIDED, jnp.int32),
            sums=jnp.zeros(space.max_bins, jnp.float32),
            counts=jnp.zeros(space.max_bins, jnp.int32),
            tried=jnp.zeros((), jnp.int32),
            sweeps=jnp.zeros((), jnp.int32),
        )

    def sample(rng_key: RngKey, state: DescentState, n: int) -> tuple[Bins, Proposal]:
        del rng_key
        attribute = active_attribute(state)
        size = jnp.asarray(sizes)[attribute]
        absent = jnp.arange(space.max_bins) >= size
        fewest_first = jnp.argsort(jnp.where(absent, NEVER, state.counts)).astype(jnp.int32)
        tries = fewest_first[jnp.arange(n) % size]
        actions = jnp.broadcast_to(state.current, (n, space.attributes)).at[:, attribute].set(tries)
        return actions, relax(space, actions, width, unoptimised)

    def update(state: DescentState, actions: Bins, rewards: Rewards) -> tuple[DescentState, Info]:
        attribute = active_attribute(state)
        finite = jnp.isfinite(rewards)
        sums = state.sums.at[actions[:, attribute]].add(jnp.where(finite, rewards, 0.0))
        counts = state.counts.at[actions[:, attribute]].add(finite.astype(jnp.int32))
        tried = state.tried + rewards.shape[0]
        size = jnp.asarray(sizes)[attribute]
        complete = jnp.all((counts >= repeats) | (jnp.arange(space.max_bins) >= size))
        ends = complete | (tried >= PATIENCE * repeats * size)

        means = jnp.where(counts > 0, sums / jnp.maximum(counts, 1), -jnp.inf)
        best = jnp.where(jnp.any(counts > 0), jnp.argmax(means), state.current[attribute])
        current = state.current.at[attribute].set(best.astype(jnp.int32))
        next_state = DescentState(
            current=jnp.where(ends, current, state.current),
            sums=jnp.where(ends, 0.0, sums),
            counts=jnp.where(ends, 0, counts),
            tried=jnp.where(ends, 0, tried),
            sweeps=state.sweeps + ends.astype(jnp.int32),
        )
        info = basic_info(rewards, entropy(probabilities(state)))
        return next_state, info._replace(group=jnp.asarray(group_of)[turn(state)])

    def solution(state: DescentState) -> Proposal:
        return relax(space, state.current, width, unoptimised)

    def probabilities(state: DescentState) -> Float[Array, "attributes bins"]:
        decided = (state.current >= 0).at[active_attribute(state)].set(False)
        certain = jax.nn.one_hot(state.current, space.max_bins)
        return jnp.where(decided[:, None], certain, uniform(space))

    return jit_method(init, sample, update, solution, probabilities)
