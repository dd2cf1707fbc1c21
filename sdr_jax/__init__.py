"""Learning to simulate complex scenes: the optimiser, without scenes or images.

    attributes = space(["car", "tree", "sun"], groups=[["car", "tree"], ["sun"]])
    method = sdr(attributes)
    reward_fn = lambda rng_key, proposals: -((proposals.centre - 0.3) ** 2).sum(axis=1)
    state, record = jax.jit(lambda key: run(key, method, reward_fn, n=4))(jax.random.key(0))
    method.solution(state)  # centre and width of every attribute

A reward that must leave JAX, such as rendering images and training on them: `host_reward`.
Attributes whose values have no order: `space(["car", "weather"], bins=[10, 3], unordered=["weather"])`.
One that comes from elsewhere, at its own time: `AskTell`; from a program: `python -m sdr_jax.tune`.
"""

from shell.interrupt import while_loading

while_loading(__name__)  # before JAX

from sdr_jax.ask_tell import AskTell, Trial
from sdr_jax.baseline import Baseline, ema, leave_one_out
from sdr_jax.callback import DataSets, HostReward, host_reward
from sdr_jax.method import Info, Method
from sdr_jax.models.intervals import intervals
from sdr_jax.models.linear import linear
from sdr_jax.models.surrogate import surrogate
from sdr_jax.policy import Policy
from sdr_jax.pool import pool
from sdr_jax.registry import METHODS, MethodName
from sdr_jax.reinforce import reinforce_loss
from sdr_jax.relaxation import relax, slide
from sdr_jax.rewards import identity, squared_percent
from sdr_jax.rivals.attribute_descent import attribute_descent
from sdr_jax.rivals.cma_es import cma_es
from sdr_jax.rivals.gaussian import gaussian
from sdr_jax.rivals.gaussian_process import gaussian_process
from sdr_jax.rivals.pbil import pbil
from sdr_jax.rivals.random_attributes import random_attributes
from sdr_jax.rivals.random_search import random_search
from sdr_jax.rivals.tpe import tpe
from sdr_jax.run import (
    Record,
    RewardFn,
    drive,
    first_state,
    make_step,
    refuse_failures,
    run,
    run_on_host,
)
from sdr_jax.sdr import sdr
from sdr_jax.space import Proposal, Space, space

__all__ = [
    "METHODS",
    "AskTell",
    "Baseline",
    "DataSets",
    "HostReward",
    "Info",
    "Method",
    "MethodName",
    "Policy",
    "Proposal",
    "Record",
    "RewardFn",
    "Space",
    "Trial",
    "attribute_descent",
    "cma_es",
    "drive",
    "ema",
    "first_state",
    "gaussian",
    "gaussian_process",
    "host_reward",
    "identity",
    "intervals",
    "leave_one_out",
    "linear",
    "make_step",
    "pbil",
    "pool",
    "random_attributes",
    "random_search",
    "refuse_failures",
    "reinforce_loss",
    "relax",
    "run",
    "run_on_host",
    "sdr",
    "slide",
    "space",
    "squared_percent",
    "surrogate",
    "tpe",
]
