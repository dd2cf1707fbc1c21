"""Rewards of subsets of pools of streets, in which each street is rendered once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import sdr_jax
from experiments.config import Candidate, Fidelity, GroupsConfig
from experiments.evaluation.cost import cost_of, head_cost, street_cost
from experiments.evaluation.job import Job, Result, StreetPool, Subset
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
from shell.files import digest


def reward_of(config: GroupsConfig) -> Fidelity:
    """The fidelity of one reward, a net on a subset of a pool."""
    return replace(config.reward, streets=config.search.pool.subset, shots=1)


def work_of(config: GroupsConfig, plans: Sequence[SearchPlan]) -> list[Work]:
    """Plan the work of searches by kind."""
    found: list[Work] = []
    count = sum(plan.evaluations for plan in plans if plan.search.subsets is None)
    if count:
        found.append(Work.at("rewards of the search", count, config.reward))
    rounds = sum(plan.updates for plan in plans if plan.search.subsets is not None)
    if rounds:
        fidelity, pool = reward_of(config), config.search.pool
        street, head = street_cost(fidelity), head_cost(fidelity)
        found += [
            Work("streets of its pools", rounds * pool.streets, fidelity, street),
            Work("rewards from its pools", rounds * pool.rewards, fidelity, head),
        ]
    return found


def affordable(config: GroupsConfig, method: MethodName, core_minutes: float) -> int:
    """The number of rewards, in whole updates, that take about so many core minutes; 0 for none."""
    datasets, cost = config.search.datasets_per_update, 0.0
    if method == "pool":
        pool, fidelity = config.search.pool, reward_of(config)
        datasets, cost = pool.rewards, pool.streets * street_cost(fidelity)
        cost += datasets * head_cost(fidelity)
    return int(60 * core_minutes / (cost or datasets * cost_of(config.reward))) * datasets


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
    """Evaluates a subset of a pool of streets for each reward.

    A pool is made only if a reward of its round is missing, and is removed once all are known.
    """

    def __init__(self, run: Run[Any], plan: SearchPlan) -> None:
        super().__init__(run, plan)
        self._fidelity = reward_of(run.config)
        self._recipe = run.recipe(self._fidelity)
        empty = Subset(StreetPool(""), ())
        self._alone = Job(
            self._recipe, empty, 0, {}, "reward"
        )  # the same streets, also beside labelled images
        run.runner.about(self._alone)  # here, since it needs JAX

    def _evaluated(self, asked: sdr_jax.DataSets) -> list[Result]:
        run, seeds = self._run, asked.seeds.tolist()
        rng = np.random.default_rng(seeds)
        units = drawn(rng, embed(self._plan, asked.proposals))
        seed = int(rng.integers(2**32))  # of the streets
        pool = StreetPool(digest([digest(units.tolist()), seed]))
        jobs = self._jobs(pool, asked.subsets, seeds, 0.0)
        self._refuse_another(jobs)
        folder = digest([run.runner.about(self._alone)["config"], pool.name])
        cost, made = street_cost(self._fidelity), 0

        def done(streets: int) -> None:
            nonlocal made
            made += streets
            run.progress.advance(streets * cost)
            where = f"{self._plan.name}: round {self.update + 1}"
            run.progress.update(f"{where}, street {made}/{len(units)}")

        if not all(run.runner.known(jobs, run.evaluations)):
            held, seconds = run.runner.cache.streets(folder, self._recipe, units, seed, done)
            pool = pool._replace(held=held)
            jobs = self._jobs(pool, asked.subsets, seeds, seconds / len(jobs))
        if not made:  # they existed, or are not needed
            run.progress.advance(len(units) * cost, replayed=True)
        results = run.runner.run(jobs, run.evaluations)
        run.runner.cache.forget(folder)
        return results

    def _jobs(
        self, pool: StreetPool, chosen: np.ndarray, seeds: list[int], rendered: float
    ) -> list[Job]:
        """Jobs of the subsets, each with so many seconds of rendering."""
        sources = [
            beside(self._run, self._fidelity, Subset(pool, tuple(own))) for own in chosen.tolist()
        ]
        return [
            Job(self._recipe, source, seed, self._notes(k), "reward", rendered=rendered)
            for k, (source, seed) in enumerate(zip(sources, seeds, strict=True))
        ]


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
