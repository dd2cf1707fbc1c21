"""Problems of other forms than the models of our methods, for tests and not for tuning.

As in `benchmarks.problems`, 0 is the value of random attributes and 100 that of the best bins. These problems
were written before any method was run on them.
"""

from __future__ import annotations

from functools import partial
from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import qmc

import sdr_jax
from benchmarks.problems import GRID, Scaled, cells, integrals_of, means, scaled, tabular

POINTS = 64
"""Sobol points over which the ridge is averaged within intervals, since it has no closed form."""

CHOICES = (2, 3, 4, 5, 6, 3, 4, 5)
"""Values of the categorical problem's attributes."""

SHARES = {1: 0.5, 2: 0.35, 3: 0.15}
"""Number of attributes that have a joint effect -> share of the categorical problem's variance."""


def products(seed: int, space: sdr_jax.Space) -> Scaled:
    """Make bumps of three attributes from different groups, without effects of pairs or within groups."""
    rng = np.random.default_rng([seed, 4])
    groups = [rng.choice(len(space.groups), 3, replace=False) for _ in range(12)]
    terms = np.asarray([[rng.choice(space.groups[g]) for g in three] for three in groups])
    middle, reach = rng.uniform(0.1, 0.9, (12, 3, 1)), rng.uniform(0.15, 0.35, (12, 3, 1))
    bumps = np.exp(-(((cells() - middle) / reach) ** 2)).reshape(-1, 1, GRID)
    weights = jnp.asarray(rng.lognormal(0, 0.5, 12), jnp.float32)
    return scaled(space, partial(_triples, integrals_of(bumps), terms.ravel(), weights))


@jax.jit
def _triples(
    integrals: jax.Array, terms: jax.Array, weights: jax.Array, centre: jax.Array, width: jax.Array
) -> jax.Array:
    """Compute the weighted sum of products of three bumps each, f32[n]."""
    values = means(integrals, centre[:, terms], width[:, terms])
    return jnp.prod(values.reshape(len(centre), -1, 3), axis=2) @ weights


def ridge(seed: int, space: sdr_jax.Space) -> Scaled:
    """Make `b.x - 4 |a.x|`: a sharp ridge in a random direction of all attributes, with a slope along it."""
    rng = np.random.default_rng([seed, 5])
    across, along = np.linalg.qr(rng.normal(size=(space.attributes, 2)))[0].T.astype(np.float32)
    start = rng.uniform(0.2, 0.8, space.attributes).astype(np.float32)
    offsets = jnp.asarray(qmc.Sobol(space.attributes, seed=0).random(POINTS), jnp.float32) - 0.5

    @jax.jit
    def raw(centre: jax.Array, width: jax.Array) -> jax.Array:
        x = centre[:, None] + width[:, None] * offsets[None] - start[None, None]
        return jnp.mean(x @ along - 4 * jnp.abs(x @ across), axis=1)

    return scaled(space, raw)


def categories(seed: int) -> Scaled:
    """Make a table of unordered attributes of 2 to 6 values, with effects of one, two and three of them."""
    rng = np.random.default_rng([seed, 6])
    names = [f"x{k}" for k in range(len(CHOICES))]
    space = sdr_jax.space(names, CHOICES, [names[:4], names[4:]], unordered=names)
    table = np.zeros(CHOICES)
    for order, share in SHARES.items():
        table += _effects(rng, CHOICES, order, share)
    return _in_percent(space, table, 10.0)


def binary(seed: int) -> Scaled:
    """Make the 2^8 rewards of eight switches, without noise; effects halve from each order to the next."""
    rng = np.random.default_rng([seed, 7])
    table = sum(_effects(rng, (2,) * 8, order, 0.5**order) for order in range(1, 9))
    return _in_percent(sdr_jax.space([f"x{k}" for k in range(8)], 2), np.asarray(table), 0.0)


def _in_percent(space: sdr_jax.Space, table: np.ndarray, noise: float) -> Scaled:
    """Scale a table so that its mean is 0 and its best entry 100."""
    scale = 100 / (table.max() - table.mean())
    return tabular(space, scale * (table - table.mean()), noise)


def _effects(
    rng: np.random.Generator, sizes: tuple[int, ...], order: int, share: float
) -> np.ndarray:
    """Make a table with variance ``share``: the joint effects of all combinations of ``order`` attributes."""
    table = np.zeros(sizes)
    for members in combinations(range(len(sizes)), order):
        shape = [size if axis in members else 1 for axis, size in enumerate(sizes)]
        effect = rng.normal(size=shape)
        for axis in members:
            effect = effect - effect.mean(axis=axis, keepdims=True)
        table += effect
    return np.sqrt(share) * table / table.std()
