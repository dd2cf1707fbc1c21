"""A Bayesian linear model of the reward: smooth in every attribute, pairwise within groups."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sdr_jax.method import Bins, Info, Method, Rewards, RngKey, jitted, plain_info
from sdr_jax.models import history, regression
from sdr_jax.models.features import (
    affordable,
    evaluate,
    features,
    maximise,
    maximise_each,
    tables,
)
from sdr_jax.models.history import History
from sdr_jax.models.regression import Posterior, Statistics
from sdr_jax.relaxation import UNDECIDED, check_relaxation, moments, random_bins, relax, uniform
from sdr_jax.space import Proposal, Space, Width

SIGNALS = np.geomspace(0.003, 30, 7).astype(np.float32)
"""Prior variances of an effect, relative to the noise's, among which the evidence chooses."""

DRAWS = 64
"""Draws from the posterior behind `spread` and `probabilities`."""

CAUTION = 2.0
"""Standard errors that an effect must exceed before `spread` narrows its attribute."""


class LinearState(NamedTuple):
    """What the regression has learnt."""

    history: History
    statistics: Statistics
    belief: Posterior  # of the weights
    noise: Float[Array, ""]  # variance of a reward


def linear(
    space: Space,
    width: Width = None,
    *,
    explore: float = 1.0,
    degree: int = 4,
    pair_degree: int | None = None,
    interaction: float = 0.5,
) -> Method:
    """Thompson sampling on a ridge regression of the reward on the bins.

        y = b + sum_i f_i(a_i) + sum_{i<j in a group} g_ij(a_i, a_j) + noise

    f_i is a cosine series in the bin's value, so neighbouring bins are alike, g_ij a product of two
    shorter ones. Weights have a normal prior that falls with the frequency; its size relative to
    the noise is chosen by the evidence at every update, the noise by its posterior mean. Every
    data set is the best of a model drawn from the posterior: coordinate ascent from a few starts.

    Rewards far below the others, such as the penalty for a crash, are clipped (`history.py`).

    `solution` is the best of the posterior's mean model; while all rewards are the same, there is none.
    `spread` asks for each attribute, the others at the solution, which bin is best in models drawn from
    the posterior, at twice its standard deviation, and takes the moments of that distribution: an
    attribute whose effect is small beside the noise stays wide.

    Args:
        space: the attributes, their bins, and the groups whose members may interact.
        width: of the relaxed bins, see `relax`.
        explore: factor on the posterior's standard deviation in `sample`; 1 is Thompson sampling,
            which explores for longer than a small budget lasts when there are many attributes.
        degree: cosines per attribute, at most its bins less one.
        pair_degree: cosines per attribute in interactions, 0 for an additive model; by default 2, or fewer
            where these would be more than about 256 features, and none in large groups.
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
    if pair_degree is None:
        pair_degree = min(2, affordable(space, degree))
    layout = features(space, degree, pair_degree, interaction)
    prior_std = np.sqrt(layout.variance)
    size = len(prior_std)

    def init(rng_key: RngKey) -> LinearState:
        del rng_key  # nothing is random before the first sample
        return fitted(history.empty(space.attributes), regression.empty(size))

    def fitted(seen: History, statistics: Statistics) -> LinearState:
        stds = jnp.sqrt(jnp.asarray(SIGNALS))[:, None] * jnp.asarray(prior_std)[None, :]
        return LinearState(
            seen, statistics, *regression.by_evidence(regression.centred(statistics), stds)
        )

    def known(state: LinearState) -> Array:
        return state.statistics.square > 0  # some rewards differ

    def thompson(rng_key: RngKey, belief: Posterior, n: int) -> Array:
        draw_key, start_key = jax.random.split(rng_key)
        weights = regression.draw(draw_key, belief, n, explore)
        return maximise_each(start_key, space, layout, weights)

    def sample(rng_key: RngKey, state: LinearState, n: int) -> tuple[Bins, Proposal]:
        random_key, thompson_key = jax.random.split(rng_key)
        random, chosen = random_bins(random_key, space, n), thompson(thompson_key, state.belief, n)
        actions = jnp.where(known(state), chosen, random)
        return actions, relax(space, actions, width)

    def update(state: LinearState, actions: Bins, rewards: Rewards) -> tuple[LinearState, Info]:
        seen, statistics, _ = history.learn(
            state.history, state.statistics, partial(evaluate, layout), actions, rewards
        )
        info = plain_info(rewards, jnp.asarray(jnp.nan, jnp.float32))
        return fitted(seen, statistics), info._replace(clipped=seen.clipped)

    def best_of(belief: Posterior) -> Array:
        return maximise(jax.random.key(0), space, layout, belief.mean)

    def solution(state: LinearState) -> Proposal:
        best = best_of(state.belief)
        return relax(space, jnp.where(known(state), best, UNDECIDED), width)

    def spread(state: LinearState) -> Proposal:
        best = best_of(state.belief)
        weights = regression.draw(jax.random.key(1), state.belief, DRAWS, CAUTION)
        values = jax.vmap(lambda one: tables(space, layout, one, best))(weights)
        winners = jax.nn.one_hot(jnp.argmax(values, axis=2), space.max_bins)
        p = jnp.where(known(state), winners.mean(axis=0), uniform(space))
        return moments(space, p, width)

    def probabilities(state: LinearState) -> Float[Array, "attributes bins"]:
        actions = thompson(jax.random.key(1), state.belief, DRAWS)
        p = jax.nn.one_hot(actions, space.max_bins).mean(axis=0)
        return jnp.where(known(state), p, uniform(space))

    def expects(state: LinearState, actions: Bins) -> tuple[Rewards, Rewards]:
        x = evaluate(layout, actions)
        of_reward = regression.predicted(state.statistics, state.belief, state.noise, x)
        return jax.tree.map(lambda found: jnp.where(known(state), found, jnp.nan), of_reward)

    return jitted(init, sample, update, solution, probabilities, spread, expects=expects)
