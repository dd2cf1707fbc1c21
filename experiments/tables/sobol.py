"""A Bayesian model of recorded rewards, and its Sobol indices of the attributes.

    r = b + sum_i f_i(u_i) + sum_{i<j} g_ij(u_i, u_j) + noise,   u uniform on the unit cube

f_i is a series of cosines `sqrt(2) cos(pi m u)`, g_ij a product of two shorter ones. These are orthonormal on
the unit cube, so the variance of each term there is the sum of its squared weights, whatever the records: the
rewards of a search serve as well as random ones. A dataset counts as the mean of its streets, whose
attributes are uniform on intervals: the mean of `cos(pi m u)` is `cos(pi m c) sinc(m w / 2)` over an interval
with centre c and width w, and 0 over the whole range.

Source: Sobol (1993), "Sensitivity estimates for nonlinear mathematical models"; from the weights of an
orthonormal basis: Sudret (2008), "Global sensitivity analysis using polynomial chaos expansions".
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

DEGREE = 5
"""Number of cosines of each attribute."""
PAIR_ORDERS = ((1, 1), (1, 2), (2, 1))
"""Orders of the two cosines in each term of an interaction."""
STEPS = 30
"""Steps of expectation maximisation, which finds the scale of each effect and the noise."""
SIGNAL, PAIR_SHARE = 0.5, 0.3
"""Its start: the signal's share of the variance, and the interactions' share of the signal."""
LEAST_SIGNAL = 0.1
"""The least signal by which a draw's effects are divided, as a share of the expected model's."""
SHRINK = (1.0, 10.0)
"""Pseudo-weights that pull each effect's scale towards the mean of its kind: attributes, or the many pairs,
some of which would otherwise stand out by chance. On the recorded rewards 10 predicts better than 1."""
NOISE_SHARE, NOISE_WEIGHT = 0.5, 4.0
"""Prior of the noise: its share of the variance, and its weight in rewards."""


class Layout(NamedTuple):
    """The effect that each weight belongs to: the attributes, then the pairs (constants)."""

    attributes: int
    pairs: np.ndarray  # i[pairs, 2]
    effect: np.ndarray  # i[features]
    relative: np.ndarray  # f64[features]: variance of the prior; sums to 1 over an effect

    @property
    def effects(self) -> int:
        """The number of attributes and pairs."""
        return self.attributes + len(self.pairs)


class Fit(NamedTuple):
    """The normal posterior of the weights, stored at the size of the records, which are fewer."""

    x: np.ndarray  # f64[n, features], centred
    center: np.ndarray  # f64[features], mean of the features
    rewards: np.ndarray  # f64[n], centred
    mean_reward: float
    variance: np.ndarray  # f64[features], of the prior
    factor: np.ndarray  # f64[n, n], the Cholesky factor of the rewards' covariance
    noise: float  # standard deviation of one reward

    @property
    def weights(self) -> np.ndarray:
        """Expected weights f64[features]."""
        return self.variance * (self.x.T @ cho_solve((self.factor, True), self.rewards))


class Shares(NamedTuple):
    """Shares of the reward's variance under attributes that are uniform on the unit cube."""

    effects: np.ndarray  # f64[effects] of the expected model: attributes, pairs; they sum to 1
    drawn: np.ndarray  # f64[draws, effects], samples of the posterior around these
    signal: float  # the whole variance
    drawn_signal: np.ndarray  # f64[draws], in samples of the posterior


def lay_out(attributes: int) -> Layout:
    """Lay out the features of attributes, all pairs of which may interact.

    The prior's variance falls with the square of the orders, so that smooth functions are likelier.
    """
    single = 1 / np.arange(1, DEGREE + 1) ** 2
    paired = np.array([1 / (p * q) ** 2 for p, q in PAIR_ORDERS])
    pairs = np.array(list(combinations(range(attributes), 2)), int).reshape(-1, 2)
    effects = np.arange(attributes + len(pairs))
    effect = effects[:attributes].repeat(DEGREE), effects[attributes:].repeat(len(paired))
    relative = (
        np.tile(single / single.sum(), attributes),
        np.tile(paired / paired.sum(), len(pairs)),
    )
    return Layout(attributes, pairs, np.concatenate(effect), np.concatenate(relative))


def waves(unit: np.ndarray, width: np.ndarray | float = 0.0) -> np.ndarray:
    """Compute means of `sqrt(2) cos(pi m u)` over intervals, m = 1..DEGREE.

    Args:
        unit: centres f[*shape] in [0, 1].
        width: widths of the intervals, f[*shape]; 0 for single values.

    Returns:
        f64[*shape, DEGREE].
    """
    orders = np.arange(1, DEGREE + 1)
    centre, wide = np.asarray(unit, float)[..., None], np.asarray(width, float)[..., None]
    return np.sqrt(2) * np.cos(np.pi * orders * centre) * np.sinc(orders * wide / 2)


def features(layout: Layout, centre: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Compute features f64[n, features] of proposals f[n, attributes] with independent attributes."""
    single = waves(centre, width)
    first, second = single[:, layout.pairs[:, 0]], single[:, layout.pairs[:, 1]]
    products = np.stack([first[..., p - 1] * second[..., q - 1] for p, q in PAIR_ORDERS], axis=-1)
    n = len(single)
    return np.concatenate([single.reshape(n, -1), products.reshape(n, -1)], axis=1)


def fit(layout: Layout, x: np.ndarray, rewards: np.ndarray) -> Fit:
    """Fit the weights, the scale of each effect and the noise to the same records.

    The prior is w ~ N(0, scale of the effect * relative variance). Expectation maximisation finds the scales
    and the noise with the highest evidence.

    Args:
        layout: layout of the features.
        x: f64[n, features].
        rewards: f64[n], n >= 2.
    """
    effect, relative = layout.effect, layout.relative
    kind = (np.arange(layout.effects) >= layout.attributes).astype(int)
    counts = np.bincount(effect, minlength=layout.effects)
    counts_of_kind = np.maximum(np.bincount(kind, counts, 2), 1)
    pull = np.asarray(SHRINK)[kind]
    degrees = len(rewards) - 1
    y = rewards - rewards.mean()
    # If all rewards are equal, any scale will do.
    spread = (y @ y / degrees) or 1.0
    shares = np.array([1 - PAIR_SHARE, PAIR_SHARE]) / np.maximum(np.bincount(kind, minlength=2), 1)
    scales, noise = SIGNAL * spread * shares[kind], (1 - SIGNAL) * spread

    def posterior() -> Fit:
        variance = relative * scales[effect]
        center = x.mean(axis=0)
        centred = x - center
        covariance = (centred * variance) @ centred.T + noise * np.eye(len(y))
        factor = cholesky(covariance, lower=True)
        mean_reward = float(rewards.mean())
        return Fit(centred, center, y, mean_reward, variance, factor, float(np.sqrt(noise)))

    for _ in range(STEPS):
        model = posterior()
        weights = model.weights
        whitened = solve_triangular(model.factor, model.x, lower=True)
        # The share of the prior's variance that remains.
        unknown = 1 - model.variance * (whitened**2).sum(axis=0)
        squares = (weights**2 + model.variance * unknown) / relative
        sums = np.bincount(effect, squares, layout.effects)
        kinds = np.bincount(kind, sums, 2) / counts_of_kind
        scales = (sums + pull * kinds[kind]) / (counts + pull)
        misfit = ((y - model.x @ weights) ** 2).sum() + noise * (1 - unknown).sum()
        noise = (misfit + NOISE_WEIGHT * NOISE_SHARE * spread) / (degrees + NOISE_WEIGHT)
    return posterior()


def predict(model: Fit, x: np.ndarray) -> np.ndarray:
    """Predict rewards f64[n] of features f64[n, features]."""
    return model.mean_reward + (x - model.center) @ model.weights


def draw_weights(model: Fit, count: int, seed: int) -> np.ndarray:
    """Draw weights f64[count, features] from the posterior.

    A sample of the prior is corrected by its errors on the records (Matheron's rule).
    """
    rng = np.random.default_rng(seed)
    prior = rng.normal(size=(count, len(model.variance))) * np.sqrt(model.variance)
    rewards = prior @ model.x.T + model.noise * rng.normal(size=(count, len(model.rewards)))
    errors = cho_solve((model.factor, True), (model.rewards - rewards).T)
    return prior + (model.x.T @ errors).T * model.variance


def shares(layout: Layout, expected: np.ndarray, draws: np.ndarray) -> Shares:
    """Compute Sobol indices of the expected model, and their spread under the posterior.

    Squares of uncertain weights add up in a sampled model, most of all over the many pairs. The mean of this
    excess is subtracted, so that samples of an absent effect lie around zero.

    Args:
        layout: layout of the features.
        expected: weights f64[features].
        draws: weights f64[draws, features] from the posterior.
    """
    belongs = (layout.effect[:, None] == np.arange(layout.effects)).astype(float)
    variances = expected**2 @ belongs
    sampled = (draws**2 - draws.var(axis=0)) @ belongs
    signal = max(float(variances.sum()), np.finfo(float).tiny)
    # Each sample is divided by its own signal, or by the least that counts where it has hardly any.
    signals = sampled.sum(axis=1)
    divisors = np.maximum(signals, LEAST_SIGNAL * signal)[:, None]
    return Shares(variances / signal, sampled / divisors, signal, signals)


def totals(layout: Layout, effects: np.ndarray) -> np.ndarray:
    """Sum shares of effects to total shares f64[*batch, attributes] of attributes, alone and in pairs."""
    in_pair = (layout.pairs[:, :, None] == np.arange(layout.attributes)).any(axis=1)
    alone, together = np.split(effects, [layout.attributes], axis=-1)
    return alone + together @ in_pair


def curves(layout: Layout, weights: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Compute main effects f_i f64[draws, attributes, points] with mean 0 at unit values f64[points]."""
    single = weights[:, : layout.attributes * DEGREE]
    coefficients = single.reshape(len(weights), layout.attributes, DEGREE)
    return np.einsum("dam,pm->dap", coefficients, waves(grid))


def cross_validated(
    layout: Layout, x: np.ndarray, rewards: np.ndarray, fold: np.ndarray
) -> np.ndarray:
    """Predict every reward f64[n] by a model that has not seen its fold.

    Args:
        layout: layout of the features.
        x: f64[n, features].
        rewards: f64[n].
        fold: i[n], the fold of each record.
    """
    predictions = np.full(len(rewards), np.nan)
    for number in np.unique(fold):
        held = fold == number
        predictions[held] = predict(fit(layout, x[~held], rewards[~held]), x[held])
    return predictions
