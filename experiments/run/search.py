"""The search: one jitted step per update, its rewards from worker processes through one callback."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import jax
import numpy as np

import sdr_jax
from experiments.config import Candidate, RewardKind, SearchOptions
from experiments.reward.evaluator import Job
from experiments.reward.miou import Outcome, Source
from experiments.run.context import REWARD_NAMES, Run, in_words, refuse_failed
from experiments.run.few import beside
from experiments.run.ladder import cost_of
from scene.attributes import SpaceName, names
from scene.proposal import Proposal, Streets, random_proposal
from sdr_jax.method import on_clipping
from sdr_jax.registry import MethodName
from shell.errors import UserError

PLACE = ("search", "update", "dataset")
"""What the log of a run says of a reward's place."""


class SearchPlan(NamedTuple):
    """One search."""

    name: str  # what the run's log calls it
    space: SpaceName
    method: MethodName
    search: sdr_jax.Method
    subset: tuple[str, ...]  # the attributes that it decides; all others stay random
    datasets: int  # per update
    updates: int
    options: SearchOptions
    seed: int  # of the search, and of the datasets that it asks for

    @property
    def evaluations(self) -> int:
        """Rewards that it asks for."""
        return self.datasets * self.updates


class Found(NamedTuple):
    """What a search found, and how it went."""

    solution: Proposal  # the method's answer, f32[attributes of the space] each
    spread: Proposal  # the same, wide where the method is unsure
    best: Proposal  # the dataset with the best reward
    outcomes: list[Outcome]  # in the order in which they were asked for
    rewards: np.ndarray  # f32[updates, datasets]; NaN where they failed
    baselines: np.ndarray  # f32[updates]
    groups: np.ndarray  # i32[updates]
    probabilities: np.ndarray  # f32[updates, attributes of the subset, bins], after each update
    cpu_seconds: float  # of the method itself, compiling included
    wall_seconds: float
    expected: np.ndarray | None = None
    """f32[updates, datasets, 2]: mean and standard deviation that the method's model gave each reward before
    it was made, NaN before it knew any; None without a model."""
    answers: Mapping[Candidate, Streets] = MappingProxyType({})
    """Of a search that learns a distribution of streets: those that may be the answer."""


def embed(space: SpaceName, subset: Sequence[str], proposals: Any) -> Proposal:
    """Proposals f32[*batch, attributes of the subset] as those of the whole space, the others random."""
    where = [names(space).index(name) for name in subset]
    whole = []
    for values, random in zip(proposals, random_proposal(space), strict=True):
        array = np.broadcast_to(random, (*values.shape[:-1], len(random))).copy()
        array[..., where] = np.asarray(values)
        whole.append(array)
    return Proposal(*whole)


class Stopwatch:
    """CPU and wall seconds of this process while it runs; what runs inside another is taken off it."""

    def __init__(self) -> None:
        self.cpu = self.wall = 0.0

    def __enter__(self) -> None:
        self._started = time.process_time(), time.perf_counter()

    def __exit__(self, *_: object) -> None:
        self.cpu += time.process_time() - self._started[0]
        self.wall += time.perf_counter() - self._started[1]


class _Rewards:
    """Scores the datasets of one update after the other; runs behind the callback, without JAX."""

    def __init__(self, run: Run[Any], plan: SearchPlan, kind: RewardKind) -> None:
        self._run, self._plan = run, plan
        self._evaluator = run.evaluator(run.recipe(run.config.reward), "reward", kind)
        self._logged = logged(run)
        self._update = 0
        self.watch = Stopwatch()
        self.outcomes: list[Outcome] = []
        self.asked: list[Proposal] = []

    def __call__(self, asked: sdr_jax.DataSets) -> np.ndarray:
        """Rewards f32[n]; NaN where the evaluation failed."""
        with self.watch:
            centres, widths = embed(self._plan.space, self._plan.subset, asked.proposals)
            actions, seeds = np.asarray(asked.actions).tolist(), asked.seeds.tolist()
            proposals = [Proposal(*each) for each in zip(centres, widths, strict=True)]
            cost = cost_of(self._run.config.reward)
            jobs = [
                Job(self._source(proposals[k]), seed, self._notes(k, actions[k]), cost)
                for k, seed in enumerate(seeds)
            ]
            for job in jobs:
                key = self._evaluator.key(job.source, job.seed)
                refuse_another(self._run, self._logged, job, key)
            run = self._run
            nets = [(self._evaluator, job) for job in jobs]
            outcomes = run.score(nets, log=run.evaluations)
            self.outcomes += outcomes
            self.asked += proposals
            self._update += 1
            refuse_failed(self.outcomes, self._plan.evaluations)
            return np.array([outcome.reward for outcome in outcomes], np.float32)

    def _source(self, proposal: Proposal) -> Source:
        return beside(self._run, self._run.config.reward, proposal)

    def _notes(self, dataset: int, actions: list[Any]) -> dict[str, Any]:
        place = {"search": self._plan.name, "update": self._update, "dataset": dataset}
        return {**place, "actions": actions}


def logged(run: Run[Any]) -> dict[tuple, str]:
    """The keys of the rewards that a run folder has, by search, update and number."""
    return {
        tuple(line.get(name) for name in PLACE): line["key"] for line in run.evaluations.records
    }


def refuse_another(run: Run[Any], known: Mapping[tuple, str], job: Job, key: str) -> None:
    """Raise UserError if the run folder has another reward in the place of a job."""
    place = tuple(job.notes[name] for name in PLACE)
    if known.get(place, key) != key:
        raise UserError(
            f"{run.evaluations.path}: update {place[1]}, dataset {place[2]} was not made by "
            "this run; use another --out"
        )


def search(run: Run[Any], plan: SearchPlan, kind: RewardKind = "miou") -> Found:
    """Run a whole search, or what is left of it.

    The loop replays what the run folder already knows: the same keys give the same actions, and a
    logged reward takes no time. So a killed run ends with the answer of an unbroken one. A failed
    evaluation is left out of its update.

    Args:
        run: its reward's fidelity is the search's.
        plan: what searches, and how long.
        kind: of the rewards.

    Raises:
        UserError: more than a tenth of the evaluations failed, or a log of another run.
    """
    rewards, watch = _Rewards(run, plan, kind), Stopwatch()
    reward_fn = sdr_jax.host_reward(rewards, common=plan.options.common_random_numbers)
    key = jax.random.key(plan.seed)
    steps = sdr_jax.drive(key, plan.search, reward_fn, plan.updates, plan.datasets)
    history: list[tuple] = []
    foreseen: list[np.ndarray] = []
    state: Any = None  # before the first update nothing is expected
    clipped = False
    for update in range(plan.updates):
        with watch:
            before = state
            state, record = next(steps)
            foreseen += _foreseen(plan.search, before, record)
            info = jax.device_get(record.info)
            probabilities = np.asarray(plan.search.probabilities(state))
        history.append(
            (np.asarray(record.rewards), float(info.baseline), int(info.group), probabilities)
        )
        if info.clipped and not clipped:
            clipped = True
            told = sum(len(rewards) for rewards, *_ in history)
            run.progress.say(f"{plan.name}: {on_clipping(int(info.clipped), told)}")
        run.progress.standing = standing(kind, [rewards for rewards, *_ in history])
        run.progress.update(_said(plan, kind, update, history))
    with watch:
        solution = embed(plan.space, plan.subset, jax.device_get(plan.search.solution(state)))
        spread = embed(plan.space, plan.subset, jax.device_get(plan.search.spread(state)))
    by_update, baselines, groups, distributions = zip(*history, strict=True)
    return Found(
        solution,
        spread,
        _best(rewards.asked, np.stack(by_update).ravel()),
        outcomes=rewards.outcomes,
        rewards=np.stack(by_update),
        baselines=np.array(baselines, np.float32),
        groups=np.array(groups, np.int32),
        probabilities=np.stack(distributions),
        cpu_seconds=max(watch.cpu - rewards.watch.cpu, 0.0),
        wall_seconds=max(watch.wall - rewards.watch.wall, 0.0),
        expected=np.stack(foreseen) if foreseen else None,
    )


def _foreseen(method: sdr_jax.Method, before: Any, record: sdr_jax.Record) -> list[np.ndarray]:
    """What the method's model expected of an update before it, f32[datasets, 2]; nothing without a model."""
    if method.expects is None:
        return []
    if before is None:
        return [np.full((len(record.rewards), 2), np.nan, np.float32)]
    return [np.stack(method.expects(before, record.actions), axis=-1)]


def _best(asked: Sequence[Proposal], rewards: np.ndarray) -> Proposal:
    """The proposal with the best reward; the first, if all failed."""
    return asked[int(np.argmax(np.where(np.isfinite(rewards), rewards, -np.inf)))]


def standing(kind: RewardKind, rewards: Sequence[np.ndarray]) -> str:
    """The best of all updates' rewards, in words."""
    known = [float(np.nanmax(own)) for own in rewards if not np.isnan(own).all()]
    return f"best {REWARD_NAMES[kind]} {in_words(kind, max(known))}" if known else ""


def _said(plan: SearchPlan, kind: RewardKind, update: int, history: Sequence[tuple]) -> str:
    """What progress says about an update."""
    latest, baseline, group, _ = history[-1]
    where = f"{plan.name}: update {update + 1}/{plan.updates}"
    if plan.method == "sdr":
        where += f", group {group + 1}"
    if np.isnan(latest).all():
        return f"{where} | all failed"
    best = max(float(np.nanmax(r)) for r, *_ in history if not np.isnan(r).all())
    line = f"{REWARD_NAMES[kind]} {in_words(kind, float(np.nanmean(latest)))}, best {in_words(kind, best)}"
    if np.isfinite(baseline):
        scale = 100 if plan.options.squared_reward else 1
        line += f", baseline {in_words(kind, baseline / scale)}"
    return f"{where} | {line}"
