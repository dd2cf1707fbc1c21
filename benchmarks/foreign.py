"""Problems of other forms than the models of any method here: to be run, not to be tuned on.

As in `benchmarks.problems`, 0 is the value of random attributes and 100 that of the best bins found.
Written down before any method was run on them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import qmc

import sdr_jax

GRID = 400
POINTS = 64
"""Sobol points over which the ridge, which has no closed form, is averaged within intervals."""

CHOICES = (2, 3, 4, 5, 6, 3, 4, 5)
"""Values of the categorical problem's attributes."""

SHARES = {1: 0.5, 2: 0.35, 3: 0.15}
"""Of its variance, in effects of so many attributes together, of any groups."""


class Raw(Protocol):
    """Values of proposals in units of their own."""

    def __call__(self, centre: jax.Array, width: jax.Array) -> jax.Array:
        """F32[n] of f32[n attributes] each."""


@dataclass(frozen=True, eq=False)
class Scaled:
    """Any values, scaled to 0 and 100 and made noisy."""

    space: sdr_jax.Space
    raw: Raw
    noise: float  # standard deviation of a reward
    zero: float  # raw value of random attributes
    unit: float  # raw difference that counts as 1

    def reward(self, rng_key: jax.Array, proposals: sdr_jax.Proposal) -> jax.Array:
        """Values with normal noise; the key is consumed."""
        values = (self.raw(*map(jnp.asarray, proposals)) - self.zero) / self.unit
        return values + self.noise * jax.random.normal(rng_key, values.shape)

    def true_value(self, proposal: sdr_jax.Proposal) -> float:
        """The value without noise."""
        centre, width = (jnp.asarray(part)[None] for part in proposal)
        return float((self.raw(centre, width)[0] - self.zero) / self.unit)


def products(seed: int, space: sdr_jax.Space) -> Scaled:
    """Bumps of three attributes at a time, of different groups: nothing pairwise, nothing within them."""
    rng = np.random.default_rng([seed, 4])
    groups = [rng.choice(len(space.groups), 3, replace=False) for _ in range(12)]
    terms = np.asarray([[rng.choice(space.groups[g]) for g in three] for three in groups])
    u = (np.arange(GRID) + 0.5) / GRID
    middle, reach = rng.uniform(0.1, 0.9, (12, 3, 1)), rng.uniform(0.15, 0.35, (12, 3, 1))
    bumps = np.exp(-(((u - middle) / reach) ** 2))
    integrals = np.pad(np.cumsum(bumps, axis=2) / GRID, [(0, 0), (0, 0), (1, 0)])
    worth = jnp.asarray(rng.lognormal(0, 0.5, 12), jnp.float32)
    table = jnp.asarray(integrals, jnp.float32)

    @jax.jit
    def raw(centre: jax.Array, width: jax.Array) -> jax.Array:
        half = jnp.maximum(width, 1e-3)[:, terms] / 2
        middle = jnp.clip(centre[:, terms], half, 1 - half)
        rows, columns = np.indices(terms.shape)[:, None]

        def integral(at: jax.Array) -> jax.Array:
            cell = jnp.clip((at * GRID).astype(int), 0, GRID - 1)
            low, high = table[rows, columns, cell], table[rows, columns, cell + 1]
            return low + (at * GRID - cell) * (high - low)

        means = (integral(middle + half) - integral(middle - half)) / (2 * half)
        return jnp.prod(means, axis=2) @ worth

    return _scaled(space, raw, 10.0)


def ridge(seed: int, space: sdr_jax.Space) -> Scaled:
    """`b.x - 4 |a.x|`: a sharp ridge in a random direction over all attributes, to be followed uphill."""
    rng = np.random.default_rng([seed, 5])
    across, along = np.linalg.qr(rng.normal(size=(space.attributes, 2)))[0].T.astype(np.float32)
    start = rng.uniform(0.2, 0.8, space.attributes).astype(np.float32)
    offsets = jnp.asarray(qmc.Sobol(space.attributes, seed=0).random(POINTS), jnp.float32) - 0.5

    @jax.jit
    def raw(centre: jax.Array, width: jax.Array) -> jax.Array:
        x = centre[:, None] + width[:, None] * offsets[None] - start[None, None]
        return jnp.mean(x @ along - 4 * jnp.abs(x @ across), axis=1)

    return _scaled(space, raw, 10.0)


def categories(seed: int) -> Scaled:
    """A table of unordered attributes with 2 to 6 values each: effects of one, two and three together."""
    rng = np.random.default_rng([seed, 6])
    names = [f"x{k}" for k in range(len(CHOICES))]
    space = sdr_jax.space(names, CHOICES, [names[:4], names[4:]], unordered=names)
    table = np.zeros(CHOICES)
    for order, share in SHARES.items():
        table += _effects(rng, CHOICES, order, share)
    return _tabular(space, table, 10.0)


def binary(seed: int) -> Scaled:
    """All 2^8 rewards of eight switches, without noise: effects of each order have half of the last's."""
    rng = np.random.default_rng([seed, 7])
    table = sum(_effects(rng, (2,) * 8, order, 0.5**order) for order in range(1, 9))
    return _tabular(sdr_jax.space([f"x{k}" for k in range(8)], 2), np.asarray(table), 0.0)


def _effects(
    rng: np.random.Generator, sizes: tuple[int, ...], order: int, share: float
) -> np.ndarray:
    """Effects of every so many attributes together, of a variance in all."""
    found = np.zeros(sizes)
    for members in combinations(range(len(sizes)), order):
        shape = [size if axis in members else 1 for axis, size in enumerate(sizes)]
        effect = rng.normal(size=shape)
        for axis in members:
            effect = effect - effect.mean(axis=axis, keepdims=True)
        found += effect
    return np.sqrt(share) * found / found.std()


def _tabular(space: sdr_jax.Space, table: np.ndarray, noise: float) -> Scaled:
    """The mean of the entries that a proposal's intervals cover, by how much they do."""

    def raw(centre: jax.Array, width: jax.Array) -> jax.Array:
        covered = [
            _covered(np.asarray(centre)[:, axis], np.asarray(width)[:, axis], size)
            for axis, size in enumerate(table.shape)
        ]
        values = np.einsum("na,a...->n...", covered[0], table)
        for shares in covered[1:]:
            values = np.einsum("na,na...->n...", shares, values)
        return jnp.asarray(values, jnp.float32)

    return Scaled(space, raw, noise, float(table.mean()), float(table.max() - table.mean()) / 100)


def _covered(centre: np.ndarray, width: np.ndarray, size: int) -> np.ndarray:
    """How much of n intervals lies in each of so many bins, f64[n size]."""
    edges = np.arange(size + 1) / size
    width = np.maximum(width, 1e-6)[:, None]
    filled = np.diff(np.clip((edges - centre[:, None]) / width + 0.5, 0, 1), axis=1)
    return filled / filled.sum(axis=1, keepdims=True)


def _scaled(space: sdr_jax.Space, raw: Raw, noise: float) -> Scaled:
    """Between random attributes and the best bins that coordinate ascent finds from 16 starts."""
    rng, bins = np.random.default_rng(0), np.asarray(space.bins)
    found = rng.integers(0, bins, (16, space.attributes)).astype(np.int32)
    for _ in range(6):
        for i, size in enumerate(space.bins):
            tried = np.repeat(found[:, None], size, axis=1)
            tried[:, :, i] = np.arange(size)
            values = raw(*sdr_jax.relax(space, tried.reshape(-1, space.attributes)))
            found[:, i] = np.asarray(values).reshape(len(found), size).argmax(axis=1)
    top = float(raw(*sdr_jax.relax(space, found)).max())
    random = sdr_jax.relax(space, np.full((1, space.attributes), -1))
    zero = float(raw(*random)[0])
    return Scaled(space, raw, noise, zero, (top - zero) / 100)
