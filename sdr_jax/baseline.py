"""The baseline b of REINFORCE: a reward is compared with it, so that its noise moves the policy less.

Rewards of NaN are left out of every mean, and their advantages are NaN, too.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sdr_jax.rewards import mean_without_nan


class BaselineState(NamedTuple):
    """The memory of a baseline."""

    value: Float[Array, ""]  # the average b so far
    updates: Int[Array, ""]  # updates with enough rewards; every baseline must count them


def init_baseline() -> BaselineState:
    """The memory before the first update."""
    return BaselineState(jnp.zeros((), jnp.float32), jnp.zeros((), jnp.int32))


class Baseline(NamedTuple):
    """A pure function, and the number of rewards that it needs."""

    # (state, rewards f32[n]) -> (advantages f32[n], state)
    advantage: Callable[[BaselineState, Float[Array, "n"]], tuple[Float[Array, "n"], BaselineState]]
    min_rewards: int = 1  # rewards without NaN that an update needs


def ema(decay: float = 0.9, includes_current: bool = False) -> Baseline:
    """Exponential moving average of past rewards, `b <- decay b + (1 - decay) mean(rewards)`.

    The first update has no past: its baseline is the mean of its own rewards. With one data set
    per update this makes the first advantage zero.

    Args:
        decay: in [0, 1); the paper gives none, 0.9 is that of the authors' code.
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
        mean = mean_without_nan(rewards)
        is_first = state.updates == 0
        past = jnp.where(is_first, mean, state.value)
        present = jnp.where(is_first, mean, decay * past + (1 - decay) * mean)
        advantages = rewards - (present if includes_current else past)
        return advantages, BaselineState(present, state.updates + 1)

    return Baseline(advantage)
