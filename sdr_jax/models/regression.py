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
"""The least prior precision of a whitened weight, as a share of the trace of the data's precision."""

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
    evaluations: Float[Array, ""]  # evaluations with a reward
    offset: Float[Array, ""]  # near the mean of the rewards; keeps float32 precise

    @property
    def freedom(self) -> Float[Array, ""]:
        """Degrees of freedom: evaluations less one, at least one."""
        return jnp.maximum(self.evaluations - 1, 1)

    @property
    def variance(self) -> Float[Array, ""]:
        """The variance of the rewards; 1 while all are equal, since any scale is then as good as another."""
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
    """Merge evaluations, except failed ones, into the statistics.

    Source: Chan, Golub & LeVeque 1983, "Algorithms for computing the sample variance".
    """
    valid = jnp.isfinite(rewards)
    added = jnp.sum(valid).astype(jnp.float32)
    offset = jnp.where(statistics.evaluations > 0, statistics.offset, _mean(rewards, valid))
    y = jnp.where(valid, rewards - offset, 0.0)
    x_mean, y_mean = _mean(x, valid[:, None]), _mean(y, valid)
    x_off = jnp.where(valid[:, None], x - x_mean[None, :], 0.0)
    y_off = jnp.where(valid, y - y_mean, 0.0)
    x_shift, y_shift = x_mean - statistics.mean, y_mean - statistics.level
    count = statistics.evaluations + added
    share = added / jnp.maximum(count, 1)
    weight = statistics.evaluations * share
    return Statistics(
        gram=statistics.gram + _product(x_off.T, x_off) + weight * jnp.outer(x_shift, x_shift),
        mean=statistics.mean + share * x_shift,
        moment=statistics.moment + _product(x_off.T, y_off) + weight * x_shift * y_shift,
        level=statistics.level + share * y_shift,
        square=statistics.square + jnp.sum(y_off**2) + weight * y_shift**2,
        evaluations=count,
        offset=offset,
    )


def _mean(values: Array, valid: Array) -> Array:
    """The mean of the valid rows; 0 without any."""
    count = jnp.maximum(jnp.sum(valid), 1)
    return jnp.sum(jnp.where(valid, values, 0.0), axis=0) / count


def with_rewards(
    statistics: Statistics, x: Float[Array, "n features"], rewards: Float[Array, "n"]
) -> Statistics:
    """Replace the rewards of the statistics; `x` and `rewards` are those of all evaluations."""
    valid = jnp.isfinite(rewards)
    offset = _mean(rewards, valid)
    level = _mean(rewards - offset, valid)
    y = jnp.where(valid, rewards - offset - level, 0.0)
    x_off = jnp.where(valid[:, None], x - statistics.mean[None, :], 0.0)
    return statistics._replace(
        moment=_product(x_off.T, y), level=level, square=jnp.sum(y**2), offset=offset
    )


def flat(statistics: Statistics) -> Statistics:
    """Replace the rewards of the statistics by equal ones."""
    zero = jnp.zeros((), jnp.float32)
    return statistics._replace(moment=jnp.zeros_like(statistics.moment), level=zero, square=zero)


def posterior(
    data: Statistics, std: Float[Array, "features"], noise: Float[Array, ""]
) -> Posterior:
    """Compute the posterior of the weights of `y = X w + e` with w ~ N(0, std^2) and e ~ N(0, noise^2).

    Whitening, `w = std v`, keeps the precision well conditioned:

        L L' = I + S X'X S / noise^2,   S = diag(std)

    Where single precision would lose the identity in the sum, a larger multiple of it (jitter) is added.

    Args:
        data: the evaluations.
        std: standard deviations of the prior; 0 for absent features.
        noise: standard deviation of a reward.
    """
    ratio = std / noise
    precision = ratio[:, None] * data.gram * ratio[None, :]
    ridge = jnp.maximum(1.0, JITTER * jnp.trace(precision))
    factor = jnp.linalg.cholesky(precision + ridge * jnp.eye(std.shape[0]))
    whitened = cho_solve((factor, True), ratio * data.moment) / noise
    return Posterior(std * whitened, factor, std)


def predict(
    statistics: Statistics,
    belief: Posterior,
    noise: Float[Array, ""],
    x: Float[Array, "n features"],
) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Predict the mean and standard deviation of one reward of each row of features.

    The deviation includes that of the intercept, whose prior is flat. `noise` is a variance.
    """
    count = jnp.maximum(statistics.evaluations, 1)
    off = x - statistics.mean[None, :]
    mean = statistics.offset + statistics.level + off @ belief.mean
    whitened = solve_triangular(belief.factor, (off * belief.scale[None, :]).T, lower=True)
    return mean, jnp.sqrt((whitened**2).sum(axis=0) + noise * (1 + 1 / count))


def covariance(belief: Posterior) -> Float[Array, "features features"]:
    """The covariance of the weights."""
    inverse = solve_triangular(belief.factor, jnp.eye(len(belief.scale)), lower=True)
    return belief.scale[:, None] * _product(inverse.T, inverse) * belief.scale[None, :]


def draw(rng_key: Key[Array, ""], belief: Posterior, n: int) -> Float[Array, "n features"]:
    """Draw weights from the posterior; the key is consumed."""
    noise = jax.random.normal(rng_key, (belief.mean.shape[0], n), jnp.float32)
    whitened = solve_triangular(belief.factor, noise, lower=True, trans=1)
    return belief.mean[None, :] + belief.scale[None, :] * whitened.T
