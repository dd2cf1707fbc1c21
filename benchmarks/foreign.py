"""Problems of other forms than the models of the methods here, for tests and not for tuning.

As in `benchmarks.problems`, 0 is the value of random attributes and 100 that of the best bins found. They
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
"""Sobol points at which the ridge is averaged within intervals, since it has no closed form."""

CHOICES = (2, 3, 4, 5, 6, 3, 4, 5)
"""Values of the categorical problem's attributes."""

SHARES = {1: 0.5, 2: 0.35, 3: 0.15}
"""Number of attributes that have a joint effect -> share of the categorical problem's variance."""


def products(seed: int, space: sdr_jax.Space) -> Scaled:
    """Bumps of three attributes from different groups, without effects of pairs or within groups."""
    rng = np.random.default_rng([seed, 4])
    groups = [rng.choice(len(space.groups), 3, replace=False) for _ in range(12)]
    terms = np.asarray([[rng.choice(space.groups[g]) for g in three] for three in groups])
    middle, reach = rng.uniform(0.1, 0.9, (12, 3, 1)), rng.uniform(0.15, 0.35, (12, 3, 1))
    bumps = np.exp(-(((cells() - middle) / reach) ** 2)).reshape(-1, 1, GRID)
    worth = jnp.asarray(rng.lognormal(0, 0.5, 12), jnp.float32)
    return scaled(space, partial(_triples, integrals_of(bumps), terms.ravel(), worth))


@jax.jit
def _triples(
    integrals: jax.Array, terms: jax.Array, worth: jax.Array, centre: jax.Array, width: jax.Array
) -> jax.Array:
    """The weighted sum of products of three bumps each, f32[n]."""
    found = means(integrals, centre[:, terms], width[:, terms])
    return jnp.prod(found.reshape(len(centre), -1, 3), axis=2) @ worth


def ridge(seed: int, space: sdr_jax.Space) -> Scaled:
    """`b.x - 4 |a.x|`: a sharp ridge in a random direction over all attributes, with a slope along it."""
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
    """A table of unordered attributes with 2 to 6 values each, with effects of one, two and three."""
    rng = np.random.default_rng([seed, 6])
    names = [f"x{k}" for k in range(len(CHOICES))]
    space = sdr_jax.space(names, CHOICES, [names[:4], names[4:]], unordered=names)
    table = np.zeros(CHOICES)
    for order, share in SHARES.items():
        table += _effects(rng, CHOICES, order, share)
    return _in_percent(space, table, 10.0)


def binary(seed: int) -> Scaled:
    """All 2^8 rewards of eight switches without noise; each order of effects has half the last one's."""
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
    """A table with variance ``share``: the joint effects of all combinations of ``order`` attributes."""
    found = np.zeros(sizes)
    for members in combinations(range(len(sizes)), order):
        shape = [size if axis in members else 1 for axis, size in enumerate(sizes)]
        effect = rng.normal(size=shape)
        for axis in members:
            effect = effect - effect.mean(axis=axis, keepdims=True)
        found += effect
    return np.sqrt(share) * found / found.std()
