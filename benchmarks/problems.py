"""Problems for searches whose answer is known: analytic rewards of ordered attributes, with noise.

Values are sums of one function per attribute and of products of two within a group, tabulated on a
fixed grid: so the mean over a proposal's intervals is exact. 0 is the value of random attributes, 100
that of the best bins.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np

import sdr_jax
from benchmarks import foreign, recorded

GRID = 400
"""Cells that [0, 1] is cut into; functions are constant on each."""

GROUPS = (7, 2, 2, 2, 2, 8)
"""Sizes of the groups, as in the experiments: positions, densities in pairs, environment."""

BINS = 10


class Problem(Protocol):
    """What `benchmarks.search.evaluate` takes: bring your own."""

    @property
    def space(self) -> sdr_jax.Space:
        """The attributes, their bins and groups."""

    def reward(self, rng_key: jax.Array, proposals: sdr_jax.Proposal) -> jax.Array:
        """Noisy rewards f32[n] of proposals f32[n attributes]."""

    def true_value(self, proposal: sdr_jax.Proposal) -> float:
        """The expected reward of one proposal f32[attributes]."""


@dataclass(frozen=True, eq=False)
class Analytic:
    """`v = sum_i f_i(u_i) + sum_{i<j in a group} h_ij(u_i) h_ji(u_j)`, u uniform on the intervals."""

    space: sdr_jax.Space
    integrals: jax.Array  # f32[attributes grid+1 1+attributes]: of f_i, then of h_i0, h_i1, ...
    noise: float  # standard deviation of a reward
    zero: float  # raw value of random attributes
    unit: float  # raw difference that counts as 1

    def reward(self, rng_key: jax.Array, proposals: sdr_jax.Proposal) -> jax.Array:
        """Values with normal noise; the key is consumed."""
        return _reward(rng_key, self.integrals, *proposals, self.zero, self.unit, self.noise)

    def true_value(self, proposal: sdr_jax.Proposal) -> float:
        """The value without noise."""
        return float(_value(self.integrals, *proposal, self.zero, self.unit))


@jax.jit
def _raw(integrals: jax.Array, centre: jax.Array, width: jax.Array) -> jax.Array:
    """The exact mean of v over each proposal's intervals, f32[n]."""
    width = jnp.maximum(width, 1e-3)  # a point: the mean of its neighbourhood
    centre = jnp.clip(centre, width / 2, 1 - width / 2)
    rows = jnp.arange(integrals.shape[0])[None, :]

    def integral(unit: jax.Array) -> jax.Array:
        cell = jnp.clip((unit * GRID).astype(int), 0, GRID - 1)
        low, high = integrals[rows, cell], integrals[rows, cell + 1]
        return low + (unit * GRID - cell)[:, :, None] * (high - low)

    means = (integral(centre + width / 2) - integral(centre - width / 2)) / width[:, :, None]
    halves = means[:, :, 1:]
    return means[:, :, 0].sum(axis=1) + 0.5 * jnp.sum(
        halves * halves.transpose(0, 2, 1), axis=(1, 2)
    )


@jax.jit
def _value(
    integrals: jax.Array, centre: jax.Array, width: jax.Array, zero: float, unit: float
) -> jax.Array:
    return (_raw(integrals, centre[None], width[None])[0] - zero) / unit


@jax.jit
def _reward(
    rng_key: jax.Array,
    integrals: jax.Array,
    centre: jax.Array,
    width: jax.Array,
    zero: float,
    unit: float,
    noise: float,
) -> jax.Array:
    values = (_raw(integrals, centre, width) - zero) / unit
    return values + noise * jax.random.normal(rng_key, values.shape)


@dataclass(frozen=True, eq=False)
class Tabular:
    """A table of rewards, one for each combination of bins.

    A proposal is worth what stands at the bins that its centres fall into; its widths mean nothing
    to a table, which has no values between its entries. (Random attributes are centre 0.5.)
    """

    space: sdr_jax.Space
    table: np.ndarray  # f64[bins of attribute 0, bins of attribute 1, ...]
    noise: float = 0.0  # standard deviation of a reward

    def reward(self, rng_key: jax.Array, proposals: sdr_jax.Proposal) -> jax.Array:
        """Entries with normal noise; the key is consumed."""
        values = jnp.asarray(self._entries(np.asarray(proposals.centre)), jnp.float32)
        return values + self.noise * jax.random.normal(rng_key, values.shape)

    def true_value(self, proposal: sdr_jax.Proposal) -> float:
        """The entry."""
        return float(self._entries(np.asarray(proposal.centre)[None])[0])

    def _entries(self, centre: np.ndarray) -> np.ndarray:
        sizes = np.asarray(self.table.shape)
        found = np.clip((centre * sizes).astype(int), 0, sizes - 1)
        return self.table[tuple(found.T)]


def grouped_space() -> sdr_jax.Space:
    """23 attributes with 10 bins each, in six groups."""
    groups = [[f"{'abcdef'[g]}{i}" for i in range(size)] for g, size in enumerate(GROUPS)]
    return sdr_jax.space([name for group in groups for name in group], BINS, groups)


def smooth(seed: int) -> Analytic:
    """One broad optimum; within groups the best value of one attribute leans on the others'."""
    rng = np.random.default_rng([seed, 0])
    space, functions, _ = _bowl(rng, np.ones(sum(GROUPS), bool))
    return _build(space, functions, noise=10.0)


def rugged(seed: int) -> Analytic:
    """The smooth problem under ripples, of attributes alone and of pairs."""
    rng = np.random.default_rng([seed, 1])
    space, functions, weights = _bowl(rng, np.ones(sum(GROUPS), bool))
    u = _grid()
    for i in range(space.attributes):
        waves, phase = rng.uniform(2, 5), rng.uniform(0, 2 * np.pi)
        functions[i, 0] += 0.06 * weights[i] * np.sin(2 * np.pi * waves * u + phase)
    for i, j in _pairs(space):
        for one, other in ((i, j), (j, i)):
            waves, phase = rng.uniform(0.5, 1.5), rng.uniform(0, 2 * np.pi)
            functions[one, 1 + other] += 0.1 * np.sin(2 * np.pi * waves * u + phase)
    return _build(space, functions, noise=10.0)


def plateau(seed: int) -> Analytic:
    """Flat but for a window in each attribute, worth more where its neighbours are in theirs."""
    rng = np.random.default_rng([seed, 2])
    space, u = grouped_space(), _grid()
    functions = np.zeros((space.attributes, 1 + space.attributes, GRID))
    weights = rng.lognormal(0, 0.5, space.attributes)
    centre, reach = (rng.uniform(a, b, space.attributes) for a, b in ((0.1, 0.9), (0.1, 0.2)))
    windows = 1 / (1 + np.exp((np.abs(u[None] - centre[:, None]) - reach[:, None]) / 0.02))
    functions[:, 0] = weights[:, None] * windows
    sizes = {i: len(group) for group in space.groups for i in group}
    for i, j in _pairs(space):
        worth = rng.uniform(0, 1) * np.sqrt(weights[i] * weights[j]) / (sizes[i] - 1)
        functions[i, 1 + j], functions[j, 1 + i] = worth * windows[i], windows[j]
    return _build(space, functions, noise=10.0)


def weak_signal(seed: int) -> Analytic:
    """The smooth problem with 5 attributes that matter, 18 that do not, and more noise."""
    rng = np.random.default_rng([seed, 3])
    matters = np.zeros(sum(GROUPS), bool)
    matters[rng.choice(sum(GROUPS), 5, replace=False)] = True
    space, functions, _ = _bowl(rng, matters)
    return _build(space, functions, noise=30.0)


PROBLEMS: dict[str, Callable[[int], Problem]] = {
    "smooth": smooth,
    "rugged": rugged,
    "plateau": plateau,
    "weak-signal": weak_signal,
    "camvid": lambda seed: recorded.camvid(),
    "products": lambda seed: foreign.products(seed, grouped_space()),
    "ridge": lambda seed: foreign.ridge(seed, grouped_space()),
    "categories": foreign.categories,
    "binary": foreign.binary,
}
"""Name -> the problem's instance of a seed."""


def _grid() -> np.ndarray:
    return (np.arange(GRID) + 0.5) / GRID


def _pairs(space: sdr_jax.Space) -> list[tuple[int, int]]:
    return [pair for group in space.groups for pair in combinations(group, 2)]


def _bowl(
    rng: np.random.Generator, matters: np.ndarray
) -> tuple[sdr_jax.Space, np.ndarray, np.ndarray]:
    """`-sum_i w_i x_i^2 - sum_ij r_ij x_i x_j` around a random optimum, r within groups."""
    space, u = grouped_space(), _grid()
    weights = rng.lognormal(0, 0.5, space.attributes) * matters
    x = u[None] - rng.uniform(0.05, 0.95, space.attributes)[:, None]
    functions = np.zeros((space.attributes, 1 + space.attributes, GRID))
    functions[:, 0] = -weights[:, None] * x**2
    sizes = {i: len(group) for group in space.groups for i in group}
    for i, j in _pairs(space):
        # Less than the squares together, so that the optimum stays where it is.
        lean = rng.uniform(-1.8, 1.8) * np.sqrt(weights[i] * weights[j]) / (sizes[i] - 1)
        functions[i, 1 + j], functions[j, 1 + i] = -lean * x[i], x[j]
    return space, functions, weights


def _build(space: sdr_jax.Space, functions: np.ndarray, noise: float) -> Analytic:
    cumulative = np.cumsum(functions, axis=2) / GRID
    padded = np.pad(cumulative, [(0, 0), (0, 0), (1, 0)]).transpose(0, 2, 1)
    integrals = jnp.asarray(padded, jnp.float32)
    random = sdr_jax.relax(space, np.full((1, space.attributes), -1))
    best = sdr_jax.relax(space, _best_bins(space, functions)[None])
    zero, top = (float(_raw(integrals, *proposal)[0]) for proposal in (random, best))
    return Analytic(space, integrals, noise, zero, (top - zero) / 100)


def _best_bins(space: sdr_jax.Space, functions: np.ndarray, starts: int = 64) -> np.ndarray:
    """The best bins, by coordinate ascent from many starts."""
    rng = np.random.default_rng(0)
    means = functions.reshape(*functions.shape[:2], BINS, -1).mean(axis=3)  # [i, 1+j, bins]
    rows = np.arange(space.attributes)
    found = rng.integers(0, BINS, (starts, space.attributes))
    for _ in range(12):
        for i in rows:
            others = means[rows[None, :], 1 + i, found]  # [starts, j]: h_ji at their bins
            found[:, i] = (means[i, 0][None] + others @ means[i, 1:]).argmax(axis=1)
    alone = means[rows[None, :], 0, found].sum(axis=1)
    halves = means[rows[None, :, None], 1 + rows[None, None, :], found[:, :, None]]
    pairs = 0.5 * (halves * halves.transpose(0, 2, 1)).sum(axis=(1, 2))
    return found[(alone + pairs).argmax()].astype(np.int32)
