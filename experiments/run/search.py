"""The search: one jitted step per update, with rewards from worker processes through one callback."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import jax
import numpy as np

import sdr_jax
from experiments.config import Candidate, RewardKind
from experiments.evaluation.job import REWARD_NAMES, Result, in_words
from experiments.run.context import Run
from experiments.run.pooled import PoolRewards, answers
from experiments.run.rewards import DatasetRewards, SearchPlan, Stopwatch, embed
from scene.proposal import Proposal, Streets
from sdr_jax.method import on_clipping
from sdr_jax.pool import Policy, divergence


class Found(NamedTuple):
    """The answer of a search, and its course."""

    solution: Proposal  # the method's answer, f32[attributes of the space] each
    spread: Proposal  # the answer with wide intervals where the method is unsure
    best: Proposal  # the dataset with the best reward
    results: list[Result]  # in the order of the requests
    rewards: np.ndarray  # f32[updates, datasets]; NaN for failed ones
    baselines: np.ndarray  # f32[updates]
    groups: np.ndarray  # i32[updates]
    probabilities: np.ndarray  # f32[updates, attributes of the subset, bins], after each update
    cpu_seconds: float  # of the method itself, with compilation
    wall_seconds: float
    expected: np.ndarray | None = None
    """f32[updates, datasets, 2]: the model's prior mean and standard deviation of each reward, NaN before the
    first rewards; None without a model."""
    answers: Mapping[Candidate, Streets] = MappingProxyType({})
    """Candidates of a search that learns a distribution of streets."""

    @property
    def answer(self) -> Streets:
        """The method's own answer: its last distribution of streets if it learns one, else its solution."""
        return self.answers.get("last", self.solution)


def search(run: Run[Any], plan: SearchPlan, kind: RewardKind = "miou") -> Found:
    """Run a whole search, or the rest of it.

    The loop replays the rewards of the run folder: the same keys give the same actions, and a logged reward
    takes no time. So a killed and continued run ends with the same answer. A failed evaluation is left out of
    its update.

    Args:
        run: its reward's fidelity is the search's.
        plan: the plan of the search.
        kind: kind of the rewards.

    Raises:
        UserError: more than a tenth of the evaluations failed, or the log is from another run.
    """
    method, watch = plan.search, Stopwatch()
    of_pool = method.policy is not None
    rewards = PoolRewards(run, plan) if of_pool else DatasetRewards(run, plan, kind)
    reward_fn = sdr_jax.host_reward(rewards, common=plan.options.common_random_numbers)
    n = plan.options.pool.streets if of_pool else plan.datasets
    key = jax.random.key(plan.seed)
    steps = sdr_jax.drive(key, method, reward_fn, plan.updates, n)
    history: list[tuple] = []
    foreseen: list[np.ndarray] = []
    policies = [] if method.policy is None else [method.policy(sdr_jax.first_state(key, method))]
    state: Any = None  # there are no expectations before the first update
    clipped = False
    for update in range(plan.updates):
        with watch:
            before = state
            state, record = next(steps)
            foreseen += _foreseen(method, before, record)
            info = jax.device_get(record.info)
            probabilities = np.asarray(method.probabilities(state))
            if method.policy is not None:
                policies.append(method.policy(state))
        own = np.array([result.reward for result in rewards.results[-plan.datasets :]], np.float32)
        history.append((own, float(info.baseline), int(info.group), probabilities))
        if info.clipped and not clipped and not of_pool:
            clipped = True
            told = sum(len(rewards) for rewards, *_ in history)
            run.progress.say(f"{plan.name}: {on_clipping(int(info.clipped), told)}")
        run.progress.standing = standing(kind, [rewards for rewards, *_ in history])
        run.progress.update(_said(plan, kind, update, history, policies))
    with watch:
        solution = embed(plan, jax.device_get(method.solution(state)))
        spread = embed(plan, jax.device_get(method.spread(state)))
    by_update, baselines, groups, distributions = zip(*history, strict=True)
    best = solution
    if isinstance(rewards, DatasetRewards):
        best = _best(rewards.asked, np.stack(by_update).ravel())
    return Found(
        solution,
        spread,
        best,
        results=rewards.results,
        rewards=np.stack(by_update),
        baselines=np.array(baselines, np.float32),
        groups=np.array(groups, np.int32),
        probabilities=np.stack(distributions),
        cpu_seconds=max(watch.cpu - rewards.watch.cpu, 0.0),
        wall_seconds=max(watch.wall - rewards.watch.wall, 0.0),
        expected=np.stack(foreseen) if foreseen else None,
        answers=answers(policies, plan) if policies else {},
    )


def _foreseen(method: sdr_jax.Method, before: Any, record: sdr_jax.Record) -> list[np.ndarray]:
    """The model's expectations of an update's rewards, f32[datasets, 2]; empty without a model."""
    if method.expects is None:
        return []
    if before is None:
        return [np.full((len(record.rewards), 2), np.nan, np.float32)]
    return [np.stack(method.expects(before, record.actions), axis=-1)]


def _best(asked: Sequence[Proposal], rewards: np.ndarray) -> Proposal:
    """The proposal with the best reward; the first if all failed."""
    return asked[int(np.argmax(np.where(np.isfinite(rewards), rewards, -np.inf)))]


def standing(kind: RewardKind, rewards: Sequence[np.ndarray]) -> str:
    """The best reward of all updates in words."""
    known = [float(np.nanmax(own)) for own in rewards if not np.isnan(own).all()]
    return f"best {REWARD_NAMES[kind]} {in_words(kind, max(known))}" if known else ""


def _said(
    plan: SearchPlan,
    kind: RewardKind,
    update: int,
    history: Sequence[tuple],
    policies: Sequence[Policy],
) -> str:
    """The progress line of an update."""
    latest, baseline, group, _ = history[-1]
    where = f"{plan.name}: {'round' if policies else 'update'} {update + 1}/{plan.updates}"
    if plan.method == "sdr":
        where += f", group {group + 1}"
    if np.isnan(latest).all():
        return f"{where} | all failed"
    best = max(float(np.nanmax(r)) for r, *_ in history if not np.isnan(r).all())
    line = f"{REWARD_NAMES[kind]} {in_words(kind, float(np.nanmean(latest)))}, best {in_words(kind, best)}"
    if np.isfinite(baseline):
        scale = 100 if plan.options.squared_reward else 1
        line += f", baseline {in_words(kind, baseline / scale)}"
    if policies:
        line += f", moved {max(float(divergence(policies[-1], policies[-2])), 0.0):.2f} nats"
        shares = [f"{100 * share:.0f}" for share in policies[-1].shares.tolist()]
        line += f", shares {' and '.join(shares)} %" if len(shares) > 1 else ""
    return f"{where} | {line}"
