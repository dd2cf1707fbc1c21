"""An open run folder: its configuration, target, workers, store and progress.

    with session.open(config) as run:
        run.begin([Work.at("networks", count, config.final)])
        results = run.runner.test(jobs)

A restarted job does the rest, since its folder holds all evaluations so far.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any, Generic, NamedTuple, TypeVar, cast

from common import folder
from common.command import say
from common.errors import UserError, counted
from common.progress import Progress, Stage, duration
from common.workers.executors import workers_of
from common.workers.pool import Workers
from experiments.config import Config, FewConfig, Fidelity, fidelities
from experiments.config.trainers import trainers_of, usable_gpus
from experiments.evaluation import pace as paces
from experiments.evaluation.cost import (
    COMPILE_COST,
    Cost,
    cost_of,
    head_cost,
    prepare_cost,
    training_cost,
)
from experiments.evaluation.devices import device, refuse_unusable
from experiments.evaluation.in_worker import worker_environment
from experiments.evaluation.job import Recipe, Source
from experiments.evaluation.made_with import FIELD, MadeWith, ask_made_with
from experiments.evaluation.pace import REFERENCE, WORTH, Crew, Pace
from experiments.evaluation.runner import Runner
from experiments.evaluation.store import LOGS, Store
from experiments.targets.base import Side, Target
from experiments.targets.named import named_target
from scene.compiled import first_use
from scene.dataset.render import compile_first
from scene.render import RendererError, renderer
from scene.version import ENGINE
from scene.versions import picture_versions
from seg.data import LabelledImages
from seg.mixing import TrainingSet
from seg.weights import described

PACKAGES = ("sdr-jax", "trimesh", "pyrender")
"""More packages with versions in ``config.json``; those that decide evaluations are in `FIELD`."""
FREE_FIELDS = ("out", "workers", "trainers", "executor", "scheduler", "store", "from_scratch")
"""Fields that may differ when a job is continued."""
AnyConfig = TypeVar("AnyConfig", bound=Config)


class Work(NamedTuple):
    """Networks or streets of one kind that a job makes."""

    what: str  # such as "rewards of the search"
    number: int
    fidelity: Fidelity
    cost_of_one: Cost

    @classmethod
    def at(cls, what: str, number: int, fidelity: Fidelity) -> Work:
        """Networks that are trained on rendered datasets."""
        training = training_cost(fidelity)
        return cls(what, number, fidelity, Cost(cost_of(fidelity) - training, training))

    @classmethod
    def on_images(cls, what: str, number: int, fidelity: Fidelity) -> Work:
        """Networks that are trained on images that exist, with their features."""
        return cls(what, number, fidelity, Cost(train=head_cost(fidelity)))

    @property
    def cost(self) -> float:
        """The total cost in the units of ``cost_of``."""
        return sum(self.total)

    @property
    def total(self) -> Cost:
        """The total cost of rendering and of training."""
        return self.cost_of_one.times(self.number)


def total_of(plan: Sequence[Work]) -> Cost:
    """The cost of a whole plan."""
    return Cost(*map(sum, zip(*(work.total for work in plan), strict=True)))


@dataclass
class Session(Generic[AnyConfig]):
    """Everything that a job works with."""

    config: AnyConfig
    target: Target
    workers: Workers
    evaluations: Store
    """Rewards of searches, one line each, as they are made."""
    finals: Store
    """All other networks."""
    store: Store | None
    """Evaluations shared with other runs."""
    progress: Progress
    made_with: MadeWith = ()
    """Backend and versions of its workers."""
    runner: Runner = field(init=False)
    """It makes the job's evaluations."""

    def __post_init__(self) -> None:
        self.runner = Runner(
            self.target, self.workers, self.config.out, self.finals, self.store,
            lambda: self.progress,
        )  # fmt: skip

    def recipe(self, fidelity: Fidelity, **pool: Any) -> Recipe:
        """The recipe of networks at a fidelity; fields of the pool of assets may be changed."""
        config = self.config
        assets = config.pool._replace(**pool)
        table = self.target.table
        return Recipe(fidelity, table, config.renderer, assets, made_with=self.made_with)

    def images(self, fidelity: Fidelity, side: Side) -> LabelledImages:
        """The target's images of a side at a fidelity's size."""
        return self.target.at(fidelity.height, fidelity.width)[side]

    def with_few(self, fidelity: Fidelity, rendered: Source) -> Source:
        """A rendered set with the few labelled images, if the job has any."""
        return with_few(self.config, self.target, fidelity, rendered)

    def begin(self, plan: Sequence[Work]) -> None:
        """Print the plan with its time, and count progress from here."""
        label = "" if self.target.real else f"{self.target.name}, not real | "
        lines = self.evaluations.records + self.finals.records
        elapsed = max((line.get("elapsed", 0.0) for line in lines), default=0.0)
        stages = [Stage(work.what, work.number, work.cost) for work in plan]
        cost, start, pace = total_of(plan), self._prepare_cost(), paces.read(self._kind)
        crew = Crew(pace or REFERENCE, max(self.workers.workers, 1), self.workers.trainers)
        self.progress = Progress(sum(cost), elapsed, label, stages=stages, workers=crew.workers)
        self.progress.say(plan_text(plan, crew, start))
        if self.workers.dashboard is not None:
            self.progress.say(f"Dashboard: {self.workers.dashboard}")
        shared = "" if self.store is None else f" | {self._held(self.store)}"
        self.progress.say(f"Folder: {self.config.out}{shared}")
        if lines:
            self.progress.say(
                f"Resuming: {counted(len(self.evaluations), 'reward')} and "
                f"{counted(len(self.finals), 'other network')} are done, in {duration(elapsed)}"
            )
        self.progress.expect(crew.wall(cost), crew.start(start))
        compile_first(self.workers, self.config.renderer)
        start = start._replace(render=0.0)
        if pace is None and sum(cost) > WORTH:
            pace = _measured(self.workers, self._kind, self.progress.say)
            crew = crew._replace(pace=pace)
            self.progress.say(time_text(cost, crew, start))
        self.progress.expect(crew.wall(cost), crew.start(start))

    @property
    def _kind(self) -> str:
        return paces.kind(self.config.executor, dict(self.made_with).get("backend", "cpu"))

    def _prepare_cost(self) -> Cost:
        """The cost of what precedes the plan: compiling the renderer, and features of labelled images."""
        target = self.target
        images = len(target.reward_names) + len(target.test_names) + len(target.few_names)
        compiling = COMPILE_COST if first_use(self.config.renderer) is not None else 0.0
        return prepare_cost(self.config.reward, images)._replace(render=compiling)

    def _held(self, store: Store) -> str:
        """The number of evaluations in a store, and of those that this run may use."""
        usable = sum(record.get(FIELD) == dict(self.made_with) for record in store.records)
        others = len(store) - usable
        note = f", {others} of them made with other backends or versions" if others else ""
        return f"{store.path} holds {len(store)}{note}"


def with_few(config: Config, target: Target, fidelity: Fidelity, rendered: Source) -> Source:
    """A rendered set with the few labelled images of a target, if it has any."""
    if not target.few_names:
        return rendered
    share = cast(FewConfig, config).few_share
    few = target.at(fidelity.height, fidelity.width)["few"]
    return TrainingSet((rendered, few), (1 - share, share))


def plan_text(plan: Sequence[Work], crew: Crew, start: Cost) -> str:
    """The plan in words: one line per kind of network, the weights, and the approximate time.

    Args:
        plan: the networks.
        crew: the processes.
        start: the cost of what precedes the networks.
    """
    lines = ["Plan, in CPU seconds:"]
    for what, number, fidelity, cost_of_one in plan:
        train, seconds = fidelity.train, crew.pace.seconds(cost_of_one)
        size = f"{fidelity.size}, {fidelity.images} images, {train.steps} steps"
        decimals = 1 if seconds >= 1 else 2
        lines.append(f"  {number:5d} x {seconds:6.{decimals}f}  {what} ({train.net}, {size})")
    starts = (described(work.fidelity.train) for work in plan)
    lines += [f"  {start}" for start in dict.fromkeys(starts) if start]
    lines.append(f"{time_text(total_of(plan), crew, start)}; known evaluations take no time")
    return "\n".join(lines)


def time_text(cost: Cost, crew: Crew, start: Cost) -> str:
    """The approximate time of a plan in words; arguments as of `plan_text`."""
    first = crew.start(start)
    whole = duration(first + crew.wall(cost))
    processes = (
        counted(crew.workers, "worker")
        if crew.trainers is None
        else f"{counted(crew.workers, 'renderer')} and {counted(crew.trainers, 'trainer')}"
    )
    return f"About {whole} on {processes}, {duration(first)} of it to start and compile"


def _measured(workers: Workers, kind: str, say: Callable[[str], None]) -> Pace:
    say("Measuring how fast this machine is (once per machine)...")
    pace = paces.measured_by(workers)
    paces.keep(kind, pace)
    return pace


def pace_here(workers: int, say: Callable[[str], None], *, measure: bool) -> Pace:
    """The pace of so many processes of this machine, before a job begins.

    Args:
        workers: number of processes.
        say: called before it is measured.
        measure: whether to measure it if it is not known; otherwise it is `REFERENCE`.
    """
    set_up_process()
    import jax  # after the environment is set

    pace = paces.read(paces.kind("processes", jax.default_backend()))
    if pace is None and measure:
        return measured_here(workers, say)
    return pace or REFERENCE


def measured_here(workers: int, say: Callable[[str], None] = lambda text: None) -> Pace:
    """Measure the pace of so many processes of this machine, and keep it for other jobs."""
    set_up_process()
    import jax  # after the environment is set

    environment, trainers = worker_environment(), trainers_of(None, usable_gpus())
    with workers_of("processes", workers, None, environment, dict, trainers) as pool:
        compile_first(pool, Config.renderer)
        return _measured(pool, paces.kind("processes", jax.default_backend()), say)


def workers_for(config: Config) -> Workers:
    """The workers: at least one process, since networks must not train in JAX's callback.

    Raises:
        UserError: as `workers_of` and `trainers_of`.
    """
    workers, trainers = max(config.workers, 1), config.trainers
    if config.executor == "processes":
        trainers = trainers_of(trainers, usable_gpus())
    return workers_of(
        config.executor, workers, config.scheduler, worker_environment(), picture_versions, trainers
    )


def set_up_process() -> None:
    """Set the environment of this process as jobs need it; it has no effect once JAX has started."""
    # A GPU's memory is for the workers' networks.
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    # XLA's threads: networks of this process are the same as those of workers.
    os.environ["NPROC"] = "1"


@contextmanager
def open(
    config: AnyConfig,
    refuse: Callable[[Target], None] | None = None,
    find: Callable[[AnyConfig, Workers], Target] = named_target,
) -> Iterator[Session[AnyConfig]]:
    """Open everything that a job works with, and close it afterwards.

    Args:
        config: the configuration with checked fields.
        refuse: raises UserError for a job that does not fit this target, before the folder is made.
        find: finds the target of the job.

    Raises:
        UserError, DataError: errors of the user.
    """
    set_up_process()
    try:
        renderer(config.renderer)
    except RendererError as error:
        raise UserError(str(error)) from None
    fields = {"engine": ENGINE, **asdict(config)}
    with workers_for(config) as workers:
        made_with_answer = ask_made_with(workers)
        target = find(config, workers)
        folder.refuse_foreign(config.out, fields, (*FREE_FIELDS, FIELD))
        if refuse is not None:
            refuse(target)
        store = None if config.store is None else Store(config.store, shared=True)
        title = f"Target: {target.title}"
        if not target.real:  # rendering it takes a while, so this is said first
            say(title)
            compile_first(workers, config.renderer)  # after all that is refused at once
        target.at(config.reward.height, config.reward.width)
        if target.real:
            say(title)
        ((_, made_with),) = made_with_answer
        fields[FIELD] = dict(made_with)
        if workers.trainers is not None:
            names = usable_gpus() if config.executor == "processes" else []
            ((_, trainer_device),) = workers.map(device, [()], net=True)
            refuse_unusable(trainer_device, names, fidelities(config))
        with folder.opened(config.out, fields, free=FREE_FIELDS, packages=PACKAGES):
            evaluations, finals = (Store(config.out / name) for name in LOGS)
            run = Session(
                config, target, workers, evaluations, finals, store, Progress(1.0), made_with
            )
            run.runner.cache.remove_renders()  # of a killed run
            try:
                yield run
            finally:
                run.progress.close()
                if workers.trainers is not None:
                    workers.close()
                    run.runner.cache.remove_renders()
