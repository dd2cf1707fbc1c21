"""Bayesian linear regression from sufficient statistics, whose size does not grow with the data.

The intercept has a flat prior; centring integrates it out.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import cho_solve, solve_triangular
from jaxtyping import Array, Float, Key

JITTER = 1e-6
"""The least prior precision of a whitened weight, as a share of the trace of what the data say."""

_product = partial(jnp.matmul, precision=jax.lax.Precision.HIGHEST)


class Statistics(NamedTuple):
    """The sufficient statistics of the evaluations, around their means.

    Raw moments, centred by subtraction, lose all digits in single precision once the spread is small.
    """

    gram: Float[Array, "features features"]  # sum of (x - mean)(x - mean)'
    mean: Float[Array, "features"]  # of x
    moment: Float[Array, "features"]  # sum of (x - mean)(y - level)
    level: Float[Array, ""]  # mean of y, the rewards less the offset
    square: Float[Array, ""]  # sum of (y - level)^2
    seen: Float[Array, ""]  # evaluations with a reward
    offset: Float[Array, ""]  # mean of the first rewards; keeps float32 precise

    @property
    def freedom(self) -> Float[Array, ""]:
        """Evaluations less one, at least one."""
        return jnp.maximum(self.seen - 1, 1)

    @property
    def variance(self) -> Float[Array, ""]:
        """The variance of the rewards; 1 while all are equal, as any scale is then as good as another."""
        return jnp.where(self.square > 0, self.square / self.freedom, 1.0)


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
    """Merges evaluations, except failed ones, into the statistics.

    Source: Chan, Golub & LeVeque 1983, "Algorithms for computing the sample variance".
    """
    valid = jnp.isfinite(rewards)
    count = jnp.sum(valid).astype(jnp.float32)
    offset = jnp.where(statistics.seen > 0, statistics.offset, _mean(rewards, valid))
    y = jnp.where(valid, rewards - offset, 0.0)
    x_mean, y_mean = _mean(x, valid[:, None]), _mean(y, valid)
    x_off = jnp.where(valid[:, None], x - x_mean[None, :], 0.0)
    y_off = jnp.where(valid, y - y_mean, 0.0)
    x_shift, y_shift = x_mean - statistics.mean, y_mean - statistics.level
    seen = statistics.seen + count
    share = count / jnp.maximum(seen, 1)
    weight = statistics.seen * share
    return Statistics(
        gram=statistics.gram + _product(x_off.T, x_off) + weight * jnp.outer(x_shift, x_shift),
        mean=statistics.mean + share * x_shift,
        moment=statistics.moment + _product(x_off.T, y_off) + weight * x_shift * y_shift,
        level=statistics.level + share * y_shift,
        square=statistics.square + jnp.sum(y_off**2) + weight * y_shift**2,
        seen=seen,
        offset=offset,
    )


def _mean(values: Array, valid: Array) -> Array:
    """The mean of the valid rows; 0 without any."""
    count = jnp.maximum(jnp.sum(valid), 1)
    return jnp.sum(jnp.where(valid, values, 0.0), axis=0) / count


def with_rewards(
    statistics: Statistics, x: Float[Array, "n features"], rewards: Float[Array, "n"]
) -> Statistics:
    """The statistics of the same evaluations with other rewards; it takes all evaluations."""
    valid = jnp.isfinite(rewards)
    offset = _mean(rewards, valid)
    level = _mean(rewards - offset, valid)
    y = jnp.where(valid, rewards - offset - level, 0.0)
    x_off = jnp.where(valid[:, None], x - statistics.mean[None, :], 0.0)
    return statistics._replace(
        moment=_product(x_off.T, y), level=level, square=jnp.sum(y**2), offset=offset
    )


def flat(statistics: Statistics) -> Statistics:
    """The statistics of the same evaluations as if all rewards were equal."""
    zero = jnp.zeros((), jnp.float32)
    return statistics._replace(moment=jnp.zeros_like(statistics.moment), level=zero, square=zero)


def posterior(
    data: Statistics, std: Float[Array, "features"], noise: Float[Array, ""]
) -> Posterior:
    """The weights' posterior, of `y = X w + e` with w ~ N(0, std^2) and e ~ N(0, noise^2).

    Whitening, `w = std v`, keeps the precision well conditioned:

        L L' = I + S X'X S / noise^2,   S = diag(std)

    Where single precision does not resolve the identity beside the data, a larger multiple of it (jitter)
    stands in its place.

    Args:
        data: the evaluations.
        std: the prior's standard deviations; 0 for absent features.
        noise: standard deviation of a reward.
    """
    ratio = std / noise
    precision = ratio[:, None] * data.gram * ratio[None, :]
    ridge = jnp.maximum(1.0, JITTER * jnp.trace(precision))
    factor = jnp.linalg.cholesky(precision + ridge * jnp.eye(std.shape[0]))
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
    off = x - statistics.mean[None, :]
    mean = statistics.offset + statistics.level + off @ belief.mean
    whitened = solve_triangular(belief.factor, (off * belief.scale[None, :]).T, lower=True)
    return mean, jnp.sqrt((whitened**2).sum(axis=0) + noise * (1 + 1 / count))


def covariance(belief: Posterior) -> Float[Array, "features features"]:
    """The covariance of the weights."""
    inverse = solve_triangular(belief.factor, jnp.eye(len(belief.scale)), lower=True)
    return belief.scale[:, None] * _product(inverse.T, inverse) * belief.scale[None, :]


def draw(rng_key: Key[Array, ""], belief: Posterior, n: int) -> Float[Array, "n features"]:
    """Draws weights; the key is consumed."""
    noise = jax.random.normal(rng_key, (belief.mean.shape[0], n))
    whitened = solve_triangular(belief.factor, noise, lower=True, trans=1)
    return belief.mean[None, :] + belief.scale[None, :] * whitened.T
