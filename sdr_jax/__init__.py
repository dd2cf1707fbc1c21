"""Learning to simulate complex scenes: the optimiser, without scenes or images."""

from sdr_jax.baseline import Baseline, ema, leave_one_out
from sdr_jax.callback import HostReward, host_reward
from sdr_jax.method import Info, Method
from sdr_jax.policy import Policy
from sdr_jax.random_search import random_search
from sdr_jax.reinforce import reinforce_loss
from sdr_jax.rewards import identity, squared_percent
from sdr_jax.run import Record, RewardFn, make_step, run
from sdr_jax.sdr import sdr
from sdr_jax.space import Proposal, Space, draw, relax, space

__all__ = [
    "Baseline",
    "HostReward",
    "Info",
    "Method",
    "Policy",
    "Proposal",
    "Record",
    "RewardFn",
    "Space",
    "draw",
    "ema",
    "host_reward",
    "identity",
    "leave_one_out",
    "make_step",
    "random_search",
    "reinforce_loss",
    "relax",
    "run",
    "sdr",
    "space",
    "squared_percent",
]
