"""What was tried and got, so that a reward without noise is not asked for twice."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from sdr_jax.models.features import Features, tables
from sdr_jax.space import Space

CAPACITY = 256
"""Evaluations remembered, the latest."""

REPEATS = 2
"""So many repeats, all with the reward of before to the last bit, are taken for rewards without noise."""

HOPS = 4
"""Bins that may be changed, one after the other, to get away from what was tried."""


class Memory(NamedTuple):
    """The latest evaluations, and what became of repeated ones."""

    actions: Int[Array, "capacity attributes"]
    rewards: Float[Array, "capacity"]  # minus infinity where there is none yet
    seen: Int[Array, ""]  # evaluations with a reward
    same: Int[Array, ""]  # pairs of equal actions with equal rewards
    differ: Int[Array, ""]  # ... with different ones
    best: Int[Array, "attributes"]  # what got the highest reward of all
    highest: Float[Array, ""]  # that reward


def empty(attributes: int) -> Memory:
    """Nothing tried yet."""
    zero = jnp.zeros((), jnp.int32)
    actions = jnp.zeros((CAPACITY, attributes), jnp.int32)
    none = jnp.full(CAPACITY, -jnp.inf, jnp.float32)
    return Memory(actions, none, zero, zero, zero, actions[0], none[0])


def remember(
    memory: Memory, actions: Int[Array, "n attributes"], rewards: Float[Array, "n"]
) -> Memory:
    """Takes evaluations in, failed ones left out."""
    known, n = jnp.isfinite(rewards), len(rewards)
    every = jnp.concatenate([memory.actions, actions])
    got = jnp.concatenate([memory.rewards, jnp.where(known, rewards, -jnp.inf)])
    earlier = jnp.arange(len(every))[None, :] < CAPACITY + jnp.arange(n)[:, None]
    again = earlier & jnp.isfinite(got)[None, :] & known[:, None]
    again &= jnp.all(actions[:, None] == every[None], axis=2)
    alike = got[None, :] == rewards[:, None]
    place = (memory.seen + jnp.cumsum(known) - 1) % CAPACITY
    place = jnp.where(known, place, CAPACITY)  # out of bounds, and dropped
    top = jnp.argmax(got[CAPACITY:])
    better = got[CAPACITY + top] > memory.highest
    return Memory(
        memory.actions.at[place].set(actions, mode="drop"),
        memory.rewards.at[place].set(rewards, mode="drop"),
        memory.seen + known.sum(dtype=jnp.int32),
        memory.same + jnp.sum(again & alike, dtype=jnp.int32),
        memory.differ + jnp.sum(again & ~alike, dtype=jnp.int32),
        jnp.where(better, actions[top], memory.best),
        jnp.where(better, got[CAPACITY + top], memory.highest),
    )


def exact(memory: Memory) -> Bool[Array, ""]:
    """Whether rewards seem to have no noise."""
    return (memory.same >= REPEATS) & (memory.differ == 0)


def untried(
    memory: Memory,
    space: Space,
    layout: Features,
    weights: Float[Array, "n features"],
    actions: Int[Array, "n attributes"],
) -> Int[Array, "n attributes"]:
    """The actions where rewards are noisy; else none that is remembered, or twice among them.

    What was tried is left bin by bin: for the neighbour that is best under the weights given, and new if
    there is a new one.
    """
    n = len(actions)
    rows = jnp.arange(space.attributes)

    def hop(tried: Array, there: Array, own: Array, action: Array) -> Array:
        differs = tried != action[None]
        count = jnp.where(there, differs.sum(axis=1), space.attributes + 1)
        which = jnp.argmax(differs, axis=1)
        neighbours = jnp.zeros((space.attributes, space.max_bins), jnp.int32)
        neighbours = neighbours.at[which, tried[jnp.arange(len(tried)), which]].max(count == 1)
        gain = tables(space, layout, own, action)
        gain = gain - gain[rows, action][:, None]
        # Tried ones only if there is no other, and never the same again.
        below = 2 * jnp.max(jnp.abs(gain), where=jnp.isfinite(gain), initial=1.0)
        gain = gain - below * neighbours
        gain = gain.at[rows, action].set(-jnp.inf)
        attribute, chosen = jnp.unravel_index(jnp.argmax(gain), gain.shape)
        moved = action.at[attribute].set(chosen.astype(jnp.int32))
        return jnp.where(jnp.any(count == 0), moved, action)

    def one(carry: tuple[Array, Array], given: tuple[Array, Array, Array]) -> tuple:
        (tried, there), (k, own, action) = carry, given
        action = jax.lax.fori_loop(0, HOPS, lambda _, a: hop(tried, there, own, a), action)
        place = CAPACITY + k
        return (tried.at[place].set(action), there.at[place].set(True)), action

    def renewed() -> Array:
        tried = jnp.concatenate([memory.actions, actions])
        there = jnp.concatenate([jnp.isfinite(memory.rewards), jnp.zeros(n, bool)])
        return jax.lax.scan(one, (tried, there), (jnp.arange(n), weights, actions))[1]

    return jax.lax.cond(exact(memory), renewed, lambda: actions)
