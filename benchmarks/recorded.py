"""Recorded rewards on real CamVid, and a surrogate fitted to them that predicts rewards of any bins.

Each line of `data/camvid.jsonl` is one reward of an early engine: bins of all 23 attributes, and the mIoU on
sequences 0016E5 and 0001TP, in percent, of a network trained on 96 images of 64x48 rendered with them.
The adaptive ones come first (method `surrogate` at temperatures 0.7 and 1, 288 each), then 128 random ones.
The surrogate is a Gaussian process, a model that none of the methods has: Matern 5/2 over all attributes at
once, with a length scale per attribute. Scales, size and noise maximise the evidence.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import cho_solve, cholesky
from scipy.optimize import minimize
from scipy.stats import qmc

import sdr_jax

RECORD = Path(__file__).parent / "data" / "camvid.jsonl"
WIDTH = 0.3
"""Width of the relaxed bins when the rewards were recorded."""

POINTS = 64
"""Number of centres over which a wider interval is averaged."""


@dataclass(frozen=True, eq=False)
class Surrogate:
    """The mean of a Gaussian process, with its fitted noise."""

    space: sdr_jax.Space
    centres: jax.Array  # f32[records attributes], divided by the length scales
    lengths: jax.Array  # f32[attributes]
    weights: jax.Array  # f32[records]: weight of each record, with the kernel's size
    mean: float  # of all rewards, in percent
    noise: float  # standard deviation of a reward, in percent

    def reward(self, rng_key: jax.Array, proposals: sdr_jax.Proposal) -> jax.Array:
        """Sample the mIoU in percent with normal noise; the key is consumed."""
        return _noisy(rng_key, self._values(proposals), self.noise)

    def true_value(self, proposal: sdr_jax.Proposal) -> float:
        """Compute the value without noise."""
        centre, width = (jnp.asarray(part)[None] for part in proposal)
        return float(self._values(sdr_jax.Proposal(centre, width))[0])

    def _values(self, proposals: sdr_jax.Proposal) -> jax.Array:
        # Intervals no wider than those of the records have one centre.
        points = POINTS if np.any(np.asarray(proposals.width) > WIDTH) else 1
        return _predict(
            self.centres, self.lengths, self.weights, *proposals, self.mean, points=points
        )


@jax.jit
def _noisy(rng_key: jax.Array, values: jax.Array, noise: float) -> jax.Array:
    return values + noise * jax.random.normal(rng_key, values.shape)


@partial(jax.jit, static_argnames="points")
def _predict(
    centres: jax.Array,
    lengths: jax.Array,
    weights: jax.Array,
    centre: jax.Array,
    width: jax.Array,
    mean: float,
    points: int,
) -> jax.Array:
    """Average over the intervals of the records' width within each interval, f32[n]."""
    slack = jnp.maximum(width - WIDTH, 0.0)
    offsets = jnp.asarray(_points(centre.shape[1])[:points]) - 0.5
    at = centre[:, None] + slack[:, None] * offsets[None]
    # Recorded centres were slid inside; narrower intervals further out have no records.
    at = jnp.clip(at, WIDTH / 2, 1 - WIDTH / 2) / lengths[None, None]
    added = _matern(jnp, at[:, :, None] - centres[None, None]) @ weights
    return jnp.mean(added, axis=1) + mean


@cache
def _points(attributes: int) -> np.ndarray:
    return qmc.Sobol(attributes, seed=0).random(POINTS).astype(np.float32)


def _matern(xp, difference):  # type: ignore[no-untyped-def]
    """Matern 5/2 of scaled differences [... attributes], in NumPy or JAX."""
    distance = xp.sqrt(5 * (difference**2).sum(axis=-1) + 1e-12)
    return (1 + distance + distance**2 / 3) * xp.exp(-distance)


def read(path: Path = RECORD) -> tuple[np.ndarray, np.ndarray]:
    """Read bins i64[records attributes] and rewards f64[records] in percent."""
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return np.asarray([r["bins"] for r in lines]), np.asarray([r["reward"] for r in lines])


@cache
def camvid() -> Surrogate:
    """Fit the surrogate of the committed records."""
    from experiments.config import MainConfig, make_space
    from experiments.config.presets import defaults

    return fit(make_space(defaults(MainConfig, "camvid", "quick")), *read())


def fit(space: sdr_jax.Space, bins: np.ndarray, rewards: np.ndarray) -> Surrogate:
    """Fit the surrogate by maximising the evidence, with a weak preference for smooth functions."""
    centre = np.asarray(sdr_jax.relax(space, bins.astype(np.int32), WIDTH).centre, np.float64)
    mean, spread = rewards.mean(), rewards.std()
    y = (rewards - mean) / spread

    def kernel(log: jax.Array) -> jax.Array:
        scaled = jnp.asarray(centre) / jnp.exp(log[2:])[None]
        size, noise = jnp.exp(log[0]), jnp.exp(log[1])
        between = _matern(jnp, scaled[:, None] - scaled[None])
        return size * between + noise * jnp.eye(len(y))

    @jax.jit
    def loss(log: jax.Array) -> jax.Array:
        factor = jnp.linalg.cholesky(kernel(log))
        half = jax.scipy.linalg.solve_triangular(factor, jnp.asarray(y), lower=True)
        # A normal prior of log lengths around length 2, since the evidence alone would fit 25 numbers.
        prior = 0.5 * jnp.sum((log[2:] - jnp.log(2.0)) ** 2)
        return 0.5 * half @ half + jnp.log(jnp.diag(factor)).sum() + prior

    gradient = jax.jit(jax.value_and_grad(loss))

    def both(log: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = gradient(jnp.asarray(log, jnp.float32))
        return float(value), np.asarray(slope, np.float64)

    start = np.concatenate([[0.0, np.log(0.5)], np.full(space.attributes, np.log(2.0))])
    bounds = [(-3, 3), (np.log(0.02), np.log(2))] + [(np.log(0.2), np.log(20))] * space.attributes
    log = minimize(
        both, start, jac=True, bounds=bounds, method="L-BFGS-B", options={"maxiter": 80}
    ).x
    size, noise, lengths = np.exp(log[0]), np.exp(log[1]), np.exp(log[2:])
    scaled = centre / lengths
    gram = size * _matern(np, scaled[:, None] - scaled[None]) + noise * np.eye(len(y))
    weights = size * cho_solve((cholesky(gram, lower=True), True), y)
    return Surrogate(
        space,
        jnp.asarray(scaled, jnp.float32),
        jnp.asarray(lengths, jnp.float32),
        jnp.asarray(spread * weights, jnp.float32),
        float(mean),
        float(spread * np.sqrt(noise)),
    )
