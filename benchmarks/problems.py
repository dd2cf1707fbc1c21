"""Problems with known answers for searches: analytic rewards of ordered attributes, with noise.

Values are sums of one function per attribute and of products of two within a group, tabulated on a fixed
grid, so that the mean over a proposal's intervals is exact. 0 is the value of random attributes, 100 that of
the best bins. This file also has what all problems share; `benchmarks.foreign` has problems of other forms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np

import sdr_jax
from sdr_jax.models.choices import covered

GRID = 400
"""Number of cells of [0, 1]; functions are constant on each."""

GROUPS = (7, 2, 2, 2, 2, 8)
"""Sizes of the groups, as in the experiments: positions, densities in pairs, environment."""

BINS = 10

Raw = Callable[[jax.Array, jax.Array], jax.Array]
"""Computes values f32[n] in any unit from the centres and widths f32[n attributes] of proposals."""


class Problem(Protocol):
    """A problem for `benchmarks.search.evaluate`: implement these three."""

    @property
    def space(self) -> sdr_jax.Space:
        """The attributes, their bins and groups."""

    def reward(self, rng_key: jax.Array, proposals: sdr_jax.Proposal) -> jax.Array:
        """Sample noisy rewards f32[n] of proposals f32[n attributes]."""

    def true_value(self, proposal: sdr_jax.Proposal) -> float:
        """Compute the expected reward of one proposal f32[attributes]."""


@dataclass(frozen=True, eq=False)
class Scaled:
    """Values on any scale, with normal noise."""

    space: sdr_jax.Space
    raw: Raw
    noise: float  # standard deviation of a reward
    zero: float = 0.0  # raw value that counts as 0
    unit: float = 1.0  # raw difference that counts as 1

    def reward(self, rng_key: jax.Array, proposals: sdr_jax.Proposal) -> jax.Array:
        """Sample values with normal noise; the key is consumed."""
        values = (self.raw(*map(jnp.asarray, proposals)) - self.zero) / self.unit
        return values + self.noise * jax.random.normal(rng_key, values.shape)

    def true_value(self, proposal: sdr_jax.Proposal) -> float:
        """Compute the value without noise."""
        centre, width = (jnp.asarray(part)[None] for part in proposal)
        return float((self.raw(centre, width)[0] - self.zero) / self.unit)


def scaled(space: sdr_jax.Space, raw: Raw, best: np.ndarray | None = None) -> Scaled:
    """Scale values so that random attributes have 0 and the best bins 100, with a noise of 10.

    Args:
        space: the space of the attributes.
        raw: the values.
        best: bins i32[n attributes] that include the best; by default coordinate ascent finds them from 16
            starts.
    """
    best = _ascent(space, raw) if best is None else best
    top = float(raw(*sdr_jax.relax(space, best)).max())
    zero = float(raw(*sdr_jax.relax(space, np.full((1, space.attributes), -1)))[0])
    return Scaled(space, raw, 10.0, zero, (top - zero) / 100)


def _ascent(space: sdr_jax.Space, raw: Raw) -> np.ndarray:
    rng, bins = np.random.default_rng(0), np.asarray(space.bins)
    best = rng.integers(0, bins, (16, space.attributes)).astype(np.int32)
    for _ in range(6):
        for i, size in enumerate(space.bins):
            actions = np.repeat(best[:, None], size, axis=1)
            actions[:, :, i] = np.arange(size)
            values = raw(*sdr_jax.relax(space, actions.reshape(-1, space.attributes)))
            best[:, i] = np.asarray(values).reshape(len(best), size).argmax(axis=1)
    return best


def tabular(space: sdr_jax.Space, table: np.ndarray, noise: float = 0.0) -> Scaled:
    """Make the problem of a table of rewards f64[bins of attribute 0, bins of attribute 1, ...].

    The value of a proposal is the mean of the entries that its intervals cover, weighted by the coverage.
    """

    def raw(centre: jax.Array, width: jax.Array) -> jax.Array:
        shares = [
            covered(size, np.asarray(centre)[:, axis], np.asarray(width)[:, axis])
            for axis, size in enumerate(table.shape)
        ]
        values = np.einsum("na,a...->n...", shares[0], table)
        for share in shares[1:]:
            values = np.einsum("na,na...->n...", share, values)
        return jnp.asarray(values, jnp.float32)

    return Scaled(space, raw, noise)


def integrals_of(functions: np.ndarray) -> jax.Array:
    """Compute integrals from 0 to each edge of the grid, f32[rows grid+1 functions].

    Args:
        functions: f64[rows functions grid], their values on the cells.
    """
    cumulative = np.cumsum(functions, axis=2) / GRID
    return jnp.asarray(np.pad(cumulative, [(0, 0), (0, 0), (1, 0)]).transpose(0, 2, 1), jnp.float32)


def means(integrals: jax.Array, centre: jax.Array, width: jax.Array) -> jax.Array:
    """Compute the exact mean of each row's functions over its interval, f32[n rows functions].

    Args:
        integrals: f32[rows grid+1 functions], from `integrals_of`.
        centre: f32[n rows], the middle of the intervals.
        width: f32[n rows], their length; a point takes the value of its cell.
    """
    width = jnp.maximum(width, 1e-3)
    centre = jnp.clip(centre, width / 2, 1 - width / 2)
    rows = jnp.arange(integrals.shape[0])[None, :]

    def integral(unit: jax.Array) -> jax.Array:
        cell = jnp.clip((unit * GRID).astype(int), 0, GRID - 1)
        low, high = integrals[rows, cell], integrals[rows, cell + 1]
        return low + (unit * GRID - cell)[:, :, None] * (high - low)

    return (integral(centre + width / 2) - integral(centre - width / 2)) / width[:, :, None]


@jax.jit
def _pairwise(integrals: jax.Array, centre: jax.Array, width: jax.Array) -> jax.Array:
    """`sum_i f_i(u_i) + sum_{i<j in a group} h_ij(u_i) h_ji(u_j)`, u uniform on the intervals, f32[n].

    The integrals of attribute i are those of f_i, then of h_i0, h_i1, ...
    """
    parts = means(integrals, centre, width)
    halves = parts[:, :, 1:]
    pairs = jnp.sum(halves * halves.transpose(0, 2, 1), axis=(1, 2))
    return parts[:, :, 0].sum(axis=1) + 0.5 * pairs


def grouped_space() -> sdr_jax.Space:
    """Make a space of 23 attributes with 10 bins each, in six groups."""
    groups = [[f"{'abcdef'[g]}{i}" for i in range(size)] for g, size in enumerate(GROUPS)]
    return sdr_jax.space([name for group in groups for name in group], BINS, groups)


def smooth(seed: int) -> Scaled:
    """One broad optimum; within groups the best value of one attribute depends on the others."""
    rng = np.random.default_rng([seed, 0])
    space, functions, _ = _bowl(rng, np.ones(sum(GROUPS), bool))
    return analytic(space, functions)


def rugged(seed: int) -> Scaled:
    """The smooth problem with ripples of attributes alone and of pairs."""
    rng = np.random.default_rng([seed, 1])
    space, functions, weights = _bowl(rng, np.ones(sum(GROUPS), bool))
    u = cells()
    for i in range(space.attributes):
        waves, phase = rng.uniform(2, 5), rng.uniform(0, 2 * np.pi)
        functions[i, 0] += 0.06 * weights[i] * np.sin(2 * np.pi * waves * u + phase)
    for i, j in _pairs(space):
        for one, other in ((i, j), (j, i)):
            waves, phase = rng.uniform(0.5, 1.5), rng.uniform(0, 2 * np.pi)
            functions[one, 1 + other] += 0.1 * np.sin(2 * np.pi * waves * u + phase)
    return analytic(space, functions)


def plateau(seed: int) -> Scaled:
    """Flat except for a window in each attribute, which counts for more if its group is in theirs, too."""
    rng = np.random.default_rng([seed, 2])
    space, u = grouped_space(), cells()
    functions = np.zeros((space.attributes, 1 + space.attributes, GRID))
    weights = rng.lognormal(0, 0.5, space.attributes)
    centre, reach = (rng.uniform(a, b, space.attributes) for a, b in ((0.1, 0.9), (0.1, 0.2)))
    windows = 1 / (1 + np.exp((np.abs(u[None] - centre[:, None]) - reach[:, None]) / 0.02))
    functions[:, 0] = weights[:, None] * windows
    sizes = {i: len(group) for group in space.groups for i in group}
    for i, j in _pairs(space):
        weight = rng.uniform(0, 1) * np.sqrt(weights[i] * weights[j]) / (sizes[i] - 1)
        functions[i, 1 + j], functions[j, 1 + i] = weight * windows[i], windows[j]
    return analytic(space, functions)


def weak_signal(seed: int) -> Scaled:
    """The smooth problem with 5 attributes with effects, 18 without, and more noise."""
    rng = np.random.default_rng([seed, 3])
    matters = np.zeros(sum(GROUPS), bool)
    matters[rng.choice(sum(GROUPS), 5, replace=False)] = True
    space, functions, _ = _bowl(rng, matters)
    return replace(analytic(space, functions), noise=30.0)


def cells() -> np.ndarray:
    """The middle of each cell of the grid, f64[grid]."""
    return (np.arange(GRID) + 0.5) / GRID


def _pairs(space: sdr_jax.Space) -> list[tuple[int, int]]:
    return [pair for group in space.groups for pair in combinations(group, 2)]


def _bowl(
    rng: np.random.Generator, matters: np.ndarray
) -> tuple[sdr_jax.Space, np.ndarray, np.ndarray]:
    """`-sum_i w_i x_i^2 - sum_ij r_ij x_i x_j` around a random optimum, r within groups."""
    space, u = grouped_space(), cells()
    weights = rng.lognormal(0, 0.5, space.attributes) * matters
    x = u[None] - rng.uniform(0.05, 0.95, space.attributes)[:, None]
    functions = np.zeros((space.attributes, 1 + space.attributes, GRID))
    functions[:, 0] = -weights[:, None] * x**2
    sizes = {i: len(group) for group in space.groups for i in group}
    for i, j in _pairs(space):
        # Less than the sum of the squares, so that the optimum stays in place.
        lean = rng.uniform(-1.8, 1.8) * np.sqrt(weights[i] * weights[j]) / (sizes[i] - 1)
        functions[i, 1 + j], functions[j, 1 + i] = -lean * x[i], x[j]
    return space, functions, weights


def analytic(space: sdr_jax.Space, functions: np.ndarray) -> Scaled:
    """Make the problem of functions f64[attributes 1+attributes grid]: f_i, then h_i0, h_i1, ..."""
    raw = partial(_pairwise, integrals_of(functions))
    return scaled(space, raw, _best_bins(space, functions)[None])


def _best_bins(space: sdr_jax.Space, functions: np.ndarray, starts: int = 64) -> np.ndarray:
    """Find the best bins by coordinate ascent from many starts."""
    rng = np.random.default_rng(0)
    means = functions.reshape(*functions.shape[:2], BINS, -1).mean(axis=3)  # [i, 1+j, bins]
    rows = np.arange(space.attributes)
    bins = rng.integers(0, BINS, (starts, space.attributes))
    for _ in range(12):
        for i in rows:
            others = means[rows[None, :], 1 + i, bins]  # [starts, j]: h_ji at their bins
            bins[:, i] = (means[i, 0][None] + others @ means[i, 1:]).argmax(axis=1)
    alone = means[rows[None, :], 0, bins].sum(axis=1)
    halves = means[rows[None, :, None], 1 + rows[None, None, :], bins[:, :, None]]
    pairs = 0.5 * (halves * halves.transpose(0, 2, 1)).sum(axis=(1, 2))
    return bins[(alone + pairs).argmax()].astype(np.int32)
