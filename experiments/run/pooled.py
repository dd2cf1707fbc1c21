"""A search by pools of streets: each is rendered once, and its rewards are those of subsets of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key

import sdr_jax
from experiments.config import Candidate, Fidelity, GroupsConfig, RewardKind
from experiments.evaluation.cost import cost_of, head_cost, street_cost
from experiments.evaluation.job import Job, Result, StreetPool, Subset
from experiments.evaluation.runner import refuse_failed
from experiments.run.context import Run, Work
from experiments.run.few import beside
from experiments.run.search import (
    Found,
    SearchPlan,
    Stopwatch,
    embed,
    logged,
    refuse_another,
    standing,
)
from experiments.run.search import search as one_by_one
from scene.attributes import names
from scene.proposal import BELOW_ONE, Histogram, Streets, components, mixture, random_proposal
from sdr_jax.method import on_clipping
from sdr_jax.pool import Policy, divergence
from sdr_jax.registry import MethodName
from shell.files import digest


def reward_of(config: GroupsConfig) -> Fidelity:
    """The fidelity of one reward: a net on a subset of a pool."""
    return replace(config.reward, streets=config.search.pool.subset, shots=1)


def work_of(config: GroupsConfig, plans: Sequence[SearchPlan]) -> list[Work]:
    """What searches make, by kind."""
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
    """How many rewards of a method cost so many minutes of one core, about, in whole updates; 0 for none."""
    datasets, cost = config.search.datasets_per_update, 0.0
    if method == "pool":
        pool, fidelity = config.search.pool, reward_of(config)
        datasets, cost = pool.rewards, pool.streets * street_cost(fidelity)
        cost += datasets * head_cost(fidelity)
    return int(60 * core_minutes / (cost or datasets * cost_of(config.reward))) * datasets


def find(run: Run[Any], plan: SearchPlan, kind: RewardKind = "miou") -> Found:
    """Run a search of any method, or what is left of it; see `search` here and in ``run.search``."""
    return one_by_one(run, plan, kind) if plan.search.subsets is None else search(run, plan)


def search(run: Run[Any], plan: SearchPlan) -> Found:
    """Run all rounds, or what is left of them.

    The state is learnt again from the rewards that the run folder knows. A pool is only made where a reward
    of its round is missing, and removed when none is any more.

    Args:
        run: its reward's fidelity is the search's.
        plan: the search; its method's actions are streets.

    Raises:
        UserError: more than a tenth of the rewards failed, or a log of another run.
    """
    method, pool, watch = plan.search, plan.options.pool, Stopwatch()
    assert method.subsets is not None and method.policy is not None
    root, steps = jax.random.split(jax.random.key(plan.seed))
    evaluate = _Rewards(run, plan)
    with watch:
        state = method.init(root)
        policies, shares, rewards = [method.policy(state)], [], []
    clipped = False
    for update in range(plan.updates):
        with watch:
            keys = jax.random.split(jax.random.fold_in(steps, update), 4)
            actions, proposals = method.sample(keys[0], state, pool.streets)
            chosen = method.subsets(keys[1], state, actions, plan.datasets, pool.subset)
            whole = embed(plan.space, plan.subset, jax.device_get(proposals))
            units = drawn(keys[2], sdr_jax.Proposal(*map(jnp.asarray, whole)))
            seeds = np.asarray(jax.random.bits(keys[3], (plan.datasets + 1,), jnp.uint32)).tolist()
        rewards.append(evaluate(update, np.asarray(units), np.asarray(chosen), seeds))
        with watch:
            state, info = method.update(state, actions, jnp.asarray(rewards[-1]), chosen)
            policies.append(method.policy(state))
            shares.append(np.asarray(method.probabilities(state)))
        if int(info.clipped) and not clipped:
            clipped = True
            run.progress.say(
                f"{plan.name}: {on_clipping(int(info.clipped), len(evaluate.results))}"
            )
        run.progress.standing = standing("miou", rewards)
        run.progress.update(_said(plan, update, rewards[-1], policies))
    streets = [streets_of(policy, plan) for policy in policies]
    solution = embed(plan.space, plan.subset, jax.device_get(method.solution(state)))
    answers: dict[Candidate, Streets] = {
        "last": streets[-1],
        "previous": streets[-2],
        "mixed": _half(streets[-1], streets[0]),
    }
    nothing = np.full(plan.updates, np.nan, np.float32)
    return Found(
        solution,
        solution,
        solution,
        results=evaluate.results,
        rewards=np.stack(rewards),
        baselines=nothing,
        groups=np.zeros(plan.updates, np.int32),
        probabilities=np.stack(shares),
        cpu_seconds=watch.cpu,
        wall_seconds=watch.wall,
        answers=answers,
    )


def drawn(
    rng_key: Key[Array, ""], proposals: sdr_jax.Proposal
) -> Float[Array, "streets attributes"]:
    """Draw the attributes of one street in [0, 1) from each proposal, uniform on its intervals.

    Args:
        rng_key: consumed.
        proposals: f32[streets, attributes] each.
    """
    low = proposals.centre - proposals.width / 2
    uniform = jax.random.uniform(rng_key, low.shape)
    return jnp.clip(low + proposals.width * uniform, 0.0, BELOW_ONE)  # rounding could reach 1


class _Rewards:
    """Evaluates the subsets of each round; its streets are made where a reward is missing."""

    def __init__(self, run: Run[Any], plan: SearchPlan) -> None:
        self._run, self._plan, self._fidelity = run, plan, reward_of(run.config)
        self._recipe = run.recipe(self._fidelity)
        self._logged = logged(run)
        self.results: list[Result] = []

    def __call__(
        self, update: int, units: np.ndarray, chosen: np.ndarray, seeds: list[int]
    ) -> np.ndarray:
        """Rewards f32[n]; NaN where training failed.

        Args:
            update: number of the round.
            units: f32[streets, attributes] of the pool's streets, in [0, 1].
            chosen: i32[n, size], which of them each reward's net is trained on.
            seeds: of the n nets, and of the streets.
        """
        run, *nets, seed = self._run, *seeds
        pool = StreetPool(digest([digest(units.tolist()), seed]))
        jobs = self._jobs(pool, update, chosen, nets, 0.0)
        for job in jobs:
            refuse_another(run, self._logged, job)
        alone = jobs[0]._replace(source=Subset(pool, ()))  # the streets are the same beside others
        folder = digest([run.runner.about(alone)["config"], pool.name])
        cost, made = street_cost(self._fidelity), 0

        def done(streets: int) -> None:
            nonlocal made
            made += streets
            run.progress.advance(streets * cost)
            run.progress.update(
                f"{self._plan.name}: round {update + 1}, street {made}/{len(units)}"
            )

        if not all(run.runner.known(jobs, run.evaluations)):
            held, seconds = run.runner.cache.streets(folder, self._recipe, units, seed, done)
            pool = pool._replace(held=held)
            jobs = self._jobs(pool, update, chosen, nets, seconds / len(jobs))
        if not made:  # they were there, or nobody wants them
            run.progress.advance(len(units) * cost, replayed=True)
        results = run.runner.run(jobs, run.evaluations)
        run.runner.cache.forget(folder)
        self.results += results
        refuse_failed(self.results, self._plan.evaluations)
        return np.array([result.reward for result in results], np.float32)

    def _jobs(
        self, pool: StreetPool, update: int, chosen: np.ndarray, seeds: list[int], rendered: float
    ) -> list[Job]:
        """Rendering took so many seconds for each."""
        found = []
        for k, (picked, seed) in enumerate(zip(chosen.tolist(), seeds, strict=True)):
            source = beside(self._run, self._fidelity, Subset(pool, tuple(picked)))
            notes = {"search": self._plan.name, "update": update, "dataset": k}
            found.append(Job(self._recipe, source, seed, notes, "reward", rendered=rendered))
        return found


def streets_of(policy: Policy, plan: SearchPlan) -> Streets:
    """The streets of a policy; attributes that the search does not decide are random."""
    shares, probabilities = (np.asarray(part, np.float64) for part in policy)
    whole = len(random_proposal(plan.space).centre)
    count = probabilities.shape[2]
    found = []
    for own in probabilities:
        rows = np.full((whole, count), 1 / count)
        rows[[names(plan.space).index(name) for name in plan.subset]] = own
        found.append(Histogram(rows.astype(np.float32)))
    return mixture((shares / shares.sum()).tolist(), found)


def _half(one: Streets, other: Streets) -> Streets:
    """Half of the streets of each."""
    parts = [*components(one), *components(other)]
    return mixture([share / 2 for share, _ in parts], [own for _, own in parts])


def _said(plan: SearchPlan, update: int, rewards: np.ndarray, policies: list[Policy]) -> str:
    """What progress says about a round."""
    line = f"{plan.name}: round {update + 1}/{plan.updates}"
    if np.isnan(rewards).all():
        return f"{line} | all failed"
    line += f" | mIoU {100 * np.nanmean(rewards):.1f}, best {100 * np.nanmax(rewards):.1f}"
    moved = max(float(divergence(policies[-1], policies[-2])), 0.0)  # it rounds
    shares = " and ".join(f"{100 * share:.0f}" for share in policies[-1].shares.tolist())
    return f"{line}, moved {moved:.2f} nats" + (f", shares {shares} %" if " " in shares else "")
