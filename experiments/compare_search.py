"""The searches of a comparison, each a plain loop on the host, and the final nets of what they found."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import sdr_jax
from experiments.compare_config import CompareConfig, Plan
from experiments.config import Stage
from experiments.evaluator import Evaluator, Job
from experiments.finals import random_proposal
from experiments.ladder import cost_of
from experiments.outcome import Outcome
from experiments.progress import Progress
from experiments.reward import evaluate
from experiments.study_nets import score_proposals, verdict
from scene.attributes import NAMES

Name = tuple[str, tuple[str, ...]]
"""Method and subset."""


class Found(NamedTuple):
    """What a search found, and how it went."""

    solution: sdr_jax.Proposal  # f32[23]; attributes outside the subset are random
    outcomes: list[Outcome]  # in the order in which they were asked for
    cpu_seconds: float  # of the method itself
    wall_seconds: float


def embed(subset: Sequence[str], proposals: sdr_jax.Proposal) -> sdr_jax.Proposal:
    """Proposals f32[*batch, attributes of the subset] as f32[*batch, 23], the others random."""
    where = [NAMES.index(name) for name in subset]
    whole: list[Any] = []
    for values, random in zip(proposals, random_proposal(), strict=True):
        array = np.broadcast_to(random, (*values.shape[:-1], len(NAMES))).copy()
        array[..., where] = np.asarray(values)
        whole.append(array)
    return sdr_jax.Proposal(*whole)


def learnable(rewards: Sequence[float]) -> np.ndarray | None:
    """Rewards f32[n] that a method can learn from: a failed one becomes the lowest of its update.

    None if all have failed, for then there is nothing to learn.
    """
    values = np.asarray(rewards, np.float32)
    failed = np.isnan(values)
    return None if failed.all() else np.where(failed, values[~failed].min(), values)


class _Stopwatch:
    """CPU and wall seconds of this process while it runs."""

    def __init__(self) -> None:
        self.cpu = self.wall = 0.0

    def __enter__(self) -> None:
        self._started = time.process_time(), time.perf_counter()

    def __exit__(self, *_: object) -> None:
        self.cpu += time.process_time() - self._started[0]
        self.wall += time.perf_counter() - self._started[1]


class Comparison:
    """One comparison under way; evaluators with a store make that it can be killed.

    A comparison that is started again runs its searches anew: the same keys give the same proposals,
    and what the store holds takes no time. So a killed one ends with the figures of an unbroken one.

    Args:
        config: what is compared.
        progress: told about every evaluation.
    """

    def __init__(self, config: CompareConfig, progress: Progress) -> None:
        self._config, self._progress = config, progress

    def search(self, plan: Plan, evaluator: Evaluator) -> Found:
        """Run one method on one subset; keys are used as `sdr_jax.run` uses them."""
        config, method, watch = self._config, plan.search, _Stopwatch()
        with watch:
            init_key, steps_key = jax.random.split(jax.random.key(config.seed))
            state = method.init(init_key)
        every: list[Outcome] = []
        best = -np.inf
        for update in range(plan.updates):
            with watch:
                sample_key, reward_key = jax.random.split(jax.random.fold_in(steps_key, update))
                actions, sampled = method.sample(sample_key, state, plan.datasets)
                proposals = embed(plan.subset, jax.device_get(sampled))
            outcomes = self._rewards(evaluator, reward_key, proposals)
            every += outcomes
            rewards = learnable([outcome.reward for outcome in outcomes])
            said = "all failed"
            if rewards is not None:
                with watch:
                    state, _ = method.update(state, actions, jnp.asarray(rewards))
                    jax.block_until_ready(state)
                best = max(best, float(rewards.max()))
                said = f"mIoU {100 * float(rewards.mean()):.1f}, best {100 * best:.1f}"
            self._progress.update(
                f"{len(plan.subset)} attributes, {plan.method}: update {update + 1}/{plan.updates}"
                f" | {said}"
            )
        with watch:
            solution = embed(plan.subset, jax.device_get(method.solution(state)))
        return Found(solution, every, watch.cpu, watch.wall)

    def _rewards(
        self, evaluator: Evaluator, rng_key: jax.Array, proposals: sdr_jax.Proposal
    ) -> list[Outcome]:
        unit_key, seed_key = jax.random.split(rng_key)
        stage = self._config.reward
        units = np.asarray(sdr_jax.draw(unit_key, proposals, stage.streets))
        seeds = np.asarray(jax.random.bits(seed_key, (len(units),), jnp.uint32)).tolist()
        jobs = [
            Job(sdr_jax.Proposal(*pair), units[k], seeds[k])
            for k, pair in enumerate(zip(*proposals, strict=True))
        ]
        outcomes: dict[int, Outcome] = {}
        for index, outcome in evaluator.map(evaluate, jobs):
            outcomes[index] = outcome
            self._progress.advance(cost_of(stage), replayed=outcome.stored)
        return [outcomes[k] for k in range(len(jobs))]

    def score(
        self, stage: Stage, solutions: dict[Name, sdr_jax.Proposal], evaluator: Evaluator
    ) -> dict[Name, list[Outcome]]:
        """Score every solution at a stage, with the same seeds for all."""
        config = self._config
        seeds = [config.seed + k for k in range(config.seeds)]
        wanted = [(name, seed) for seed in seeds for name in solutions]

        def say(index: int, outcome: Outcome) -> str:
            (method, subset), seed = wanted[index]
            return (
                f"{stage.width}x{stage.height}, {stage.images} images: {len(subset)} attributes, "
                f"{method}, seed {seed} | {verdict(outcome)}"
            )

        jobs = [(solutions[name], seed) for name, seed in wanted]
        scored = score_proposals(evaluator, evaluate, jobs, stage, self._progress, say)
        outcomes = dict(zip(wanted, scored, strict=True))
        return {name: [outcomes[name, seed] for seed in seeds] for name in solutions}
