"""Bayesian optimisation with a Gaussian process, a host adapter of the library scikit-learn."""

import warnings
from functools import lru_cache
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.linalg import solve_triangular
from scipy.stats import norm

from benchmarks.rivals import host
from sdr_jax.bins import ordered
from sdr_jax.distributions import moments, uniform
from sdr_jax.method import Bins, Diagnostics, Info, Method, Rewards, RngKey
from sdr_jax.relaxation import UNDECIDED
from sdr_jax.space import Proposal, Space, Width

GROWTH = 1.25
"""Scales and noise are fitted again each time the number of evaluations has grown by this factor."""

NEAR = 8
"""Number of evaluations with the highest means, around which half of the candidates lie."""


def gaussian_process(
    space: Space,
    *,
    width: Width = None,
    startup: int = 10,
    candidates: int = 1000,
) -> Method:
    """Propose where a Gaussian process expects the greatest improvement.

    The kernel is a Matern 5/2 with one length scale, a scale of rewards and white noise, all three by
    maximum likelihood; ordered bins are numbers in [0, 1], bins without an order one number each. The
    improvement is over the highest mean of the evaluated data sets. Candidates are random, or differ from
    the best in one to three attributes. The n data sets of an update are chosen one after the other, and
    each counts as if it had its mean as reward (the kriging believer). The answer is the evaluated data
    set with the highest mean. Groups have no effect.

    This is a host adapter, which cannot be jitted: `drive` takes it, `run` does not. Otherwise it behaves
    like the pure methods: the same key gives the same data sets, and earlier states stay valid.

    `probabilities` and `spread` are estimated from the quarter of the evaluations with the highest means,
    and a uniform distribution with the weight of one evaluation.

    Args:
        space: the attributes and their bins.
        width: width of the relaxed bins, see `relax`.
        startup: number of random evaluations before the model is used.
        candidates: number of data sets among which the best is chosen.

    Returns:
        The method, for any number of updates.

    Raises:
        ImportError: `scikit-learn` is not installed.
        ValueError: an option out of range.

    Source: not in the paper; Jones et al. 1998, "Efficient global optimization of expensive black-box
    functions"; Ginsbourger et al. 2010, "Kriging is well-suited to parallelize optimization".
    """
    host.needs("sklearn", "gaussian_process", "scikit-learn")
    from sklearn import gaussian_process as library

    relaxed = host.relaxation(space, width)
    if startup < 1:
        raise ValueError(f"startup is {startup}, but must be 1 or more")
    if candidates < 2:
        raise ValueError(f"candidates is {candidates}, but must be 2 or more")
    prior, bins = np.asarray(uniform(space)), np.asarray(space.bins)

    def encoded(actions: np.ndarray) -> np.ndarray:
        columns = []
        for column, count, in_order in zip(actions.T, space.bins, ordered(space), strict=True):
            if in_order:
                columns.append(column[:, None] / max(count - 1, 1))
            else:  # two values are as far apart as the ends of an ordered attribute
                columns.append(np.eye(count)[column] / np.sqrt(2))
        return np.concatenate(columns, axis=1)

    def fit(kernel: Any, actions: np.ndarray, values: np.ndarray, optimizer: str | None) -> Any:
        model = library.GaussianProcessRegressor(kernel, optimizer=optimizer)
        with warnings.catch_warnings():  # parameters at their bounds are expected
            warnings.simplefilter("ignore")
            return model.fit(encoded(actions), values)

    @lru_cache(maxsize=4)
    def fitted_kernel(actions: bytes, rewards: bytes) -> Any:
        """Fit the parameters of the kernel to these evaluations."""
        rows = np.frombuffer(actions, np.int32).reshape(-1, space.attributes)
        kernels = library.kernels
        kernel = kernels.ConstantKernel(1.0, (1e-2, 1e2)) * kernels.Matern(
            np.sqrt(space.attributes) / 2, (1e-2, 1e2), nu=2.5
        ) + kernels.WhiteKernel(0.1, (1e-6, 1e1))
        return fit(kernel, rows, _standard(np.frombuffer(rewards)), "fmin_l_bfgs_b").kernel_

    latest: tuple[host.Evaluations, Any] | None = None

    def fitted(state: host.Evaluations) -> Any:
        """The process after all evaluations, with parameters fitted to the first ones, see `GROWTH`."""
        nonlocal latest
        if latest is None or latest[0] is not state:
            steps = np.floor(np.log(len(state.rewards)) / np.log(GROWTH) + 1e-9)
            first = int(np.ceil(GROWTH**steps - 1e-9))
            kernel = fitted_kernel(state.actions[:first].tobytes(), state.rewards[:first].tobytes())
            latest = state, fit(kernel, state.actions, _standard(state.rewards), None)
        return latest[1]

    def means(model: Any, actions: np.ndarray) -> np.ndarray:
        """Predict the mean rewards of data sets, in standard deviations of all rewards."""
        return model.predict(encoded(actions))

    def candidate_rows(rng: np.random.Generator, best: np.ndarray) -> np.ndarray:
        """Make candidates: random ones, and neighbours of the best."""
        rows = rng.integers(0, bins, (candidates, space.attributes), np.int32)
        around = best[rng.integers(0, len(best), candidates // 2)]
        # The one to three attributes with the lowest numbers are those of the random candidate.
        rank = rng.random(around.shape).argsort(axis=1).argsort(axis=1)
        changed = rank < rng.integers(1, 4, (len(around), 1))
        rows[: len(around)] = np.where(changed, rows[: len(around)], around)
        return rows

    def promising(model: Any, actions: np.ndarray, rows: np.ndarray, n: int) -> list[int]:
        """Choose n rows by expected improvement over the highest mean, one after the other.

        A row that counts with its mean changes no other mean; deviations shrink as for any evaluation.
        """
        signal, noise = model.kernel_.k1, model.kernel_.k2.noise_level
        x, mean = encoded(rows), means(model, rows)
        highest = means(model, actions).max()
        explained = solve_triangular(model.L_, signal(encoded(actions), x), lower=True)
        left = signal.diag(x) - (explained**2).sum(axis=0)
        chosen: list[int] = []
        while len(chosen) < n:
            # The deviation is that of the mean, without the noise of a reward.
            deviation = np.sqrt(np.maximum(left, 1e-12))
            gain = mean - highest
            expected = gain * norm.cdf(gain / deviation) + deviation * norm.pdf(gain / deviation)
            best = int(expected.argmax())
            chosen.append(best)
            highest = max(highest, mean[best])
            shared = signal(x[best][None], x)[0] - explained[:, best] @ explained
            column = shared / np.sqrt(max(left[best], 0.0) + noise)
            explained, left = np.vstack([explained, column]), left - column**2
        return chosen

    def init(rng_key: RngKey) -> host.Evaluations:
        del rng_key  # nothing is random before the first sample
        return host.no_evaluations(space)

    def sample(rng_key: RngKey, state: host.Evaluations, n: int) -> tuple[Bins, Proposal]:
        rng = np.random.default_rng(host.seed(rng_key))
        if len(state.rewards) < startup:
            actions = rng.integers(0, bins, (n, space.attributes), np.int32)
            return jnp.asarray(actions), relaxed(actions)
        model = fitted(state)
        best = np.argsort(-means(model, state.actions), kind="stable")[:NEAR]
        rows = candidate_rows(rng, state.actions[best])
        actions = rows[promising(model, state.actions, rows, n)]
        return jnp.asarray(actions), relaxed(actions)

    def update(
        state: host.Evaluations, actions: Bins, rewards: Rewards
    ) -> tuple[host.Evaluations, Info]:
        info = host.info(rewards, probabilities(state))
        return host.with_new(state, actions, rewards), info

    def solution(state: host.Evaluations) -> Proposal:
        if not len(state.rewards):
            return relaxed(np.full(space.attributes, UNDECIDED, np.int32))
        return relaxed(state.actions[means(fitted(state), state.actions).argmax()])

    def probabilities(state: host.Evaluations) -> Float[Array, "attributes bins"]:
        if not len(state.rewards):
            return jnp.asarray(prior)
        return host.best_quarter(prior, state.actions, means(fitted(state), state.actions))

    def spread(state: host.Evaluations) -> Proposal:
        return moments(space, probabilities(state), width)

    def predict(state: host.Evaluations, actions: Bins) -> tuple[Rewards, Rewards]:
        if not len(state.rewards):
            return (jnp.full(len(actions), jnp.nan),) * 2
        mean, std = fitted(state).predict(encoded(np.asarray(actions)), return_std=True)
        unit = _unit(state.rewards)
        return jnp.asarray(state.rewards.mean() + unit * mean), jnp.asarray(unit * std)

    return Method(
        init,
        sample,
        update,
        solution,
        Diagnostics(spread, probabilities, predict),
        traced=False,
    )


def _unit(rewards: np.ndarray) -> float:
    """The standard deviation of rewards; 1 if all of them are equal."""
    return float(rewards.std()) or 1.0


def _standard(rewards: np.ndarray) -> np.ndarray:
    """Standardise rewards: their difference from the mean, in standard deviations."""
    return (rewards - rewards.mean()) / _unit(rewards)
