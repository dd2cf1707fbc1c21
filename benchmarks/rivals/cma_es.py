"""CMA-ES with margin over the bins, a host adapter of the library `cmaes`."""

from copy import deepcopy
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from benchmarks.rivals import host
from sdr_jax.distributions import moments
from sdr_jax.method import Diagnostics, Info, Method, Rewards, RngKey, Values
from sdr_jax.relaxation import UNDECIDED
from sdr_jax.space import Proposal, Space, Width

DRAWS = 256
"""Number of draws from which `spread` and `probabilities` are estimated."""


class CmaState(NamedTuple):
    """A Python object, not a pytree of arrays; an update that changes the optimiser copies it."""

    optimizer: Any  # a `cmaes.CMAwM`
    generation: tuple[tuple[np.ndarray, float], ...]  # evaluations of the unfinished generation
    has_reward: bool  # whether any evaluation had a reward


def cma_es(
    space: Space,
    *,
    width: Width = None,
    sigma: float = 0.25,
    population: int | None = None,
) -> Method:
    """Covariance matrix adaptation with margin: a Gaussian over all attributes, rounded to bins.

    The margin keeps the probability of leaving a bin above 0; CMA-ES without it gets stuck where it vanishes.
    Bins without an order are taken as if they had one. The answer is the bins in which the mean lies;
    groups have no effect. A generation takes as many updates as it needs, with any n.

    This is a host adapter, which cannot be jitted: `drive` takes it, `run` does not. Otherwise it behaves
    like the pure methods: the same key gives the same data sets, and earlier states stay valid.

    Args:
        space: the attributes and their bins.
        width: width of the relaxed bins, see `relax`.
        sigma: standard deviation at the start, as a fraction of [0, 1].
        population: evaluations per generation; by default 4 + floor(3 log(attributes)).

    Returns:
        The method, for any number of updates; actions are the library's values before rounding,
        f32, in [0, 1] and a little beyond.

    Raises:
        ImportError: `cmaes` is not installed.
        ValueError: an option out of range, or a space of one attribute, which the library refuses.

    Source: not in the paper; Hamano et al. 2022, "CMA-ES with margin".
    """
    cmaes = host.needs("cmaes", "cma_es")
    relaxed = host.relaxation(space, width)
    if space.attributes < 2:
        raise ValueError(f"cma_es needs at least 2 attributes, this space has {space.attributes}")
    if not 0 < sigma <= 1:
        raise ValueError(f"sigma is {sigma}, but must lie in (0, 1]")
    if population is not None and population < 2:
        raise ValueError(f"population is {population}, but must be at least 2")
    sizes = np.asarray(space.bins)
    margin = 0.5 / sizes  # centres of bins lie in [margin, 1 - margin]

    def init(rng_key: RngKey) -> CmaState:
        optimizer = cmaes.CMAwM(
            mean=np.full(space.attributes, 0.5),
            sigma=sigma,
            bounds=np.stack([margin, 1 - margin], axis=1),
            steps=1.0 / sizes,
            seed=host.seed(rng_key),
            population_size=population,
        )
        return CmaState(optimizer, (), False)

    def sample(rng_key: RngKey, state: CmaState, n: int) -> tuple[Values, Proposal]:
        samples = samples_of(state, host.seed(rng_key), n)
        return jnp.asarray(samples[:, 1], jnp.float32), relaxed(bins_of(samples[:, 0]))

    def update(state: CmaState, actions: Values, rewards: Rewards) -> tuple[CmaState, Info]:
        optimizer, generation = state.optimizer, list(state.generation)
        for action, reward in zip(
            np.asarray(actions, np.float64), np.asarray(rewards), strict=True
        ):
            if not np.isfinite(reward):
                continue
            generation.append((action, -float(reward)))  # the library minimises
            if len(generation) == optimizer.population_size:
                optimizer = deepcopy(optimizer)
                optimizer.tell(generation)
                generation = []
        has_reward = state.has_reward or bool(np.any(np.isfinite(rewards)))
        info = host.info(rewards, probabilities(state))
        return CmaState(optimizer, tuple(generation), has_reward), info

    def bins_of(values: np.ndarray) -> np.ndarray:
        return np.clip(np.floor(values * sizes), 0, sizes - 1).astype(np.int32)

    def solution(state: CmaState) -> Proposal:
        best = bins_of(state.optimizer.mean)
        return relaxed(best if state.has_reward else np.full_like(best, UNDECIDED))

    def samples_of(state: CmaState, seed: int, n: int) -> np.ndarray:
        """Sample the optimiser, f64[n 2 attributes], rounded and raw; the state is not changed."""
        optimizer = deepcopy(state.optimizer)
        optimizer.reseed_rng(seed)
        return np.asarray([optimizer.ask() for _ in range(n)])

    def spread(state: CmaState) -> Proposal:
        return moments(space, probabilities(state), width)

    def probabilities(state: CmaState) -> Float[Array, "attributes bins"]:
        # With a fixed seed the same evaluations give the same shares.
        bins = bins_of(samples_of(state, 0, DRAWS)[:, 0])
        shares = (bins[:, :, None] == np.arange(space.max_bins)).mean(axis=0)
        return jnp.asarray(shares, jnp.float32)

    return Method(init, sample, update, solution, Diagnostics(spread, probabilities), traced=False)
