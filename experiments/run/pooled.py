"""Pools of streets, each of which gets its credit for the mIoU of a net on all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import sdr_jax
from experiments.config import Candidate, Fidelity, GroupsConfig
from experiments.evaluation.cost import cost_of, credit_cost
from experiments.evaluation.job import Job, Result, StreetPool
from experiments.run.context import Run, Work
from experiments.run.few import beside
from experiments.run.rewards import Rewards, SearchPlan, embed
from scene.attributes import names
from scene.held import hold
from scene.proposal import (
    BELOW_ONE,
    Histogram,
    Proposal,
    Streets,
    components,
    mixture,
    random_proposal,
)
from sdr_jax.names import MethodName
from sdr_jax.pool import Policy
from seg.linear import RIDGE
from shell.files import digest


def reward_of(config: GroupsConfig) -> Fidelity:
    """The fidelity of a round: one shot and one view of each street, and a net without training steps."""
    train = replace(config.reward.train, steps=0, views=1)
    return replace(config.reward, streets=config.search.pool.streets, shots=1, train=train)


def work_of(config: GroupsConfig, plans: Sequence[SearchPlan]) -> list[Work]:
    """Plan the work of searches by kind."""
    found: list[Work] = []
    count = sum(plan.evaluations for plan in plans if plan.search.policy is None)
    if count:
        found.append(Work.at("rewards of the search", count, config.reward))
    rounds = sum(plan.updates for plan in plans if plan.search.policy is not None)
    if rounds:
        fidelity = reward_of(config)
        streets = rounds * fidelity.streets
        found.append(
            Work(
                "streets of its pools, with their credits", streets, fidelity, credit_cost(fidelity)
            )
        )
    return found


def affordable(config: GroupsConfig, method: MethodName, core_minutes: float) -> int:
    """The number of rewards, in whole updates, that take about so many core minutes; 0 for none."""
    datasets, cost = config.search.datasets_per_update, cost_of(config.reward)
    if method == "pool":
        fidelity = reward_of(config)
        datasets, cost = 1, fidelity.streets * credit_cost(fidelity)
    return int(60 * core_minutes / (datasets * cost)) * datasets


def drawn(rng: np.random.Generator, proposals: Proposal) -> np.ndarray:
    """Draw the attributes of one street from each proposal, uniform on its intervals, f32[n, attributes].

    Args:
        rng: consumed.
        proposals: f32[streets, attributes] each.
    """
    centre, width = (np.asarray(part, np.float32) for part in proposals)
    uniform = rng.random(centre.shape, np.float32)
    return np.clip(centre + width * (uniform - np.float32(0.5)), 0.0, BELOW_ONE)


class PoolRewards(Rewards):
    """Evaluates a pool of streets for each update: the rewards of its actions are the streets' credits."""

    def __init__(self, run: Run[Any], plan: SearchPlan) -> None:
        super().__init__(run, plan)
        fidelity = reward_of(run.config)
        source = beside(run, fidelity, StreetPool(""))
        self._job = Job(run.recipe(fidelity), source, 0, {}, "reward")
        run.runner.about(self._job)  # here, since it needs JAX

    def _evaluated(self, asked: sdr_jax.DataSets) -> tuple[list[Result], np.ndarray]:
        run, fidelity = self._run, self._job.recipe.fidelity
        rng = np.random.default_rng(asked.seeds.tolist())
        units = drawn(rng, embed(self._plan, asked.proposals))
        seed = int(rng.integers(2**32))  # of the streets
        pool = StreetPool(digest([digest(units.tolist()), seed, RIDGE]))
        job = self._job._replace(source=beside(run, fidelity, pool), notes=self._notes(0))
        self._refuse_another([job])
        cost, made = credit_cost(fidelity), 0

        def done(streets: int) -> None:
            nonlocal made
            made += streets
            run.progress.advance(streets * cost)
            where = f"{self._plan.name}: round {self.update + 1}"
            run.progress.update(f"{where}, street {made}/{len(units)}", minor=True)

        result = run.runner.credit(job, units, seed, done, run.evaluations)
        if not made:  # they existed, or are not needed
            run.progress.advance(len(units) * cost, replayed=True)
        return [result], np.array(result.credits, np.float32)


def answers(policies: Sequence[Policy], plan: SearchPlan) -> dict[Candidate, Streets]:
    """The candidates' streets, from the policies before and after every round."""
    first, previous, last = (streets_of(policies[k], plan) for k in (0, -2, -1))
    return {"last": last, "previous": previous, "mixed": _half(last, first)}


def streets_of(policy: Policy, plan: SearchPlan) -> Streets:
    """The streets of a policy; attributes outside the search are random, or held."""
    shares, probabilities = (np.asarray(part, np.float64) for part in policy)
    whole = len(random_proposal(plan.space).centre)
    count = probabilities.shape[2]
    found = []
    for own in probabilities:
        rows = np.full((whole, count), 1 / count)
        rows[[names(plan.space).index(name) for name in plan.subset]] = own
        found.append(Histogram(rows.astype(np.float32)))
    return hold(mixture((shares / shares.sum()).tolist(), found), plan.held)


def _half(one: Streets, other: Streets) -> Streets:
    """A mixture of both in equal parts."""
    parts = [*components(one), *components(other)]
    return mixture([share / 2 for share, _ in parts], [own for _, own in parts])
