"""Bayesian linear regression from sufficient statistics, whose size does not grow with the data.

The intercept has a flat prior; centring integrates it out.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import cho_solve, solve_triangular
from jaxtyping import Array, Float, Key


class Statistics(NamedTuple):
    """The sufficient statistics of the evaluations, with the offset subtracted from rewards."""

    gram: Float[Array, "features features"]  # X'X
    sums: Float[Array, "features"]  # X'1
    moment: Float[Array, "features"]  # X'y
    total: Float[Array, ""]  # 1'y
    square: Float[Array, ""]  # y'y
    seen: Float[Array, ""]  # evaluations with a reward
    offset: Float[Array, ""]  # mean of the first rewards; keeps float32 precise


class Centred(NamedTuple):
    """The statistics around their means, and their degrees of freedom."""

    gram: Float[Array, "features features"]
    moment: Float[Array, "features"]
    square: Float[Array, ""]
    freedom: Float[Array, ""]  # evaluations less one, at least one


class Posterior(NamedTuple):
    """A normal distribution of the weights, `mean + scale L^-T z`."""

    mean: Float[Array, "features"]
    factor: Float[Array, "features features"]  # L, lower, of the whitened precision
    scale: Float[Array, "features"]  # prior standard deviation of each weight


def empty(features: int) -> Statistics:
    """The statistics before any evaluation."""
    zero = jnp.zeros((), jnp.float32)
    vector = jnp.zeros(features, jnp.float32)
    gram = jnp.zeros((features, features), jnp.float32)
    return Statistics(gram, vector, vector, zero, zero, zero, zero)


def add(
    statistics: Statistics, x: Float[Array, "n features"], rewards: Float[Array, "n"]
) -> Statistics:
    """Adds evaluations to the statistics, except failed ones."""
    known = jnp.isfinite(rewards)
    count = jnp.sum(known).astype(jnp.float32)
    mean = jnp.sum(jnp.where(known, rewards, 0.0)) / jnp.maximum(count, 1)
    offset = jnp.where(statistics.seen > 0, statistics.offset, mean)
    y = jnp.where(known, rewards - offset, 0.0)
    x = jnp.where(known[:, None], x, 0.0)
    return Statistics(
        gram=statistics.gram + x.T @ x,
        sums=statistics.sums + x.sum(axis=0),
        moment=statistics.moment + x.T @ y,
        total=statistics.total + y.sum(),
        square=statistics.square + jnp.sum(y**2),
        seen=statistics.seen + count,
        offset=offset,
    )


def with_rewards(
    statistics: Statistics, x: Float[Array, "n features"], rewards: Float[Array, "n"]
) -> Statistics:
    """The statistics of the same evaluations with other rewards; it takes all evaluations."""
    known = jnp.isfinite(rewards)
    offset = jnp.nanmean(rewards)
    y = jnp.where(known, rewards - offset, 0.0)
    return statistics._replace(
        moment=jnp.where(known[:, None], x, 0.0).T @ y,
        total=y.sum(),
        square=jnp.sum(y**2),
        offset=offset,
    )


def flat(statistics: Statistics) -> Statistics:
    """The statistics of the same evaluations as if all rewards were equal."""
    zero = jnp.zeros((), jnp.float32)
    return statistics._replace(moment=jnp.zeros_like(statistics.moment), total=zero, square=zero)


def centred(statistics: Statistics) -> Centred:
    """Subtracts the means."""
    count = jnp.maximum(statistics.seen, 1)
    freedom = jnp.maximum(statistics.seen - 1, 1)
    square = jnp.maximum(statistics.square - statistics.total**2 / count, 0.0)
    return Centred(
        gram=statistics.gram - jnp.outer(statistics.sums, statistics.sums) / count,
        moment=statistics.moment - statistics.sums * statistics.total / count,
        # While all rewards are equal, any scale is as good as another.
        square=jnp.where(square > 0, square, freedom),
        freedom=freedom,
    )


def posterior(data: Centred, std: Float[Array, "features"], noise: Float[Array, ""]) -> Posterior:
    """The weights' posterior, of `y = X w + e` with w ~ N(0, std^2) and e ~ N(0, noise^2).

    Whitening, `w = std v`, keeps the precision well conditioned:

        L L' = I + S X'X S / noise^2,   S = diag(std)

    Args:
        data: the evaluations.
        std: the prior's standard deviations; 0 for absent features.
        noise: standard deviation of a reward.
    """
    ratio = std / noise
    precision = ratio[:, None] * data.gram * ratio[None, :] + jnp.eye(std.shape[0])
    factor = jnp.linalg.cholesky(precision)
    whitened = cho_solve((factor, True), ratio * data.moment) / noise
    return Posterior(std * whitened, factor, std)


def predicted(
    statistics: Statistics,
    belief: Posterior,
    noise: Float[Array, ""],
    x: Float[Array, "n features"],
) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Mean and standard deviation of one reward of each row of features; `noise` is a variance.

    The deviation holds that of the mean reward, too, whose prior is flat.
    """
    count = jnp.maximum(statistics.seen, 1)
    off = x - (statistics.sums / count)[None, :]
    mean = statistics.offset + statistics.total / count + off @ belief.mean
    whitened = solve_triangular(belief.factor, (off * belief.scale[None, :]).T, lower=True)
    return mean, jnp.sqrt((whitened**2).sum(axis=0) + noise * (1 + 1 / count))


def covariance(belief: Posterior) -> Float[Array, "features features"]:
    """The covariance of the weights."""
    inverse = solve_triangular(belief.factor, jnp.eye(len(belief.scale)), lower=True)
    return belief.scale[:, None] * (inverse.T @ inverse) * belief.scale[None, :]


def draw(rng_key: Key[Array, ""], belief: Posterior, n: int) -> Float[Array, "n features"]:
    """Draws weights; the key is consumed."""
    noise = jax.random.normal(rng_key, (belief.mean.shape[0], n))
    whitened = solve_triangular(belief.factor, noise, lower=True, trans=1)
    return belief.mean[None, :] + belief.scale[None, :] * whitened.T
