"""The history of rewards, in which those far below the others are clipped before a model learns."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sdr_jax import trees
from sdr_jax.models import regression
from sdr_jax.models.regression import Statistics

CAPACITY = 2048
"""Evaluations that the history keeps; later ones no longer change its floor."""

REACH = 5.0
"""A reward is far below the others if it is more than so many interquartile ranges below the median."""

FEWEST = 8
"""The least number of rewards from which quartiles are estimated."""

EARLY = 32
"""Number of first rewards, whose data sets cover the whole space; later rewards differ less."""


class History(NamedTuple):
    """The actions, their rewards, and the lowest value that a reward counts as."""

    actions: Int[Array, "capacity attributes"]
    rewards: Float[Array, "capacity"]  # NaN where there is none
    floor: Float[Array, ""]  # lower rewards count as this; minus infinity for none
    clipped: Int[Array, ""]  # number of rewards below the floor
    evaluations: Int[Array, ""]  # number of all evaluations, failed ones included


def empty(attributes: int) -> History:
    """The history before any evaluation."""
    return History(
        jnp.zeros((CAPACITY, attributes), jnp.int32),
        jnp.full(CAPACITY, jnp.nan, jnp.float32),
        jnp.asarray(-jnp.inf, jnp.float32),
        jnp.zeros((), jnp.int32),
        jnp.zeros((), jnp.int32),
    )


def lowest(rewards: Float[Array, "capacity"]) -> Float[Array, ""]:
    """Find the lowest reward that is not far below the others; minus infinity if none is far below.

    Far below means more than five interquartile ranges below the median, with the range of all rewards or
    of the first ones, whichever is larger. If it is 0, no reward is far below.
    """
    finite = jnp.isfinite(rewards)
    iqr, median = _quartiles(rewards)
    iqr = jnp.fmax(iqr, _quartiles(rewards[:EARLY])[0])
    limit = jnp.where((finite.sum() >= FEWEST) & (iqr > 0), median - REACH * iqr, -jnp.inf)
    far = rewards < limit  # false of NaN
    return jnp.where(far.any(), jnp.min(rewards, where=finite & ~far, initial=jnp.inf), -jnp.inf)


def first_variance(history: History) -> Float[Array, ""]:
    """The variance of the first rewards, clipped as the model sees them; NaN before any."""
    return jnp.nanvar(jnp.maximum(history.rewards[:EARLY], history.floor))


def _quartiles(rewards: Float[Array, "n"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Compute the interquartile range and the median of the distinct rewards.

    Distinct values make a repeated penalty count once. The range is at most four times its upper half,
    since the lower quartile may be a penalty itself.
    """
    ranked = jnp.sort(rewards)  # NaN comes last
    distinct = jnp.append(True, ranked[1:] != ranked[:-1])
    quartiles = jnp.asarray([0.25, 0.5, 0.75])
    low, median, high = jnp.nanquantile(jnp.where(distinct, ranked, jnp.nan), quartiles)
    return jnp.minimum(high - low, 4 * (high - median)), median


def learn(
    history: History,
    statistics: Statistics,
    features: Callable[[Int[Array, "n attributes"]], Float[Array, "n features"]],
    actions: Int[Array, "n attributes"],
    rewards: Float[Array, "n"],
) -> tuple[History, Statistics, Float[Array, ""]]:
    """Add evaluations, and clip rewards far below the others; failed ones are only counted.

    If the floor of earlier rewards changes, the statistics are computed again.

    Args:
        history: the history before them.
        statistics: the statistics of the history.
        features: computes the features of actions.
        actions: the actions of the evaluations.
        rewards: their rewards.

    Returns:
        The history, the statistics, and the factor by which the variance of earlier rewards changed.
    """
    finite = jnp.isfinite(rewards)
    place = jnp.isfinite(history.rewards).sum() + jnp.cumsum(finite) - 1
    place = jnp.where(finite, place, CAPACITY)  # out of bounds, and dropped
    all_rewards = history.rewards.at[place].set(rewards, mode="drop")
    all_actions = history.actions.at[place].set(actions, mode="drop")
    is_full = jnp.max(jnp.where(finite, place, 0)) >= CAPACITY
    floor = jnp.where(is_full, history.floor, lowest(all_rewards))

    before, after = (jnp.maximum(history.rewards, low) for low in (history.floor, floor))
    moved = jnp.any(before != after, where=jnp.isfinite(before))
    variance = jnp.nanvar(before)
    ratio = jnp.where(moved & (variance > 0), jnp.nanvar(after) / variance, 1.0)
    added = regression.add(statistics, features(actions), jnp.maximum(rewards, floor))
    statistics = jax.lax.cond(
        moved,
        lambda: regression.with_rewards(
            added, features(all_actions), jnp.maximum(all_rewards, floor)
        ),
        lambda: added,
    )
    # Exact, unlike a comparison with their mean.
    all_equal = jnp.nanmin(all_rewards) == jnp.nanmax(all_rewards)
    statistics = trees.where(all_equal, regression.flat(statistics), statistics)
    clipped = jnp.sum(all_rewards < floor, dtype=jnp.int32)
    count = history.evaluations + len(rewards)
    return History(all_actions, all_rewards, floor, clipped, count), statistics, ratio
