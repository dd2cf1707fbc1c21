"""Makes evaluations: known ones come from stores, the others from worker processes.

A search waits for the last dataset of an update, then for its method. Networks that do not depend on its
answer use the idle cores meanwhile, with lower priority; a later request finds them finished, or started
(`Runner.prefetch`).
"""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from common.errors import Unfinished, UserError
from common.files import digest, file_digest, folder_digest
from common.lines import Record
from common.progress import Progress
from common.workers.pipeline import Split
from common.workers.pool import Workers
from experiments.evaluation.cache import Cache, by_target, sent
from experiments.evaluation.cached import Cached
from experiments.evaluation.compiling import announcement
from experiments.evaluation.cost import job_cost
from experiments.evaluation.in_worker import (
    attempt,
    attempt_all,
    evaluate_miou,
    parts_of,
    trained_net,
    worker_environment,
)
from experiments.evaluation.job import (
    Job,
    LabelledSource,
    LabelledSubset,
    Recipe,
    Result,
    Source,
    StreetPool,
    count_of,
    progress_line,
    rendered_of,
)
from experiments.evaluation.made_with import FIELD
from experiments.evaluation.predictions import file_of, save
from experiments.evaluation.renders import Part, joined, render_part
from experiments.evaluation.store import (
    Store,
    digest_of,
    digest_of_images,
    identity,
    record_of,
    result_of,
)
from experiments.evaluation.transfer import transfer
from experiments.targets.base import Side, Target
from scene.proposal import Streets, draw
from scene.version import ENGINE
from seg.data import LabelledImages
from seg.mixing import TrainingSet
from seg.step import Params

LEAST = 60.0
"""CPU seconds of networks for which more workers are started, since one takes ten to start."""


class _Prefetched(NamedTuple):
    """A network that trains before it is requested."""

    job: Job
    future: Future


class Runner:
    """Makes the evaluations of a run: `Job` to `Result`.

    Args:
        target: the target on which networks are tested.
        workers: the workers that render and train.
        folder: the folder of the run.
        finals: the store of evaluations that are no rewards of a search.
        store: a store that many runs share, if there is one.
        progress: gives the run's progress.

    Attributes:
        cache: files in which workers find images.
    """

    def __init__(
        self,
        target: Target,
        workers: Workers,
        folder: Path,
        finals: Store,
        store: Store | None,
        progress: Callable[[], Progress],
    ) -> None:
        self._target, self._workers, self._folder = target, workers, folder
        self._finals, self._store, self._progress = finals, store, progress
        workers.watch = lambda units: progress().under_way(units)
        self.cache = Cache(workers, folder, lambda text: progress().update(text, minor=True))
        self._about: dict[tuple[Recipe, Side], Record] = {}
        self._shared: dict[tuple[Recipe, Side], tuple[Recipe, Cached]] = {}
        self._split = Split(
            lambda most, task: _parts(most, task, self.cache.renders),
            render_part,
            _alike,
            attempt_all,
        )
        self._prefetched: dict[str, _Prefetched] = {}
        self._announced: set[str] = set()
        self._ended: set[str] = set()  # keys of those whose results came before their request

    def key(self, job: Job) -> str:
        """The name of an evaluation."""
        return identity(self.about(job)["config"], rendered_of(job.source), job.seed)

    def about(self, job: Job) -> Record:
        """A job's record without source and result; ``config`` names all other things that decide it."""
        tested = (job.recipe, job.side)
        if tested not in self._about:
            self._about[tested] = about(job.recipe, self._target, job.side, self._real(job))
        fields, start, source = self._about[tested], job.start, job.source
        if isinstance(source, TrainingSet):
            (_, few), (_, share) = source.parts, source.shares
            decides = [fields["config"], digest_of_images(few), share]
            subset_fields = {"few": count_of(few), "few_share": share}
            return {**fields, "config": digest(decides)[:16], **subset_fields}
        if start is None or (start.streets is None and not start.on_subset):
            return fields
        before = self.about(job._replace(recipe=start.recipe, start=None))["config"]
        if start.streets is not None:
            before = identity(before, start.streets, 0)
        return {**fields, "config": digest([before, fields["config"]])[:16]}

    def known(self, jobs: Sequence[Job]) -> list[bool]:
        """Whether each evaluation is known, in ``finals`` or in the store."""
        self._refresh()
        stores = [self._finals] if self._store is None else [self._finals, self._store]
        keys = [self.key(job) for job in jobs]
        return [any(store.get(key) is not None for store in stores) for key in keys]

    def prefetch(self, jobs: Sequence[Job], *, behind: bool = True) -> None:
        """Begin jobs that are requested later, the longest first.

        Args:
            jobs: the jobs.
            behind: begin them with low priority, if that pays. Jobs on given images alone are then left out:
                they are short, and fill the last gaps when requested.
        """
        jobs = sorted(jobs, key=job_cost, reverse=True)
        if behind:
            jobs = [job for job in jobs if not isinstance(job.source, LabelledSource)]
        new = {
            self.key(job): job
            for job, known in zip(jobs, self.known(jobs), strict=True)
            if not known and self.key(job) not in self._prefetched
        }
        if behind and not self._prefetched and sum(map(job_cost, new.values())) < LEAST:
            return
        self._announce_compilation(list(new.values()))
        for key, job in new.items():
            task = self._task([job])
            future = self._workers.begin(attempt, *task, split=self._split, behind=behind)
            if future is not None:
                self._prefetched[key] = _Prefetched(job, future)

    def run(
        self,
        jobs: Sequence[Job],
        log: Store | None = None,
        say: Callable[[int, Result], str] | None = None,
    ) -> list[Result]:
        """Make all evaluations; diverged training is a result with its reason.

        Args:
            jobs: the evaluations to make.
            log: the store of the results; by default ``finals``.
            say: gives the progress line of a new result; the job's index is the first argument.

        Raises:
            UserError: no pixel of the tested images has a label.
        """
        log = self._finals if log is None else log
        results: dict[int, Result] = {}
        self._keep_ended()
        for index, key, result in self._results(jobs, log):
            results[index] = result
            if key in self._ended:
                self._ended.remove(key)
            else:
                self._progress().advance(job_cost(jobs[index]), replayed=result.stored)
            if say is not None and not result.stored:
                self._progress().update(say(index, result))
            self._keep_ended()
        return [results[index] for index in range(len(jobs))]

    def test(self, jobs: Sequence[Job]) -> list[Result]:
        """Make evaluations that are no rewards of a search, and report each result.

        Raises:
            UserError: more than a tenth of the networks of one kind (``nets`` in their notes) failed.
        """
        results = self.run(jobs, say=lambda index, result: progress_line(jobs[index], result))
        for what in dict.fromkeys(job.notes["nets"] for job in jobs):
            kind_results = [
                r for job, r in zip(jobs, results, strict=True) if job.notes["nets"] == what
            ]
            refuse_failed(kind_results, len(kind_results))
        return results

    def begin_training(self, job: Job, params: Params | None = None) -> Future | None:
        """Begin a network that `train` may be asked for later; None without worker processes."""
        return self._workers.begin(trained_net, *self._training(job, params), behind=False)

    def train(self, job: Job, params: Params | None = None, future: Future | None = None) -> Params:
        """Train a job's network and return its variables, without a test or a record.

        Args:
            job: the job of the network.
            params: parameters at the start.
            future: the result of `begin_training` with the same arguments.

        Raises:
            UserError: training diverged.
        """
        started = {} if future is None else {0: future}
        ((_, variables),) = self._workers.map(
            trained_net, [self._training(job, params)], net=True, started=started
        )
        if isinstance(variables, str):
            raise UserError(f"training of the network failed: {variables}")
        return variables

    def _training(self, job: Job, params: Params | None) -> tuple:
        """Arguments of `trained_net`."""
        recipe = sent(self.cache.normalised(job.recipe, self._target), self._workers)
        return recipe, self._source(job.source, job.recipe), int(job.seed), params

    def _results(self, jobs: Sequence[Job], log: Store) -> Iterator[tuple[int, str, Result]]:
        """Yield (index, key, result) of every job: known ones first, the others as they are done.

        Missing jobs run together, the longest first.
        """
        keys = [self.key(job) for job in jobs]
        prefetched = {
            key: self._prefetched.pop(key).future for key in set(keys) & set(self._prefetched)
        }
        self._refresh()
        missing: dict[str, list[int]] = {}  # several jobs of one call may be the same
        for index, (key, job) in enumerate(zip(keys, jobs, strict=True)):
            remembered = self._remembered(key, job, log)
            if remembered is None:
                missing.setdefault(key, []).append(index)
            else:
                yield index, key, remembered
        work = _grouped(jobs, [indices[0] for indices in missing.values()])
        if not work:
            return
        self._announce_compilation([jobs[indices[0]] for indices in work])
        tasks = [self._task([jobs[index] for index in indices]) for indices in work]
        rendered = [0.0] * len(tasks)
        idle = len(tasks) < self._workers.workers and not prefetched
        if idle and self._workers.trainers is None:  # a pipeline divides sets itself
            tasks, rendered = zip(*map(self._rendered_by_all, tasks), strict=True)
        started = {
            n: prefetched[keys[work[n][0]]]
            for n in range(len(work))
            if keys[work[n][0]] in prefetched
        }
        results_by_task = self._workers.map(
            attempt, tasks, net=True, split=self._split, started=started
        )
        for number, results in results_by_task:
            several = results if isinstance(results, list) else [results]
            for index, result in zip(work[number], several, strict=True):
                key, job = keys[index], jobs[index]
                seconds = result.render_seconds + rendered[number]
                yield index, key, self._keep(key, job, result._replace(render_seconds=seconds), log)
                for twin in missing[key][1:]:
                    remembered = self._remembered(key, jobs[twin], log)
                    assert remembered is not None
                    yield twin, key, remembered

    def _announce_compilation(self, jobs: Sequence[Job]) -> None:
        """Say that trainers of this machine compile for its GPU, once for each recipe."""
        if self._workers.trainers is None or not self._workers.share_disk:
            return
        for recipe in dict.fromkeys(job.recipe for job in jobs):
            text = announcement(recipe, worker_environment())
            if text is not None and text not in self._announced:
                self._announced.add(text)
                self._progress().say(text)

    def _remembered(self, key: str, job: Job, log: Store) -> Result | None:
        """The known result of an evaluation; the log has a line for each of its jobs, by their notes."""
        record = log.get(key)
        if record is None and self._store is not None:
            record = self._store.get(key)
        if record is None:
            return None
        if not log.notes(key, job.notes):
            self._write(record, job, log)
        return result_of(record)

    def _keep(self, key: str, job: Job, result: Result, log: Store) -> Result:
        """Record a job's result.

        Raises:
            UserError: no tested pixel has a label.
        """
        if result.failed is None and not math.isfinite(result.reward):
            raise UserError(
                f"the reward is {result.reward}: the images that networks are tested on must have at least "
                "one labelled class"
            )
        if result.predictions is not None:
            save(file_of(self._folder, key), result.predictions)
        record = record_of(key, rendered_of(job.source), job.seed, result) | self.about(job)
        if self._store is not None:
            # The recorded value is used, so that a continued run sees the same.
            record = self._store.add(record)
        self._write(record, job, log)
        return result_of(record)._replace(stored=False)

    def _write(self, record: Record, job: Job, log: Store) -> None:
        log.add({**record, **job.notes, "elapsed": round(self._progress().elapsed, 2)})

    def _keep_ended(self) -> None:
        """Record and report the results of prefetched networks that are done."""
        for key, (job, future) in list(self._prefetched.items()):
            if future.done():
                del self._prefetched[key]
                try:
                    result = self._workers.result(future)
                except (BrokenProcessPool, CancelledError):
                    continue  # its worker died; a request makes it again
                self._ended.add(key)
                result = self._keep(key, job, result, self._finals)
                self._progress().advance(job_cost(job))
                self._progress().update(progress_line(job, result))

    def _refresh(self) -> None:
        """Read the records that other runs have added to the store."""
        if self._store is not None:
            self._store.refresh()

    def _real(self, job: Job) -> LabelledImages:
        """The images on which a job's network is tested."""
        fidelity = job.recipe.fidelity
        return self._target.at(fidelity.height, fidelity.width)[job.side]

    def _task(self, jobs: Sequence[Job]) -> tuple:
        """Arguments of `attempt`; jobs that are fine-tuned from one network are one task."""
        job = jobs[0]
        recipe, real = self._for_tasks(job)
        train, start = job.recipe.fidelity.train, job.start
        if start is not None:
            subsets = [one.source for one in jobs if isinstance(one.source, LabelledSubset)]
            before = sent(start.recipe, self._workers)
            before = before._replace(statistics=recipe.statistics)  # images of the same size
            images = self.cache.put(subsets[0].images, train, "labelled", training=True)
            chosen = [np.array(subset.indices) for subset in subsets]
            arguments = (start._replace(recipe=before), recipe, int(job.seed), images, chosen, real)
            return (transfer, *arguments)
        evaluate: Callable[..., Result] = evaluate_miou
        if job.keeps is not None:
            evaluate = partial(evaluate, keeps=job.keeps)
        return (evaluate, recipe, self._source(job.source, job.recipe), int(job.seed), real)

    def _for_tasks(self, job: Job) -> tuple[Recipe, Cached]:
        """A job's recipe and tested images in the form for workers."""
        tested = (job.recipe, job.side)
        if tested not in self._shared:
            recipe = self.cache.normalised(job.recipe, self._target)
            cached = self.cache.put(self._real(job), recipe.fidelity.train, job.side)
            self._shared[tested] = sent(recipe, self._workers), cached
        return self._shared[tested]

    def _source(self, source: Source, recipe: Recipe) -> Any:
        """A source in the form for workers."""
        if isinstance(source, TrainingSet):
            return source._replace(parts=tuple(self._source(part, recipe) for part in source.parts))
        if isinstance(source, StreetPool):
            return self.cache.pool(source.name, recipe)
        train = recipe.fidelity.train
        if isinstance(source, LabelledSubset):
            return self.cache.put(source.images, train, "labelled", training=True).take(
                source.indices
            )
        if isinstance(source, LabelledImages):
            return self.cache.put(source, train, "labelled", training=True)
        return source

    def _rendered_by_all(self, task: tuple) -> tuple[tuple, float]:
        """A task with its training set, rendered street by street by all workers, and their core seconds."""
        evaluate, recipe, source, seed, real, *more = task
        if more or not isinstance(source, Streets):
            return task, 0.0
        parts = _parts(recipe.fidelity.streets, task, None)
        images, labels, seconds = joined(list(self._workers.in_order(render_part, parts)))
        return (evaluate, recipe, LabelledImages(images, labels), seed, real), seconds


def _parts(most: int, task: tuple, folder: str | None) -> list[tuple[Part]]:
    """Divide the rendered set of an evaluation for renderers; nothing if it has none."""
    evaluate, *arguments = task
    if evaluate is transfer:
        start, _, seed, *_ = arguments
        recipe, streets = start.recipe, start.streets
    else:
        recipe, source, seed, *_ = arguments
        streets = rendered_of(source)
    if not isinstance(streets, Streets):
        return []
    units = draw(streets, seed, recipe.fidelity.streets)
    return parts_of(recipe, units, seed, most, folder)


def _alike(task: tuple) -> bytes:
    """What evaluations have in common that a trainer may make together: all but rendered images and seeds."""
    evaluate, *arguments = task
    if evaluate is transfer:
        return pickle.dumps(task)
    recipe, source, _, real = arguments
    mixed = (source.parts[1:], source.shares) if isinstance(source, TrainingSet) else ()
    return pickle.dumps((evaluate, recipe, type(rendered_of(source)), mixed, real))


def _grouped(jobs: Sequence[Job], missing: Sequence[int]) -> list[list[int]]:
    """Group jobs by index into tasks, the longest first; jobs fine-tuned from one network are one task."""
    groups: dict[Any, list[int]] = {}
    for index in missing:
        job = jobs[index]
        name = index if job.start is None else (id(job.start), job.seed)
        groups.setdefault(name, []).append(index)
    return sorted(groups.values(), key=lambda indices: -sum(job_cost(jobs[k]) for k in indices))


def refuse_failed(results: Sequence[Result], total: int) -> None:
    """Raise Unfinished if more than a tenth of all evaluations have failed, and more than one."""
    reasons = [result.failed for result in results if result.failed is not None]
    if len(reasons) > max(1, total // 10):
        raise Unfinished(
            f"{len(reasons)} of {total} evaluations failed, more than a tenth of them; the last one: "
            f"{reasons[-1]}"
        )


def about(recipe: Recipe, target: Target, side: Side, real: LabelledImages) -> Record:
    """The common fields of a recipe's evaluations: a hash of what decides them, and words for people."""
    names = target.reward_names if side == "reward" else target.test_names
    fidelity, pool = recipe.fidelity, recipe.pool.identity
    size = asdict(fidelity)
    size["train"]["trunk"] = size["train"].pop("backbone")  # its name when stores began
    # The content of files counts, not their path.
    if pool["own"]:
        pool["own"] = folder_digest(Path(pool["own"]))
    if "own_class" in pool:
        pool["own_class"]["file"] = folder_digest(Path(pool["own_class"]["file"]))
    if fidelity.train.weights is not None:
        size["train"]["weights"] = file_digest(Path(fidelity.train.weights))
    decides = {
        "kind": "miou",
        "fidelity": size,
        "table": recipe.table,
        "renderer": recipe.renderer,
        "pool": pool,
        # Names alone do not distinguish twins.
        "truth": [target.name, side, digest(list(names)), digest_of_images(real)],
        "engine": ENGINE,
        FIELD: dict(recipe.made_with),
    }
    if recipe.classes.outlines:
        # A target of the package is in the table by its name.
        decides["outlines"] = recipe.classes.outlines
    if recipe.checkpoints > 1:
        decides["checkpoints"] = recipe.checkpoints
    if by_target(fidelity.train):
        reward_images = target.at(fidelity.height, fidelity.width)["reward"]
        decides["statistics"] = digest_of(reward_images.images)
    return {
        "config": digest(decides)[:16],
        "target": target.name,
        "side": side,
        "kind": "miou",  # of the reward; the kind of networks is "nets"
        "size": fidelity.size,
        "images": fidelity.images,
        "steps": fidelity.train.steps,
        "net": fidelity.train.net,
        "engine": ENGINE,
        FIELD: decides[FIELD],
    }
