"""Many evaluations at one stage: from the store where it has them, else from worker processes."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from experiments.config import Config, Stage
from experiments.errors import UserError
from experiments.keys import digest, engine, evaluation_key, folder_digest
from experiments.mmd_reward import Reference
from experiments.outcome import Outcome, attempt
from experiments.reward import Truth
from experiments.store import DIGITS, Store
from experiments.targets import Target
from scene.workers import WorkerPool
from sdr_jax import Proposal

Side = Literal["reward", "test"]


class Job(NamedTuple):
    """One dataset to be scored."""

    proposal: Proposal  # f32[attributes] each; kept for readers, the units decide
    units: np.ndarray  # f32[streets, attributes], drawn from it
    seed: int


class Evaluator:
    """Scores datasets at one stage on one side of a target.

    Args:
        config: the run: its renderer and assets.
        stage: sizes, net and training.
        target: what to be good on.
        side: which of its images score.
        truth: those images, at the stage's size; for ``--reward-kind mmd`` their features.
        workers: who renders and trains.
        store: what is known already, and where new outcomes go; None keeps nothing.
    """

    def __init__(
        self,
        config: Config,
        stage: Stage,
        target: Target,
        side: Side,
        truth: Truth | Reference,
        workers: WorkerPool,
        store: Store | None = None,
    ) -> None:
        if side == "reward" and config.reward_kind == "mmd" and isinstance(truth, Truth):
            raise UserError("--reward-kind mmd: this command knows miou only")
        self._common = (stage, target.table, config.renderer, config.pool)
        self._truth, self._workers, self._store = truth, workers, store
        self._about: dict[str, Any] = {}
        if store is not None:
            self._about = about(config, stage, target, side, truth)

    def map(
        self, evaluate: Callable[..., Any], jobs: Sequence[Job]
    ) -> Iterator[tuple[int, Outcome]]:
        """Yield (index, outcome) of every job, known ones first, the others as they come in.

        Args:
            evaluate: ``reward.evaluate``, ``mmd_reward.evaluate_mmd``, or what stands for them.
            jobs: the datasets.
        """
        keys = self._keys(jobs)
        missing = []
        for index in range(len(jobs)):
            known = self._store.get(keys[index]) if self._store is not None else None
            if known is None:
                missing.append(index)
            else:
                yield index, _outcome(known)
        # Two jobs of one call may be the same.
        first = {keys[index]: index for index in reversed(missing)} if keys else {}
        work = [index for index in missing if not keys or first[keys[index]] == index]
        tasks = [
            (evaluate, *self._common, jobs[index].units, int(jobs[index].seed), self._truth)
            for index in work
        ]
        for k, outcome in self._workers.map(attempt, tasks):
            index = work[k]
            if self._store is not None and (outcome.failed or math.isfinite(outcome.reward)):
                record = self._store.add(self._record(keys[index], jobs[index], outcome))
                # What is kept decides, lest a continued run see another value.
                outcome = _outcome(record)._replace(stored=False)
            yield index, outcome
            for twin in missing:
                if keys and twin != index and keys[twin] == keys[index]:
                    yield twin, outcome._replace(stored=True)

    def _keys(self, jobs: Sequence[Job]) -> list[str]:
        if self._store is None:
            return []
        self._store.refresh()
        config = self._about["config"]
        return [evaluation_key(config, job.units, job.seed) for job in jobs]

    def _record(self, key: str, job: Job, outcome: Outcome) -> dict[str, Any]:
        return {
            "key": key,
            **self._about,
            "centre": _rounded(job.proposal.centre),
            "width": _rounded(job.proposal.width),
            "seed": int(job.seed),
            "reward": None if outcome.failed else float(outcome.reward),
            "class_iou": outcome.class_iou,
            "render_seconds": round(outcome.render_seconds, 3),
            "train_seconds": round(outcome.train_seconds, 3),
            "failed": outcome.failed,
        }


def about(
    config: Config, stage: Stage, target: Target, side: Side, truth: Truth | Reference
) -> dict[str, Any]:
    """What all evaluations at a stage share: a hash of what decides the reward, words for people."""
    names = target.reward_names if side == "reward" else target.test_names
    decides: dict[str, Any] = {}
    if isinstance(truth, Reference):
        decides["reward"] = "mmd"
        source = truth.source
    else:
        pixels = hashlib.sha256()
        for array in truth:
            pixels.update(np.ascontiguousarray(array).tobytes())
        source = pixels.hexdigest()
    pool = config.pool._asdict()
    if pool["own"]:  # the files count, not where they lie
        pool["own"] = folder_digest(Path(pool["own"]))
    decides |= {
        "stage": asdict(stage),
        "table": target.table,
        "renderer": config.renderer,
        "pool": pool,
        # Names alone do not tell one twin from another.
        "truth": [target.name, side, digest(list(names)), source],
        "engine": engine(),
    }
    return {
        "config": digest(decides)[:16],
        "target": target.name,
        "side": side,
        "size": f"{stage.width}x{stage.height}",
        "images": stage.images,
        "steps": stage.train.steps,
        "net": stage.train.net,
        "engine": decides["engine"],
    }


def _rounded(values: Any) -> list[float]:
    return [round(float(v), DIGITS) for v in np.asarray(values)]


def _outcome(record: dict[str, Any]) -> Outcome:
    reward = math.nan if record["reward"] is None else record["reward"]
    return Outcome(
        reward,
        record["class_iou"],
        record["render_seconds"],
        record["train_seconds"],
        record["failed"],
        stored=True,
    )
