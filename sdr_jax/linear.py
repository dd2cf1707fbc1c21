"""A Bayesian linear model of the reward: smooth in every attribute, pairwise within groups."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import cho_solve, solve_triangular
from jaxtyping import Array, Float, Int, Key

from sdr_jax import bins
from sdr_jax.features import evaluate, features, maximise, tables
from sdr_jax.method import Info, Method, jitted, plain_info
from sdr_jax.space import UNDECIDED, Proposal, Space, check_relaxation, relax

SIGNALS = np.geomspace(0.003, 30, 7).astype(np.float32)
"""Prior variances of an effect, relative to the noise's, among which the evidence chooses."""

DRAWS = 64
"""Draws from the posterior behind `spread` and `probabilities`."""

CAUTION = 2.0
"""Standard errors that an effect must exceed before `spread` narrows its attribute."""


class LinearState(NamedTuple):
    """Sufficient statistics of all evaluations, of rewards less the offset."""

    gram: Float[Array, "features features"]  # X'X
    sums: Float[Array, "features"]  # X'1
    moment: Float[Array, "features"]  # X'y
    total: Float[Array, ""]  # 1'y
    square: Float[Array, ""]  # y'y
    seen: Float[Array, ""]  # evaluations with a reward
    offset: Float[Array, ""]  # mean of the first rewards; takes large means out of float32


class Posterior(NamedTuple):
    """A normal distribution of the weights, `mean + scale L^-T z`."""

    mean: Float[Array, "features"]
    factor: Float[Array, "features features"]  # L, lower, of the whitened precision
    scale: Float[Array, "features"]  # noise and prior standard deviation of each weight


def linear(
    space: Space,
    width: float | tuple[float, ...] | None = None,
    *,
    explore: float = 1.0,
    degree: int = 4,
    pair_degree: int = 2,
    interaction: float = 0.5,
) -> Method:
    """Thompson sampling on a ridge regression of the reward on the bins.

        y = b + sum_i f_i(a_i) + sum_{i<j in a group} g_ij(a_i, a_j) + noise

    f_i is a cosine series in the bin's value, so neighbouring bins are alike, g_ij a product of two
    shorter ones. Weights have a normal prior that falls with the frequency; its size relative to
    the noise is chosen by the evidence at every update, the noise by its posterior mean. Every
    data set is the best of a model drawn from the posterior: coordinate ascent from a few starts.

    `solution` is the best of the posterior's mean model. `spread` asks for each attribute, the
    others at the solution, which bin is best in models drawn from the posterior, at twice its
    standard deviation, and takes the moments of that distribution: an attribute whose effect drowns
    in the noise stays wide. NaN
    rewards are passed by.

    Args:
        space: the attributes, their bins, and the groups whose members may interact.
        width: of the relaxed bins, see `relax`.
        explore: factor on the posterior's standard deviation in `sample`; 1 is Thompson sampling,
            which explores for longer than a small budget lasts when there are many attributes.
        degree: cosines per attribute, at most its bins less one.
        pair_degree: cosines per attribute in interactions; 0 is an additive model.
        interaction: prior variance of an interaction's weights, relative to the attributes' own.

    Returns:
        The method, for any number of updates; `entropy` in its info is NaN.

    Raises:
        ValueError: an option out of range.

    Source: not in the paper; Thompson 1933; Rasmussen and Williams 2006, chapter 2.
    """
    check_relaxation(space, width, "random")
    if not (explore >= 0 and np.isfinite(explore)):
        raise ValueError(f"explore is {explore}, but must be 0 or more")
    layout = features(space, degree, pair_degree, interaction)
    prior_std = np.sqrt(layout.variance)
    size = len(prior_std)

    def init(rng_key: Key[Array, ""]) -> LinearState:
        del rng_key  # nothing is random before the first sample
        zero = jnp.zeros((), jnp.float32)
        vector = jnp.zeros(size, jnp.float32)
        return LinearState(
            jnp.zeros((size, size), jnp.float32), vector, vector, zero, zero, zero, zero
        )

    def posterior(state: LinearState) -> Posterior:
        # The intercept has a flat prior: it is integrated out by centring.
        count = jnp.maximum(state.seen, 1)
        gram = state.gram - jnp.outer(state.sums, state.sums) / count
        moment = state.moment - state.sums * state.total / count
        square = jnp.maximum(state.square - state.total**2 / count, 0.0)
        freedom = jnp.maximum(state.seen - 1, 1)
        # Without any difference between rewards every scale is as good as another.
        square = jnp.where(square > 0, square, freedom)

        def fit(signal: Array) -> tuple[Posterior, Array]:
            std = jnp.sqrt(signal) * jnp.asarray(prior_std)
            precision = std[:, None] * gram * std[None, :] + jnp.eye(size)
            factor = jnp.linalg.cholesky(precision)
            whitened = cho_solve((factor, True), std * moment)
            left = jnp.maximum(square - jnp.dot(whitened, std * moment), 1e-4 * square)
            log_det = 2 * jnp.sum(jnp.log(jnp.diag(factor)))
            evidence = -0.5 * (log_det + freedom * jnp.log(left))
            noise = jnp.sqrt(left / freedom)
            return Posterior(std * whitened, factor, noise * std), evidence

        fits, evidence = jax.lax.map(fit, jnp.asarray(SIGNALS))
        best = jnp.argmax(evidence)
        return jax.tree.map(lambda leaf: leaf[best], fits)

    def draw(
        rng_key: Key[Array, ""], belief: Posterior, n: int, factor: float
    ) -> Array:  # f32[n features]
        noise = factor * jax.random.normal(rng_key, (size, n))
        whitened = solve_triangular(belief.factor, noise, lower=True, trans=1)
        return belief.mean[None, :] + belief.scale[None, :] * whitened.T

    def thompson(rng_key: Key[Array, ""], belief: Posterior, n: int) -> Array:
        draw_key, start_key = jax.random.split(rng_key)
        weights = draw(draw_key, belief, n, explore)
        return jax.vmap(lambda key, one: maximise(key, space, layout, one))(
            jax.random.split(start_key, n), weights
        )

    def sample(
        rng_key: Key[Array, ""], state: LinearState, n: int
    ) -> tuple[Int[Array, "n attributes"], Proposal]:
        random_key, thompson_key = jax.random.split(rng_key)
        shape = (n, space.attributes)
        sizes = jnp.broadcast_to(jnp.asarray(space.bins, jnp.int32), shape)
        random = jax.random.randint(random_key, shape, 0, sizes, jnp.int32)
        chosen = thompson(thompson_key, posterior(state), n)
        actions = jnp.where(state.seen > 1, chosen, random)  # two rewards make a difference
        return actions, relax(space, actions, width)

    def update(
        state: LinearState, actions: Int[Array, "n attributes"], rewards: Float[Array, "n"]
    ) -> tuple[LinearState, Info]:
        known = jnp.isfinite(rewards)
        count = jnp.sum(known).astype(jnp.float32)
        mean = jnp.sum(jnp.where(known, rewards, 0.0)) / jnp.maximum(count, 1)
        offset = jnp.where(state.seen > 0, state.offset, mean)
        y = jnp.where(known, rewards - offset, 0.0)
        x = jnp.where(known[:, None], evaluate(layout, actions), 0.0)
        next_state = LinearState(
            gram=state.gram + x.T @ x,
            sums=state.sums + x.sum(axis=0),
            moment=state.moment + x.T @ y,
            total=state.total + y.sum(),
            square=state.square + jnp.sum(y**2),
            seen=state.seen + count,
            offset=offset,
        )
        return next_state, plain_info(rewards, jnp.asarray(jnp.nan, jnp.float32))

    def best_of(belief: Posterior) -> Array:
        return maximise(jax.random.key(0), space, layout, belief.mean)

    def solution(state: LinearState) -> Proposal:
        best = best_of(posterior(state))
        return relax(space, jnp.where(state.seen > 1, best, UNDECIDED), width)

    def spread(state: LinearState) -> Proposal:
        belief = posterior(state)
        best = best_of(belief)
        weights = draw(jax.random.key(1), belief, DRAWS, CAUTION)
        values = jax.vmap(lambda one: tables(space, layout, one, best))(weights)
        winners = jax.nn.one_hot(jnp.argmax(values, axis=2), space.max_bins)
        p = jnp.where(state.seen > 1, winners.mean(axis=0), bins.uniform(space))
        return bins.spread(space, p, width)

    def probabilities(state: LinearState) -> Float[Array, "attributes bins"]:
        actions = thompson(jax.random.key(1), posterior(state), DRAWS)
        p = jax.nn.one_hot(actions, space.max_bins).mean(axis=0)
        return jnp.where(state.seen > 1, p, bins.uniform(space))

    return jitted(
        init=init,
        sample=sample,
        update=update,
        solution=solution,
        spread=spread,
        probabilities=probabilities,
    )
