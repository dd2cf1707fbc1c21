"""What recorded rewards tell about each attribute: a Bayesian model, and its Sobol indices.

    r = b + sum_i f_i(u_i) + sum_{i<j} g_ij(u_i, u_j) + noise,   u uniform on the unit cube

f_i is a series of cosines `sqrt(2) cos(pi m u)`, g_ij a product of two shorter ones. These are orthonormal
on the unit cube, so the variance of each term there is the sum of its squared weights, wherever the
records lie: rewards that a search has asked for say as much as random ones. A dataset is taken for the
mean of its streets, whose attributes are uniform on intervals: `cos(pi m u)` is on average
`cos(pi m c) sinc(m w / 2)` over one with centre c and width w, and nothing over the whole range.

Source: Sobol (1993), "Sensitivity estimates for nonlinear mathematical models"; from the weights of an
orthonormal basis: Sudret (2008), "Global sensitivity analysis using polynomial chaos expansions".
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

DEGREE = 5
"""Cosines of each attribute."""
PAIR_ORDERS = ((1, 1), (1, 2), (2, 1))
"""Orders of the cosines that an interaction multiplies."""
STEPS = 30
"""Of expectation maximisation, which finds the scale of each effect and the noise."""
SIGNAL, PAIR_SHARE = 0.5, 0.3
"""Where it starts: the signal's share of the variance, and the interactions' share of that."""
SHRINK = (1.0, 10.0)
"""Pseudo-weights that pull each effect's scale towards the mean of its kind: attributes, and the many
pairs, of which chance would else pick some. On the recorded rewards 10 predicts better than 1."""
NOISE_SHARE, NOISE_WEIGHT = 0.5, 4.0
"""Prior of the noise: its share of the variance, and the rewards that is worth."""


class Layout(NamedTuple):
    """Which effect each weight belongs to: the attributes, then the pairs (constants)."""

    attributes: int
    pairs: np.ndarray  # i[pairs, 2]
    effect: np.ndarray  # i[features]
    relative: np.ndarray  # f64[features]: the prior's variance; sums to 1 over an effect

    @property
    def effects(self) -> int:
        """Attributes and pairs."""
        return self.attributes + len(self.pairs)


class Fit(NamedTuple):
    """What the records say of the weights: normal, in the terms of the records, which are the fewer."""

    x: np.ndarray  # f64[n, features], less its mean
    center: np.ndarray  # f64[features], that mean
    rewards: np.ndarray  # f64[n], less their mean
    mean_reward: float
    variance: np.ndarray  # f64[features], the prior's
    factor: np.ndarray  # f64[n, n], the Cholesky factor of the rewards' covariance
    noise: float  # standard deviation of one reward

    @property
    def weights(self) -> np.ndarray:
        """Expected weights f64[features]."""
        return self.variance * (self.x.T @ cho_solve((self.factor, True), self.rewards))


class Shares(NamedTuple):
    """Parts of the variance that attributes uniform on the unit cube give the reward."""

    effects: np.ndarray  # f64[effects] of the expected model: attributes, pairs; they sum to 1
    drawn: np.ndarray  # f64[draws, effects], what the posterior leaves open around these
    signal: float  # the variance of which they are parts


def lay_out(attributes: int) -> Layout:
    """The features of so many attributes, all pairs of which may interact.

    The prior's variance falls with the square of the orders: smooth functions are likelier.
    """
    own = 1 / np.arange(1, DEGREE + 1) ** 2
    both = np.array([1 / (p * q) ** 2 for p, q in PAIR_ORDERS])
    pairs = np.array(list(combinations(range(attributes), 2)), int).reshape(-1, 2)
    effects = np.arange(attributes + len(pairs))
    effect = effects[:attributes].repeat(DEGREE), effects[attributes:].repeat(len(both))
    relative = np.tile(own / own.sum(), attributes), np.tile(both / both.sum(), len(pairs))
    return Layout(attributes, pairs, np.concatenate(effect), np.concatenate(relative))


def waves(unit: np.ndarray, width: np.ndarray | float = 0.0) -> np.ndarray:
    """Means of `sqrt(2) cos(pi m u)` over intervals, m = 1..DEGREE.

    Args:
        unit: centres f[*shape] in [0, 1].
        width: of the intervals, f[*shape]; 0 for the values themselves.

    Returns:
        f64[*shape, DEGREE].
    """
    orders = np.arange(1, DEGREE + 1)
    centre, wide = np.asarray(unit, float)[..., None], np.asarray(width, float)[..., None]
    return np.sqrt(2) * np.cos(np.pi * orders * centre) * np.sinc(orders * wide / 2)


def features(layout: Layout, centre: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Features f64[n, features] of proposals f[n, attributes]; attributes of a street are independent."""
    own = waves(centre, width)
    first, second = own[:, layout.pairs[:, 0]], own[:, layout.pairs[:, 1]]
    products = np.stack([first[..., p - 1] * second[..., q - 1] for p, q in PAIR_ORDERS], axis=-1)
    n = len(own)
    return np.concatenate([own.reshape(n, -1), products.reshape(n, -1)], axis=1)


def fit(layout: Layout, x: np.ndarray, rewards: np.ndarray) -> Fit:
    """Learn the weights, the scale of each effect and the noise, all from the same records.

    The prior is w ~ N(0, scale of the effect * relative variance). Scales and noise are those of most
    evidence, by expectation maximisation.

    Args:
        layout: of the features.
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
    # Without any difference between rewards every scale is as good as another.
    spread = (y @ y / degrees) or 1.0
    shares = np.array([1 - PAIR_SHARE, PAIR_SHARE]) / np.maximum(np.bincount(kind, minlength=2), 1)
    scales, noise = SIGNAL * spread * shares[kind], (1 - SIGNAL) * spread

    def believed() -> Fit:
        variance = relative * scales[effect]
        center = x.mean(axis=0)
        own = x - center
        covariance = (own * variance) @ own.T + noise * np.eye(len(y))
        factor = cholesky(covariance, lower=True)
        return Fit(own, center, y, float(rewards.mean()), variance, factor, float(np.sqrt(noise)))

    for _ in range(STEPS):
        belief = believed()
        weights = belief.weights
        seen = solve_triangular(belief.factor, belief.x, lower=True)
        # Of the prior's variance, what is left.
        unknown = 1 - belief.variance * (seen**2).sum(axis=0)
        squares = (weights**2 + belief.variance * unknown) / relative
        sums = np.bincount(effect, squares, layout.effects)
        kinds = np.bincount(kind, sums, 2) / counts_of_kind
        scales = (sums + pull * kinds[kind]) / (counts + pull)
        misfit = ((y - belief.x @ weights) ** 2).sum() + noise * (1 - unknown).sum()
        noise = (misfit + NOISE_WEIGHT * NOISE_SHARE * spread) / (degrees + NOISE_WEIGHT)
    return believed()


def predict(model: Fit, x: np.ndarray) -> np.ndarray:
    """Expected rewards f64[n] of features f64[n, features]."""
    return model.mean_reward + (x - model.center) @ model.weights


def draw_weights(model: Fit, count: int, seed: int) -> np.ndarray:
    """Weights f64[count, features] drawn from the posterior.

    A draw from the prior is moved by what the records say it has wrong (Matheron's rule).
    """
    rng = np.random.default_rng(seed)
    prior = rng.normal(size=(count, len(model.variance))) * np.sqrt(model.variance)
    rewards = prior @ model.x.T + model.noise * rng.normal(size=(count, len(model.rewards)))
    missing = cho_solve((model.factor, True), (model.rewards - rewards).T)
    return prior + (model.x.T @ missing).T * model.variance


def shares(layout: Layout, expected: np.ndarray, drawn: np.ndarray) -> Shares:
    """Sobol indices of the expected model, and how far others that fit lie around them.

    The squares of what is not known add up in a drawn model, over the many pairs most of all. This
    excess is taken out on average: draws of an effect that is not there lie around zero.

    Args:
        layout: of the features.
        expected: weights f64[features].
        drawn: weights f64[draws, features] from the posterior.
    """
    belongs = (layout.effect[:, None] == np.arange(layout.effects)).astype(float)
    own = expected**2 @ belongs
    around = (drawn**2 - drawn.var(axis=0)) @ belongs
    signal = max(float(own.sum()), np.finfo(float).tiny)
    return Shares(own / signal, around / signal, signal)


def totals(layout: Layout, effects: np.ndarray) -> np.ndarray:
    """Shares f64[*batch, attributes] of attributes alone and in all pairs, from those of all effects."""
    takes_part = (layout.pairs[:, :, None] == np.arange(layout.attributes)).any(axis=1)
    alone, together = np.split(effects, [layout.attributes], axis=-1)
    return alone + together @ takes_part


def curves(layout: Layout, weights: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Main effects f_i f64[draws, attributes, points] at unit values f64[points], of mean 0 each."""
    own = weights[:, : layout.attributes * DEGREE].reshape(len(weights), layout.attributes, DEGREE)
    return np.einsum("dam,pm->dap", own, waves(grid))


def cross_validated(
    layout: Layout, x: np.ndarray, rewards: np.ndarray, fold: np.ndarray
) -> np.ndarray:
    """Predictions f64[n] of every reward by a model that has not seen its fold.

    Args:
        layout: of the features.
        x: f64[n, features].
        rewards: f64[n].
        fold: i[n], the fold of each record.
    """
    predictions = np.full(len(rewards), np.nan)
    for number in np.unique(fold):
        held = fold == number
        predictions[held] = predict(fit(layout, x[~held], rewards[~held]), x[held])
    return predictions
