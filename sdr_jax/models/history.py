"""A history of rewards, which finds rewards far below the others so that a model can clip them."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sdr_jax.models import regression
from sdr_jax.models.regression import Statistics

CAPACITY = 2048
"""Number of evaluations that the history keeps; later ones no longer change its floor."""

REACH = 5.0
"""A reward is far below the others if it is more than so many interquartile ranges below the median."""

FEWEST = 8
"""The least number of rewards from which quartiles are estimated."""

EARLY = 32
"""Number of first rewards, whose data sets come from everywhere; later rewards differ less."""


class History(NamedTuple):
    """The actions, their rewards, and the lowest value that a reward counts as."""

    actions: Int[Array, "capacity attributes"]
    rewards: Float[Array, "capacity"]  # NaN where there is none
    floor: Float[Array, ""]  # lower rewards count as this; minus infinity for none
    clipped: Int[Array, ""]  # number of rewards below the floor


def empty(attributes: int) -> History:
    """The history before any evaluation."""
    return History(
        jnp.zeros((CAPACITY, attributes), jnp.int32),
        jnp.full(CAPACITY, jnp.nan, jnp.float32),
        jnp.asarray(-jnp.inf, jnp.float32),
        jnp.zeros((), jnp.int32),
    )


def lowest(rewards: Float[Array, "capacity"]) -> Float[Array, ""]:
    """The lowest known reward that is not far below the others; minus infinity if none is far below.

    Far below means more than five interquartile ranges below the median, with the range of all rewards or
    of the first ones, whichever is larger. If it is 0, no reward is far below.
    """
    known = jnp.isfinite(rewards)
    reach, median = _quartiles(rewards)
    reach = jnp.fmax(reach, _quartiles(rewards[:EARLY])[0])
    limit = jnp.where((known.sum() >= FEWEST) & (reach > 0), median - REACH * reach, -jnp.inf)
    far = rewards < limit  # false of NaN
    return jnp.where(far.any(), jnp.min(rewards, where=known & ~far, initial=jnp.inf), -jnp.inf)


def first_variance(history: History) -> Float[Array, ""]:
    """The variance of the first rewards, clipped as the model sees them; NaN before any."""
    return jnp.nanvar(jnp.maximum(history.rewards[:EARLY], history.floor))


def _quartiles(rewards: Float[Array, "n"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The interquartile range and the median of the distinct rewards.

    Distinct values make a repeated penalty count once. The range is at most four times its upper half,
    since the lower quartile may be a penalty itself.
    """
    ranked = jnp.sort(rewards)  # NaN comes last
    new = jnp.append(True, ranked[1:] != ranked[:-1])
    quartiles = jnp.asarray([0.25, 0.5, 0.75])
    low, median, high = jnp.nanquantile(jnp.where(new, ranked, jnp.nan), quartiles)
    return jnp.minimum(high - low, 4 * (high - median)), median


def learn(
    history: History,
    statistics: Statistics,
    features: Callable[[Int[Array, "n attributes"]], Float[Array, "n features"]],
    actions: Int[Array, "n attributes"],
    rewards: Float[Array, "n"],
) -> tuple[History, Statistics, Float[Array, ""]]:
    """Adds evaluations, except failed ones, and clips rewards far below the others.

    If the floor of earlier rewards changes, the statistics are computed anew.

    Args:
        history: the history before them.
        statistics: the statistics of the history.
        features: gives the features of actions.
        actions: the actions of the evaluations.
        rewards: their rewards.

    Returns:
        History, statistics, and the factor by which the variance of earlier rewards changed.
    """
    known = jnp.isfinite(rewards)
    place = jnp.isfinite(history.rewards).sum() + jnp.cumsum(known) - 1
    kept = jnp.where(known, place, CAPACITY)  # out of bounds, and dropped
    told = history.rewards.at[kept].set(rewards, mode="drop")
    tried = history.actions.at[kept].set(actions, mode="drop")
    more = jnp.max(jnp.where(known, place, 0)) >= CAPACITY
    floor = jnp.where(more, history.floor, lowest(told))

    before, after = (jnp.maximum(history.rewards, at) for at in (history.floor, floor))
    moved = jnp.any(before != after, where=jnp.isfinite(before))
    spread = jnp.nanvar(before)
    ratio = jnp.where(moved & (spread > 0), jnp.nanvar(after) / spread, 1.0)
    grown = regression.add(statistics, features(actions), jnp.maximum(rewards, floor))
    statistics = jax.lax.cond(
        moved,
        lambda: regression.with_rewards(grown, features(tried), jnp.maximum(told, floor)),
        lambda: grown,
    )
    flat = jnp.nanmin(told) == jnp.nanmax(told)  # exact, unlike a comparison with their mean
    statistics = jax.tree.map(
        lambda some, none: jnp.where(flat, none, some), statistics, regression.flat(statistics)
    )
    clipped = jnp.sum(told < floor, dtype=jnp.int32)
    return History(tried, told, floor, clipped), statistics, ratio
