"""Baselines: a reward is compared with one, so that its noise moves the policy less.

Rewards of NaN are left out of every mean, and so are their advantages, which are NaN, too.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sdr_jax.rewards import mean_known


class BaselineState(NamedTuple):
    """The memory of a baseline."""

    value: Float[Array, ""]  # the average so far
    seen: Int[Array, ""]  # number of updates


class Baseline(NamedTuple):
    """Two pure functions, and the number of rewards that they need."""

    init: Callable[[], BaselineState]
    # (state, rewards f32[n]) -> (advantages f32[n], state)
    advantage: Callable[[BaselineState, Float[Array, "n"]], tuple[Float[Array, "n"], BaselineState]]
    least: int = 1  # known rewards that an update needs


def _init() -> BaselineState:
    return BaselineState(jnp.zeros((), jnp.float32), jnp.zeros((), jnp.int32))


def ema(decay: float = 0.9, includes_current: bool = False) -> Baseline:
    """Exponential moving average of past rewards, `b <- decay b + (1 - decay) mean(rewards)`.

    The first update has no past: its baseline is the mean of its own rewards. With one data set
    per update this makes the first advantage zero.

    Args:
        decay: in [0, 1).
        includes_current: whether an update's baseline includes its own rewards. False (the paper, "over
            previous rewards") leaves the estimate unbiased. True (the authors' code) shrinks every
            advantage and biases the estimate a little.

    Returns:
        The baseline.

    Raises:
        ValueError: decay outside [0, 1).

    Source: section "Scalable Discretization-and-Relaxation", below the second equation.
    """
    if not 0 <= decay < 1:
        raise ValueError(f"decay is {decay}, but must lie in [0, 1)")

    def advantage(
        state: BaselineState, rewards: Float[Array, "n"]
    ) -> tuple[Float[Array, "n"], BaselineState]:
        mean = mean_known(rewards)
        first = state.seen == 0
        past = jnp.where(first, mean, state.value)
        present = jnp.where(first, mean, decay * past + (1 - decay) * mean)
        advantages = rewards - (present if includes_current else past)
        return advantages, BaselineState(present, state.seen + 1)

    return Baseline(_init, advantage)


def leave_one_out() -> Baseline:
    """Compares each data set with the others of its update, `b_k = mean of r_j over j != k`.

    It needs two or more data sets per update (ValueError when traced with one), has no memory and
    leaves the estimate unbiased. Not in the paper; Kool et al. 2019, "Buy 4 REINFORCE samples".
    """

    def advantage(
        state: BaselineState, rewards: Float[Array, "n"]
    ) -> tuple[Float[Array, "n"], BaselineState]:
        n = rewards.shape[0]
        if n < 2:
            raise ValueError("leave_one_out needs at least 2 data sets per update, got 1")
        known = jnp.sum(~jnp.isnan(rewards))
        mean = mean_known(rewards)
        apart = rewards - mean
        some = apart * known / jnp.maximum(known - 1, 1)
        advantages = jnp.where(known == n, apart * n / (n - 1), some)
        return advantages, BaselineState(mean, state.seen + 1)

    return Baseline(_init, advantage, least=2)


BASELINES = {
    "ema": ema(),
    "ema_current": ema(includes_current=True),
    "leave_one_out": leave_one_out(),
}
"""The paper's baseline, that of the authors' code, and the mean of the update's other rewards."""


def baseline_of(baseline: str | Baseline) -> Baseline:
    """Looks up a baseline by its name in `BASELINES`; one that is made already stays as it is.

    Raises:
        ValueError: an unknown name.
    """
    if isinstance(baseline, Baseline):
        return baseline
    if baseline not in BASELINES:
        raise ValueError(f"baseline is {baseline!r}, but must be one of {', '.join(BASELINES)}")
    return BASELINES[baseline]


def normalised(advantages: Float[Array, "n"], eps: float = 1e-6) -> Float[Array, "n"]:
    """Divides advantages by their size, `a / (sqrt(mean(a^2)) + eps)`.

    The size is the root mean square. The standard deviation would not do: it is 0 with one data set, and
    where all rewards are equal.
    """
    return advantages / (jnp.sqrt(mean_known(advantages**2)) + eps)
