"""A Bayesian model of the reward over bins: effects of attributes, and of pairs within groups.

    r(a) = b + sum_i f_i(a_i) + sum_{i<j in a group} g_ij(a_i, a_j) + noise

Under policies that choose each attribute's bin independently, its expectation is exact: no sampling.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sdr_jax.models import features, history, regression
from sdr_jax.models.features import Features
from sdr_jax.models.history import History
from sdr_jax.models.regression import Posterior, Statistics
from sdr_jax.relaxation import ordered
from sdr_jax.space import Space

SIGNAL = 0.7
"""Share of the first rewards' variance that is taken for signal, before the evidence speaks."""

PAIR_SHARE = 0.3
"""Share of the signal that interactions are taken for at first."""

SHRINK = 4.0
"""Pseudo-weights that pull each effect's scale towards the mean of its kind."""

NOISE_SHARE, NOISE_WEIGHT = 0.3, 4.0
"""Prior of the noise: its share of the rewards' variance, and the evaluations that is worth."""


class Effects(NamedTuple):
    """The model (constants): features, and which effect each belongs to.

    Effects are the attributes, then the pairs, then what all attributes share.
    """

    space: Space
    layout: Features
    effect: Int[np.ndarray, "features"]  # more than the layout has: the shared ones
    variance: Float[np.ndarray, "features"]  # prior's, relative to the effect's scale
    shared: Float[np.ndarray, "layout shared"]  # the layout's features that each shared one adds up


class EffectsState(NamedTuple):
    """What the model has learnt."""

    history: History
    statistics: Statistics
    scales: Float[Array, "effects"]  # prior variance of each effect; 0 while no rewards differ
    noise: Float[Array, ""]  # variance of a reward; 0 while none differ


class Model(NamedTuple):
    """One function of the bins: the posterior's mean, or a draw from its posterior."""

    alone: Float[Array, "*draws attributes bins"]  # f_i
    between: Float[Array, "*draws attributes attributes degree degree"]  # of cosines, symmetric


def make_effects(space: Space, degree: int = 9, pair_degree: int | None = None) -> Effects:
    """Lays the model over bins out.

    f_i is a cosine series over the bins' values, g_ij a product of two shorter ones. Beside its own,
    every f_i has a second cosine in common with all others: attributes tend to be best well inside
    their range, or at its ends, alike, and what all of them bend is learnt long before each one is.

    Args:
        space: the attributes, their bins, and the groups whose members may interact.
        degree: cosines per attribute; those beyond its bins less one are left out.
        pair_degree: cosines of each attribute in interactions, 0 for none; by default as many as
            leave all interactions together about 256 features, at least 1, and none in large groups.

    Returns:
        The model.

    Raises:
        ValueError: an option out of range.
    """
    if pair_degree is None:
        pair_degree = features.affordable(space, degree)
    layout = features.features(space, degree, pair_degree, 1.0)
    return effects_of(space, layout, columns=(1,) if degree > 1 else ())


def effects_of(space: Space, layout: Features, columns: tuple[int, ...]) -> Effects:
    """The model of a layout; `columns` of attributes in order have a weight in common beside their own."""
    attributes, _, degree = layout.basis.shape
    effects = attributes + len(layout.pairs)
    effect = np.concatenate(
        [
            np.repeat(np.arange(attributes), degree),
            np.repeat(np.arange(attributes, effects), layout.pair_degree**2),
        ]
    )
    totals = np.bincount(effect, weights=layout.variance, minlength=effects)
    variance = layout.variance / totals[effect]
    shared = np.zeros((len(effect), len(columns)), np.float32)
    for place, column in enumerate(columns):
        rows = np.flatnonzero(ordered(space)) * degree + column
        shared[rows, place] = layout.variance[rows] > 0
    of_shared = (variance[:, None] * shared).max(axis=0, initial=0)
    return Effects(
        space,
        layout,
        np.append(effect, np.arange(effects, effects + len(columns))).astype(np.int32),
        np.append(variance, of_shared).astype(np.float32),
        shared,
    )


def init_effects(model: Effects) -> EffectsState:
    """A model that has seen nothing."""
    zero = jnp.zeros((), jnp.float32)
    scales = jnp.zeros(len(_first_scales(model)), jnp.float32)
    seen = history.empty(model.space.attributes)
    return EffectsState(seen, regression.empty(len(model.effect)), scales, zero)


def observe(
    model: Effects,
    state: EffectsState,
    actions: Int[Array, "n attributes"],
    rewards: Float[Array, "n"],
) -> EffectsState:
    """Adds evaluations, and takes one step towards the scales with the most evidence.

    The step is one of expectation maximisation, from where the last update left them. An effect's
    scale is pulled towards the mean of its kind, so that none becomes 0 by chance. Rewards far below the
    others are clipped (`history.py`).
    """
    seen, statistics, ratio = history.learn(
        state.history, state.statistics, partial(_evaluate, model), actions, rewards
    )
    data = regression.centred(statistics)
    variance = data.square / data.freedom
    fresh = ratio * state.noise <= 0
    state = EffectsState(
        seen,
        statistics,
        jnp.where(fresh, SIGNAL * variance * _first_scales(model), ratio * state.scales),
        jnp.where(fresh, (1 - SIGNAL) * variance, ratio * state.noise),
    )
    stepped = _maximise_evidence(model, state)
    enough = statistics.square > 0  # some rewards differ
    zeros = EffectsState(
        seen, statistics, jnp.zeros_like(state.scales), jnp.zeros_like(state.noise)
    )
    return jax.tree.map(lambda a, b: jnp.where(enough, a, b), stepped, zeros)


def _evaluate(model: Effects, actions: Array) -> Array:
    """The features of actions i32[n attributes], those that are shared behind the layout's."""
    x = features.evaluate(model.layout, actions)
    return jnp.concatenate([x, x @ model.shared], axis=1)


def posterior(model: Effects, state: EffectsState) -> Posterior:
    """The belief about the weights; that of the prior while no rewards differ."""
    scales = jnp.where(state.noise > 0, state.scales, 1.0)
    noise = jnp.where(state.noise > 0, state.noise, 1.0)
    std = jnp.sqrt(jnp.asarray(model.variance) * scales[model.effect])
    return regression.posterior(regression.centred(state.statistics), std, jnp.sqrt(noise))[0]


def mean_model(model: Effects, belief: Posterior) -> Model:
    """The posterior's mean."""
    return _model(model, belief.mean)


def draw_models(rng_key: Key[Array, ""], model: Effects, belief: Posterior, n: int) -> Model:
    """Draws from the posterior, stacked on a leading axis; the key is consumed."""
    return jax.vmap(partial(_model, model))(regression.draw(rng_key, belief, n))


def values(
    model: Effects, function: Model, probabilities: Float[Array, "attributes bins"]
) -> Float[Array, "attributes bins"]:
    """Expected reward of each bin of each attribute, the others left to the policy.

        Q_i(k) = f_i(k) + sum_{j in the group of i} E_{a_j ~ pi_j} g_ij(k, a_j)

    up to a constant per attribute. Exact, since the policy's attributes are independent.

    Args:
        model: the constants.
        function: one model, without leading axes.
        probabilities: the policy.

    Returns:
        Q; for bins an attribute lacks it means nothing.
    """
    short = jnp.asarray(model.layout.basis)[:, :, : model.layout.pair_degree]
    expected = jnp.einsum("ab,abp->ap", probabilities, short)
    pulls = jnp.einsum("ajpq,jq->ap", function.between, expected)
    return function.alone + jnp.einsum("abp,ap->ab", short, pulls)


def value(
    model: Effects, state: EffectsState, belief: Posterior, actions: Int[Array, "attributes"]
) -> Float[Array, ""]:
    """The mean reward of actions under a belief, in the rewards' own units."""
    statistics = state.statistics
    count = jnp.maximum(statistics.seen, 1)
    off = _evaluate(model, actions[None, :])[0] - statistics.sums / count
    return statistics.offset + statistics.total / count + off @ belief.mean


def expected(
    model: Effects, state: EffectsState, belief: Posterior, actions: Int[Array, "n attributes"]
) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Mean and standard deviation of one reward of actions, its noise included; NaN before two rewards."""
    x = _evaluate(model, actions)
    mean, std = regression.predicted(state.statistics, belief, state.noise, x)
    known = state.noise > 0
    return jnp.where(known, mean, jnp.nan), jnp.where(known, std, jnp.nan)


def best_bins(model: Effects, belief: Posterior) -> Int[Array, "attributes"]:
    """The bins of the highest mean: coordinate ascent from a few starts."""
    weights = plain(model, belief.mean)
    return features.maximise(jax.random.key(0), model.space, model.layout, weights)


def draw_plain(
    rng_key: Key[Array, ""], model: Effects, belief: Posterior, n: int
) -> Float[Array, "n layout"]:
    """Weights of the layout's features, drawn from the posterior; the key is consumed."""
    return jax.vmap(partial(plain, model))(regression.draw(rng_key, belief, n))


def plain(model: Effects, weights: Array) -> Array:
    """Weights of the layout's features alone: what is shared is handed out."""
    own = len(model.shared)
    return weights[:own] + model.shared @ weights[own:]


def _model(model: Effects, weights: Array) -> Model:
    return Model(*features.split(model.layout, plain(model, weights)))


def _first_scales(model: Effects) -> Float[np.ndarray, "effects"]:
    attributes, pairs = model.space.attributes, len(model.layout.pairs)
    share = PAIR_SHARE if pairs else 0.0
    own = np.full(attributes, (1 - share) / attributes)
    interactions = np.full(pairs, share / max(pairs, 1))
    shared = np.repeat(own[:1], model.shared.shape[1])
    return np.concatenate([own, interactions, shared]).astype(np.float32)


def _maximise_evidence(model: Effects, state: EffectsState) -> EffectsState:
    """One step of expectation maximisation of scales and noise."""
    attributes, pairs = model.space.attributes, len(model.layout.pairs)
    data = regression.centred(state.statistics)
    belief = posterior(model, state)
    covariance = regression.covariance(belief)
    there = model.variance > 0
    relative = np.where(there, model.variance, 1)
    squares = jnp.where(there, (belief.mean**2 + jnp.diag(covariance)) / relative, 0.0)
    sums = jax.ops.segment_sum(squares, jnp.asarray(model.effect), len(state.scales))
    counts = np.bincount(model.effect, weights=there, minlength=len(state.scales))
    own, interactions = slice(attributes), slice(attributes, attributes + pairs)
    kinds = jnp.concatenate(
        [
            jnp.full(attributes, sums[own].sum() / counts[own].sum()),
            jnp.full(pairs, sums[interactions].sum() / max(counts[interactions].sum(), 1)),
        ]
    )
    scales = (sums[: len(kinds)] + SHRINK * kinds) / (counts[: len(kinds)] + SHRINK)
    # What is shared is as large as what each has.
    scales = jnp.append(scales, jnp.full(model.shared.shape[1], kinds[0]))

    misfit = (
        data.square
        - 2 * belief.mean @ data.moment
        + belief.mean @ (data.gram @ belief.mean)
        + jnp.sum(data.gram * covariance)
    )
    variance = data.square / data.freedom
    noise = (misfit + NOISE_WEIGHT * NOISE_SHARE * variance) / (data.freedom + NOISE_WEIGHT)
    return state._replace(scales=scales, noise=jnp.maximum(noise, 1e-4 * variance))
