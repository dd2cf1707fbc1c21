"""A history of rewards, which finds penalties far below the others so that a model can clip them."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sdr_jax.models import regression
from sdr_jax.models.regression import Statistics

CAPACITY = 2048
"""Evaluations that are kept, the first; later ones leave it at the lowest reward that then counts."""

REACH = 5.0
"""Interquartile ranges below the median from which on a reward is far below the others."""

FEWEST = 8
"""Fewer rewards say too little about their quartiles."""

EARLY = 32
"""The first rewards, of data sets from everywhere; later ones differ less, the nearer the search has come."""


class History(NamedTuple):
    """What was tried and got, and the lowest that a reward counts as."""

    actions: Int[Array, "capacity attributes"]
    rewards: Float[Array, "capacity"]  # NaN where there is none
    floor: Float[Array, ""]  # what lower rewards count as; minus infinity for none
    clipped: Int[Array, ""]  # how many of the rewards are lower


def empty(attributes: int) -> History:
    """Nothing tried yet."""
    return History(
        jnp.zeros((CAPACITY, attributes), jnp.int32),
        jnp.full(CAPACITY, jnp.nan, jnp.float32),
        jnp.asarray(-jnp.inf, jnp.float32),
        jnp.zeros((), jnp.int32),
    )


def lowest(rewards: Float[Array, "capacity"]) -> Float[Array, ""]:
    """The lowest of the known rewards that are not far below the others; minus infinity where none is.

    Far below is more than five interquartile ranges below the median: the range of all rewards or that of
    the first ones, if that is larger. Where it is 0 none is far below.
    """
    known = jnp.isfinite(rewards)
    reach, median = _quartiles(rewards)
    reach = jnp.fmax(reach, _quartiles(rewards[:EARLY])[0])
    limit = jnp.where((known.sum() >= FEWEST) & (reach > 0), median - REACH * reach, -jnp.inf)
    far = rewards < limit  # false of NaN
    return jnp.where(far.any(), jnp.min(rewards, where=known & ~far, initial=jnp.inf), -jnp.inf)


def _quartiles(rewards: Float[Array, "n"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The interquartile range and the median of the distinct rewards.

    Distinct, so that a penalty counts once, however often it is given. And four times the range's upper
    half is taken for it where that is less: the lower quartile may be a penalty itself.
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
    """Adds evaluations, except failed ones; a reward far below the others counts as the lowest of these.

    If that changes what earlier rewards count as, the statistics are computed anew.

    Args:
        history: before them.
        statistics: of the history.
        features: of actions.
        actions: what was tried.
        rewards: what it got.

    Returns:
        History and statistics, and by which factor the variance of the earlier rewards changed.
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
    flat = jnp.nanmin(told) == jnp.nanmax(told)  # to the bit: a mean of equal numbers may differ
    statistics = jax.tree.map(
        lambda some, none: jnp.where(flat, none, some), statistics, regression.flat(statistics)
    )
    clipped = jnp.sum(told < floor, dtype=jnp.int32)
    return History(tried, told, floor, clipped), statistics, ratio
