"""Many evaluations of one kind: from what is remembered, else from worker processes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import asdict
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

from experiments.reward.made_with import FIELD
from experiments.reward.miou import (
    Outcome,
    Parts,
    Recipe,
    Source,
    attempt,
    evaluate_miou,
    prepared,
    rendered_set,
)
from experiments.reward.mmd import Reference, evaluate_mmd
from experiments.reward.seen import Seen, leave
from experiments.reward.shelf import Shelf, by_target, sent
from experiments.reward.store import Log, Store, digest_of, identity, outcome_of, record_of
from experiments.reward.truth import Shared, Subset, WithFew, rendered_of
from experiments.target.base import Side, Target
from scene.proposal import Streets
from scene.version import ENGINE
from scene.workers import Workers
from seg.data import LabelledImages
from shell.errors import UserError
from shell.files import digest, file_digest, folder_digest
from shell.lines import Record


class Job(NamedTuple):
    """One net to be trained and scored."""

    source: Source
    seed: int  # of the streets and of the net
    notes: dict[str, Any]  # what the run's log says of it, beside what it came to
    cost: float = 0.0  # CPU seconds, about; the longest begin first
    seen: Seen | None = None  # where it is kept what the net saw, if anywhere
    rendered: float = (
        0.0  # CPU seconds that rendering its training set took before, its share of them
    )


class Memory(NamedTuple):
    """Where evaluations are kept."""

    log: Log  # of the run
    store: Store | None  # shared with other runs
    elapsed: Callable[[], float]  # seconds that the run has taken so far, for the log

    def refresh(self) -> None:
        """Read what other runs have added to the store."""
        if self.store is not None:
            self.store.refresh()

    def knows(self, key: str) -> bool:
        """Whether an evaluation is known already."""
        stored = self.store is not None and self.store.get(key) is not None
        return stored or self.log.get(key) is not None

    def get(self, key: str, notes: dict[str, Any]) -> Outcome | None:
        """What is known of an evaluation; the log has a line for each of its jobs, by their notes."""
        known = self.log.get(key)
        if known is None and self.store is not None:
            known = self.store.get(key)
        if known is None:
            return None
        if not self.log.notes(key, notes):
            self._log(known, notes)
        return outcome_of(known)

    def add(self, record: Record, notes: dict[str, Any]) -> Outcome:
        """Keep a new evaluation; what another run has added to the store meanwhile stands."""
        if self.store is not None:
            # What is kept decides, lest a continued run see another value.
            record = self.store.add(record)
        self._log(record, notes)
        return outcome_of(record)._replace(stored=False)

    def _log(self, record: Record, notes: dict[str, Any]) -> None:
        self.log.add({**record, **notes, "elapsed": round(self.elapsed(), 2)})


class Evaluator:
    """Scores nets of one recipe on one side of a target.

    Args:
        recipe: sizes, net, training, assets.
        target: what to be good on.
        side: which of its images score.
        truth: those images, at the recipe's size; or their features, for rewards without labels.
        shelf: who renders and trains, and where they find real images.
        parts: of those images that are scored each for itself, too; only for mIoU. They do not name an
            evaluation: one that is known already may tell of other parts, or of none.
    """

    def __init__(
        self,
        recipe: Recipe,
        target: Target,
        side: Side,
        truth: LabelledImages | Reference,
        shelf: Shelf,
        parts: Parts = (),
    ) -> None:
        self._recipe, self._target, self._truth, self._shelf = recipe, target, truth, shelf
        self._evaluate: Callable[..., Outcome] = (
            evaluate_miou if isinstance(truth, LabelledImages) else evaluate_mmd
        )
        self._parts = (parts,) if parts else ()
        self.about = about(recipe, target, side, truth)

    def key(self, source: Source, seed: int) -> str:
        """The name of an evaluation."""
        return identity(self.about_of(source)["config"], rendered_of(source), seed)

    def about_of(self, source: Source) -> dict[str, Any]:
        """What all evaluations share that have the same few images beside them, if there are any."""
        if not isinstance(source, WithFew):
            return self.about
        few = source.arrays
        told = [self.about["config"], digest_of(few.images, few.labels), source.share]
        also = {"few": len(few.images), "few_share": source.share}
        return {**self.about, "config": digest(told)[:16], **also}

    def map(self, jobs: Sequence[Job], memory: Memory) -> Iterator[tuple[int, Outcome]]:
        """Yield (index, outcome) of every job; see `evaluated`."""
        asked = [(self, job) for job in jobs]
        for index, _, outcome in evaluated(asked, memory, self._shelf.workers):
            yield index, outcome

    def task(self, job: Job) -> tuple:
        """Arguments of `attempt`."""
        recipe, truth = self._for_tasks
        source = self._source(job.source)
        return (self._seeing(job), recipe, source, int(job.seed), truth, *self._parts)

    def keep(self, key: str, job: Job, outcome: Outcome, memory: Memory) -> Outcome:
        """Keep what a job came to.

        Raises:
            UserError: the truth holds no class.
        """
        if outcome.failed is None and not math.isfinite(outcome.reward):
            raise UserError(
                f"the score is {outcome.reward}: the images that score must hold at least one "
                "labelled class"
            )
        if job.seen is not None and outcome.sight is not None:
            leave(job.seen.of(key), outcome.sight)
        record = record_of(key, rendered_of(job.source), job.seed, outcome)
        return memory.add(record | self.about_of(job.source), job.notes)

    def _seeing(self, job: Job) -> Callable[..., Outcome]:
        """What evaluates a job, and tells what its net saw where that is asked for."""
        if job.seen is None:
            return self._evaluate
        return partial(self._evaluate, sees=job.seen.predictions)

    @cached_property
    def _for_tasks(self) -> tuple[Recipe, LabelledImages | Shared | Reference]:
        """Recipe and truth as workers want them."""
        workers = self._shelf.workers
        if isinstance(self._truth, Reference):
            truth = self._truth._replace(net=workers.share(self._truth.net))
            return sent(self._recipe, workers), truth
        recipe = self._shelf.normalised(self._recipe, self._target)
        return sent(recipe, workers), self._shelf.put(self._truth, recipe.fidelity.train)

    def _source(self, source: Source) -> Source | Shared:
        train = self._recipe.fidelity.train
        if isinstance(source, WithFew):
            few = self._shelf.put(source.arrays, train, training=True)
            return source._replace(rendered=self._source(source.rendered), few=few)
        if isinstance(source, Subset):
            return source.images
        if not isinstance(source, LabelledImages):
            return source
        return self._shelf.put(source, train, training=True)


Asked = Sequence[tuple[Evaluator, Job]]
"""Nets of several recipes, each with who scores it."""


def evaluated(
    asked: Asked,
    memory: Memory,
    workers: Workers,
    begun: Mapping[str, Future] | None = None,
) -> Iterator[tuple[int, str, Outcome]]:
    """Yield (index, key, outcome) of every job: known ones first, the others as they come in.

    All that are missing are one list, the longest first.

    Args:
        asked: what to train, and who scores it.
        memory: what is known, and where new outcomes are kept.
        workers: who train.
        begun: by key, nets that train already, behind all others; so do then those asked for.

    Raises:
        UserError: the truth holds no class.
    """
    keys = [evaluator.key(job.source, job.seed) for evaluator, job in asked]
    memory.refresh()
    missing: dict[str, list[int]] = {}  # several jobs of one call may be the same
    for index, key in enumerate(keys):
        known = memory.get(key, asked[index][1].notes)
        if known is None:
            missing.setdefault(key, []).append(index)
        else:
            yield index, key, known
    work = sorted((indices[0] for indices in missing.values()), key=lambda k: -asked[k][1].cost)
    if not work:
        return
    tasks = [asked[index][0].task(asked[index][1]) for index in work]
    rendered = [0.0] * len(tasks)
    if len(tasks) < workers.workers and not begun:  # else some would have nothing to do
        tasks, rendered = zip(*(_rendered_by_all(task, workers) for task in tasks), strict=True)
    own = {number: begun[keys[k]] for number, k in enumerate(work) if begun and keys[k] in begun}
    results = workers.map(attempt, tasks, net=True, first=prepared, behind=bool(begun), begun=own)
    for number, outcome in results:
        index = work[number]
        evaluator, job = asked[index]
        key = keys[index]
        seconds = outcome.render_seconds + rendered[number] + job.rendered
        outcome = outcome._replace(render_seconds=seconds)
        yield index, key, evaluator.keep(key, job, outcome, memory)
        for twin in missing[key][1:]:
            known = memory.get(key, asked[twin][1].notes)
            assert known is not None
            yield twin, key, known


def _rendered_by_all(task: tuple, workers: Workers) -> tuple[tuple, float]:
    """A task with its training set, rendered street by street by all workers, and their core seconds."""
    evaluate, recipe, source, seed, truth, *parts = task
    if isinstance(truth, Reference) or not isinstance(source, Streets):
        return task, 0.0
    started = time.perf_counter()
    own = rendered_set(recipe, source, seed, workers)
    busy = min(workers.workers, recipe.fidelity.streets)
    return (evaluate, recipe, own, seed, truth, *parts), busy * (time.perf_counter() - started)


def about(
    recipe: Recipe, target: Target, side: Side, truth: LabelledImages | Reference
) -> dict[str, Any]:
    """What all evaluations of a recipe share: a hash of what decides them, words for people."""
    names = target.reward_names if side == "reward" else target.test_names
    if isinstance(truth, Reference):
        kind, source = "mmd", truth.source
    else:
        kind, source = "miou", digest_of(truth.images, truth.labels)
    fidelity, pool = recipe.fidelity, recipe.pool.decides
    size = asdict(fidelity)
    # Files count, not where they lie.
    if pool["own"]:
        pool["own"] = folder_digest(Path(pool["own"]))
    if fidelity.train.weights is not None:
        size["train"]["weights"] = file_digest(Path(fidelity.train.weights))
    decides = {
        "kind": kind,
        "fidelity": size,
        "table": recipe.table,
        "renderer": recipe.renderer,
        "pool": pool,
        # Names alone do not tell one twin from another.
        "truth": [target.name, side, digest(list(names)), source],
        "engine": ENGINE,
        FIELD: dict(recipe.made_with),
    }
    if kind == "miou" and by_target(fidelity.train):
        real = target.at(fidelity.height, fidelity.width)["reward"]
        decides["statistics"] = digest_of(real.images)
    return {
        "config": digest(decides)[:16],
        "target": target.name,
        "side": side,
        "kind": kind,  # of the score; what a log calls its nets is "nets"
        "size": fidelity.size,
        "images": fidelity.images,
        "steps": fidelity.train.steps,
        "net": fidelity.train.net,
        "engine": ENGINE,
        FIELD: decides[FIELD],
    }
