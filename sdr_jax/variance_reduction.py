"""Variance reduction that the paper does not use, and the table of all baselines by name."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from sdr_jax.baseline import Baseline, BaselineState, ema
from sdr_jax.rewards import mean_without_nan

EPSILON = 1e-6
"""Added to the root mean square of advantages, which may all be 0."""


def leave_one_out() -> Baseline:
    """Compare each data set with the others of its update, `b_k = mean of r_j over j != k`.

    It needs two or more data sets per update (ValueError when traced with one), has no memory and
    leaves the estimate unbiased.

    Source: not in the paper; Kool et al. 2019, "Buy 4 REINFORCE samples, get a baseline for free!".
    """

    def advantage(
        state: BaselineState, rewards: Float[Array, "n"]
    ) -> tuple[Float[Array, "n"], BaselineState]:
        n = rewards.shape[0]
        if n < 2:
            raise ValueError("leave_one_out needs at least 2 data sets per update, got 1")
        count = jnp.sum(~jnp.isnan(rewards))
        mean = mean_without_nan(rewards)
        differences = rewards - mean
        of_some = differences * count / jnp.maximum(count - 1, 1)
        advantages = jnp.where(count == n, differences * n / (n - 1), of_some)
        return advantages, BaselineState(mean, state.updates + 1)

    return Baseline(advantage, min_rewards=2)


def normalised(advantages: Float[Array, "n"]) -> Float[Array, "n"]:
    """Divide advantages by their root mean square, `a / (sqrt(mean(a^2)) + 1e-6)`.

    The standard deviation would not do: it is 0 with one data set, and where all rewards are equal.
    """
    return advantages / (jnp.sqrt(mean_without_nan(advantages**2)) + EPSILON)


BASELINES = {
    "ema": ema(),
    "ema_current": ema(includes_current=True),
    "leave_one_out": leave_one_out(),
}
"""The paper's baseline, that of the authors' code, and the mean of the update's other rewards."""


def baseline_of(baseline: str | Baseline) -> Baseline:
    """Look up a baseline by its name in `BASELINES`; a `Baseline` is returned as it is.

    Raises:
        ValueError: an unknown name.
    """
    if isinstance(baseline, Baseline):
        return baseline
    if baseline not in BASELINES:
        raise ValueError(f"baseline is {baseline!r}, but must be one of {', '.join(BASELINES)}")
    return BASELINES[baseline]
