"""A Bayesian model of the reward over bins: main effects of attributes, and interactions within groups.

    r(a) = b + sum_i f_i(a_i) + sum_{i<j in a group} g_ij(a_i, a_j) + noise

Under policies that choose each attribute's bin independently, its expectation is exact, without sampling.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key

from sdr_jax import trees
from sdr_jax.bins import bin_centres, bin_mask, ordered
from sdr_jax.models import features, history, regression
from sdr_jax.models.features import Features
from sdr_jax.models.history import History
from sdr_jax.models.regression import Posterior, Statistics
from sdr_jax.space import Space

SIGNAL = 0.7
"""Share of the first rewards' variance that counts as signal until there is evidence."""

PAIR_SHARE = 0.3
"""Share of the signal that belongs to interactions at first."""

SHRINK = 4.0
"""Weight, in features, of the mean of its kind in the scale of each effect."""

NOISE_SHARE, NOISE_WEIGHT = 0.3, 4.0
"""Prior of the noise: its share of the rewards' variance, and its weight in evaluations."""

LEAST_NOISE = 1e-4
"""The least variance of a reward, as a share of the variance of the first rewards."""


class Effects(NamedTuple):
    """The model (constants): features, and the effect that each feature belongs to.

    Main effects of the attributes come first, then interactions of the pairs, then effects that all
    attributes share.
    """

    space: Space
    layout: Features
    effect: Int[np.ndarray, "features"]  # of each feature of the layout, then of the shared ones
    variance: Float[np.ndarray, "features"]  # of the prior, relative to the effect's scale
    shared: Float[np.ndarray, "layout shared"]  # weights of layout features in each shared one


class EffectsState(NamedTuple):
    """The state of the model."""

    history: History
    statistics: Statistics
    scales: Float[Array, "effects"]  # prior variance of each effect; 0 while all rewards are equal
    noise: Float[Array, ""]  # variance of a reward; 0 while all rewards are equal


class RewardFunction(NamedTuple):
    """One function of the bins: the posterior's mean, or a draw from the posterior."""

    main: Float[Array, "*draws attributes bins"]  # f_i
    interactions: Float[Array, "*draws attributes attributes degree degree"]
    """The weights of products of cosines in g_ij, symmetric."""


def make_effects(space: Space, degree: int = 9, pair_degree: int | None = None) -> Effects:
    """Make the model over bins.

    f_i is a cosine series `sqrt(2) cos(pi m c)` of the bins' centres c, m = 1..degree, g_ij a product of two
    shorter ones. Over an attribute's bins cosines are orthogonal and have mean zero. All f_i also share one
    second cosine: the best values of attributes tend to lie all well inside their ranges or all at the
    ends, and this common bend is known long before that of each attribute.

    Args:
        space: the attributes, their bins, and the groups whose members may interact.
        degree: cosines per attribute; an attribute has at most its number of bins less one.
        pair_degree: cosines of each attribute in interactions, 0 for none; by default at least 1, chosen
            so that all interactions have about 256 features, and 0 in large groups.

    Returns:
        The model.

    Raises:
        ValueError: an option out of range.
    """
    if pair_degree is None:
        pair_degree = features.affordable(space, degree)
    features.check_degrees(degree, pair_degree)
    variances = features.main_variances(space, degree)
    orders = np.arange(1, variances.shape[1] + 1)
    basis = np.sqrt(2) * np.cos(np.pi * bin_centres(space)[:, :, None] * orders[None, None, :])
    basis = basis * (variances > 0)[:, None, :] * bin_mask(space)[:, :, None]
    layout = features.lay_out(space, basis, variances, pair_degree)
    return effects_of(space, layout, columns=(1,) if degree > 1 else ())


def effects_of(space: Space, layout: Features, columns: tuple[int, ...]) -> Effects:
    """Make the model of a layout; ordered attributes also share one weight for each of `columns`."""
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
    """The state before any evaluation."""
    zero = jnp.zeros((), jnp.float32)
    scales = jnp.zeros(len(_first_scales(model)), jnp.float32)
    empty = history.empty(model.space.attributes)
    return EffectsState(empty, regression.empty(len(model.effect)), scales, zero)


def observe(
    model: Effects,
    state: EffectsState,
    actions: Int[Array, "n attributes"],
    rewards: Float[Array, "n"],
) -> EffectsState:
    """Add evaluations, and take one step towards the scales of the highest evidence.

    The step is one of expectation maximisation and starts at the last scales. An effect's scale is pulled
    towards the mean of its kind, so that no scale becomes 0 by chance. Rewards far below the others are
    clipped (`history.py`).
    """
    rewarded, statistics, ratio = history.learn(
        state.history, state.statistics, partial(_evaluate, model), actions, rewards
    )
    variance = statistics.variance
    fresh = ratio * state.noise <= 0
    state = EffectsState(
        rewarded,
        statistics,
        jnp.where(fresh, SIGNAL * variance * _first_scales(model), ratio * state.scales),
        jnp.where(fresh, (1 - SIGNAL) * variance, ratio * state.noise),
    )
    stepped = _maximise_evidence(model, state)
    rewards_differ = statistics.square > 0
    without = state._replace(scales=jnp.zeros_like(state.scales), noise=jnp.zeros_like(state.noise))
    return trees.where(rewards_differ, stepped, without)


def is_finite(state: EffectsState, belief: Posterior) -> Bool[Array, ""]:
    """Whether all numbers of the model are finite; otherwise its answers mean nothing."""
    parts = (state.statistics, state.scales, state.noise, belief)
    return jnp.stack([jnp.isfinite(part).all() for part in jax.tree.leaves(parts)]).all()


def _evaluate(model: Effects, actions: Array) -> Array:
    """Compute the features of actions i32[n attributes]: the layout's, then the shared ones."""
    x = features.evaluate(model.layout, actions)
    return jnp.concatenate([x, x @ model.shared], axis=1)


def posterior(model: Effects, state: EffectsState) -> Posterior:
    """Compute the posterior of the weights; the prior while all rewards are equal."""
    scales = jnp.where(state.noise > 0, state.scales, 1.0)
    noise = jnp.where(state.noise > 0, state.noise, 1.0)
    std = jnp.sqrt(jnp.asarray(model.variance) * scales[model.effect])
    return regression.posterior(state.statistics, std, jnp.sqrt(noise))


def mean_model(model: Effects, belief: Posterior) -> RewardFunction:
    """The model with the posterior's mean as weights."""
    return _model(model, belief.mean)


def draw_models(
    rng_key: Key[Array, ""], model: Effects, belief: Posterior, n: int
) -> RewardFunction:
    """Draw models from the posterior, stacked on a leading axis; the key is consumed."""
    return jax.vmap(partial(_model, model))(regression.draw(rng_key, belief, n))


def values(
    model: Effects, function: RewardFunction, probabilities: Float[Array, "attributes bins"]
) -> Float[Array, "attributes bins"]:
    """Compute the expected reward of each bin, with the other attributes sampled from the policy.

        Q_i(k) = f_i(k) + sum_{j in the group of i} E_{a_j ~ pi_j} g_ij(k, a_j)

    up to a constant per attribute. Exact, since the policy's attributes are independent.

    Args:
        model: the constants.
        function: one model, without leading axes.
        probabilities: the policy.

    Returns:
        Q; its values are meaningless for bins that an attribute lacks.
    """
    short = jnp.asarray(model.layout.basis)[:, :, : model.layout.pair_degree]
    expected = jnp.einsum("ab,abp->ap", probabilities, short)
    slopes = jnp.einsum("ajpq,jq->ap", function.interactions, expected)
    return function.main + jnp.einsum("abp,ap->ab", short, slopes)


def value(
    model: Effects, state: EffectsState, belief: Posterior, actions: Int[Array, "attributes"]
) -> Float[Array, ""]:
    """Compute the mean reward of actions under a belief, in the units of the rewards."""
    statistics = state.statistics
    centred = _evaluate(model, actions[None, :])[0] - statistics.mean
    return statistics.offset + statistics.level + centred @ belief.mean


def predict(
    model: Effects, state: EffectsState, belief: Posterior, actions: Int[Array, "n attributes"]
) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Predict mean and standard deviation (with noise) of one reward of actions; NaN before two rewards."""
    x = _evaluate(model, actions)
    mean, std = regression.predict(state.statistics, belief, state.noise, x)
    rewards_differ = state.noise > 0
    return jnp.where(rewards_differ, mean, jnp.nan), jnp.where(rewards_differ, std, jnp.nan)


def best_bins(model: Effects, belief: Posterior) -> Int[Array, "attributes"]:
    """Find the bins of the highest mean, by coordinate ascent from a few starts."""
    weights = layout_weights(model, belief.mean)
    return features.maximise(jax.random.key(0), model.space, model.layout, weights)


def draw_weights(
    rng_key: Key[Array, ""], model: Effects, belief: Posterior, n: int
) -> Float[Array, "n layout"]:
    """Draw the weights of the layout's features from the posterior; the key is consumed."""
    return jax.vmap(partial(layout_weights, model))(regression.draw(rng_key, belief, n))


def layout_weights(model: Effects, weights: Array) -> Array:
    """Compute the weights of the layout's features alone, to which the shared weights are added."""
    size = len(model.shared)
    return weights[:size] + model.shared @ weights[size:]


def _model(model: Effects, weights: Array) -> RewardFunction:
    return RewardFunction(*features.split(model.layout, layout_weights(model, weights)))


def _first_scales(model: Effects) -> Float[np.ndarray, "effects"]:
    attributes, pairs = model.space.attributes, len(model.layout.pairs)
    share = PAIR_SHARE if pairs else 0.0
    main = np.full(attributes, (1 - share) / attributes)
    interactions = np.full(pairs, share / max(pairs, 1))
    shared = np.repeat(main[:1], model.shared.shape[1])
    return np.concatenate([main, interactions, shared]).astype(np.float32)


def _maximise_evidence(model: Effects, state: EffectsState) -> EffectsState:
    """Take one step of expectation maximisation of scales and noise."""
    attributes, pairs = model.space.attributes, len(model.layout.pairs)
    data = state.statistics
    belief = posterior(model, state)
    covariance = regression.covariance(belief)
    has_feature = model.variance > 0
    relative = np.where(has_feature, model.variance, 1)
    squares = jnp.where(has_feature, (belief.mean**2 + jnp.diag(covariance)) / relative, 0.0)
    sums = jax.ops.segment_sum(squares, jnp.asarray(model.effect), len(state.scales))
    counts = np.bincount(model.effect, weights=has_feature, minlength=len(state.scales))
    main, interactions = slice(attributes), slice(attributes, attributes + pairs)
    kinds = jnp.concatenate(
        [
            jnp.full(attributes, sums[main].sum() / counts[main].sum()),
            jnp.full(pairs, sums[interactions].sum() / max(counts[interactions].sum(), 1)),
        ]
    )
    scales = (sums[: len(kinds)] + SHRINK * kinds) / (counts[: len(kinds)] + SHRINK)
    # A shared effect is as large as a main effect.
    scales = jnp.append(scales, jnp.full(model.shared.shape[1], kinds[0]))

    misfit = (
        data.square
        - 2 * belief.mean @ data.moment
        + belief.mean @ (data.gram @ belief.mean)
        + jnp.sum(data.gram * covariance)
    )
    prior = NOISE_WEIGHT * NOISE_SHARE * data.variance
    noise = (misfit + prior) / (data.freedom + NOISE_WEIGHT)
    # The variance of all rewards shrinks while a search closes in on its optimum; that of the first does not.
    largest = jnp.fmax(data.variance, history.first_variance(state.history))
    return state._replace(scales=scales, noise=jnp.maximum(noise, LEAST_NOISE * largest))
