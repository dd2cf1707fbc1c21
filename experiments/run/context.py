"""One job under way: its configuration, target, workers, folder, store and progress.

    with opened(config) as run:
        run.begin([Work.at("nets", count, config.final)])
        evaluator = run.evaluator(run.recipe(config.final), "test")
        outcomes = run.score([(evaluator, job) for job in jobs], log=run.finals)

A job that is started again does what is left: everything that was scored is in its folder.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar, get_args

from experiments.config import Candidate, Config, Fidelity, RewardKind
from experiments.reward.evaluator import Asked, Evaluator, Job, Memory, evaluated
from experiments.reward.made_with import FIELD, MadeWith, asked
from experiments.reward.miou import Outcome, Parts, Recipe, worker_environment
from experiments.reward.mmd import FeatureNet, Reference, feature_net
from experiments.reward.shelf import Shelf
from experiments.reward.store import LOGS, Log, Store
from experiments.run.ahead import Ahead
from experiments.run.ladder import cost_of
from experiments.target.base import Side, Target
from experiments.target.named import named_target
from scene.executors import workers_of
from scene.render import RendererError, renderer
from scene.version import ENGINE
from scene.workers import Workers
from sdr_jax import refuse_failures
from seg.data import LabelledImages
from seg.weights import described
from shell import folder
from shell.errors import UserError
from shell.files import parse_json
from shell.progress import Progress, Stage, duration

PACKAGES = ("sdr-jax", "trimesh", "pyrender")
"""Whose versions ``config.json`` holds, beside those that decide evaluations."""
FREE_FIELDS = ("out", "workers", "executor", "scheduler", "store")
"""Fields that may differ when a job is continued."""
REWARD_NAMES: dict[RewardKind, str] = {"miou": "mIoU", "mmd": "-MMD^2"}
"""What each ``--reward-kind`` is."""

AnyConfig = TypeVar("AnyConfig", bound=Config)


class Work(NamedTuple):
    """Nets of one kind that a job trains."""

    what: str  # such as "rewards of the search"
    nets: int
    fidelity: Fidelity
    seconds: float  # of a CPU, each, about

    @classmethod
    def at(cls, what: str, nets: int, fidelity: Fidelity) -> Work:
        """Nets that are trained on a rendered dataset."""
        return cls(what, nets, fidelity, cost_of(fidelity))

    @property
    def cost(self) -> float:
        """Of all of it, in the units of ``cost_of``."""
        return self.nets * self.seconds


@dataclass
class Run(Generic[AnyConfig]):
    """All that a job works with."""

    config: AnyConfig
    target: Target
    workers: Workers
    evaluations: Log
    """Rewards of searches, one line each, as they are made."""
    finals: Log
    """All other nets."""
    store: Store | None
    """Evaluations shared with other runs."""
    progress: Progress
    made_with: MadeWith = ()
    """Backend and versions of its workers."""
    shelf: Shelf = field(init=False)
    """The workers, and real images in files that they share."""
    ahead: Ahead = field(init=False)
    """Final nets that train before anybody waits for them."""
    _net: list[FeatureNet] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.shelf = Shelf(self.workers, self.config.out, lambda text: self.progress.update(text))
        self.ahead = Ahead(self.workers, self.memory(self.finals))

    def recipe(self, fidelity: Fidelity, **pool: Any) -> Recipe:
        """How nets are made at a fidelity; fields of the pool of assets may be changed."""
        config = self.config
        assets = config.pool._replace(**pool)
        table, own = self.target.table, self.made_with
        return Recipe(fidelity, table, config.renderer, assets, made_with=own)

    def truth(self, fidelity: Fidelity, side: Side) -> LabelledImages:
        """The target's labelled images of a side, at a fidelity's size; the few, or all but the test's."""
        return self.target.at(fidelity.height, fidelity.width)[side]

    def evaluator(
        self, recipe: Recipe, side: Side = "reward", kind: RewardKind = "miou", parts: Parts = ()
    ) -> Evaluator:
        """Scores nets of a recipe on the images of a side, and on each of its parts."""
        images = self.truth(recipe.fidelity, side)
        truth: LabelledImages | Reference = images
        if kind == "mmd":
            if not self._net:
                self.progress.say(
                    "The reward is -MMD^2 in the features of one net: labels are left alone"
                )
                own = self.recipe(self.config.reward)
                self._net.append(feature_net(own, self.config.out, self.workers))
            truth = self._net[0].reference(images.images)
        return Evaluator(recipe, self.target, side, truth, self.shelf, parts)

    def memory(self, log: Log) -> Memory:
        """What is known already, and where new evaluations are kept: ``evaluations`` or ``finals``."""
        return Memory(log, self.store, lambda: self.progress.elapsed)

    def score(
        self,
        asked: Asked,
        *,
        log: Log,
        say: Callable[[int, Outcome], str] | None = None,
    ) -> list[Outcome]:
        """Train and score a net for every job; a failed one is an outcome with its reason.

        Args:
            asked: what to train on, with which seeds, and who scores it.
            log: where evaluations are kept: ``evaluations`` or ``finals``.
            say: what progress says about a new outcome; the job's index is the first argument.
        """
        found: dict[int, Outcome] = {}
        self._gather()
        begun = self.ahead.take(asked)
        for index, key, outcome in evaluated(asked, self.memory(log), self.workers, begun):
            found[index] = outcome
            if key in self.ahead.counted:
                self.ahead.counted.remove(key)
            else:
                self.progress.advance(asked[index][1].cost, replayed=outcome.stored)
            if say is not None and not outcome.stored:
                self.progress.update(say(index, outcome))
            self._gather()
        return [found[index] for index in range(len(asked))]

    def _gather(self) -> None:
        """Keep and tell what nets have come to that nobody waits for yet."""
        for job, outcome in self.ahead.ended():
            self.progress.advance(job.cost)
            self.progress.update(net_said(job, outcome))

    def begin(self, plan: Sequence[Work]) -> None:
        """Say what is about to be done and how long it takes, and count it from here."""
        label = "" if self.target.real else f"{self.target.name}, not real | "
        lines = self.evaluations.records + self.finals.records
        elapsed = max((line.get("elapsed", 0.0) for line in lines), default=0.0)
        stages = [Stage(work.what, work.nets, work.cost) for work in plan]
        total, workers = sum(work.cost for work in plan), max(self.workers.workers, 1)
        self.progress = Progress(total, elapsed, label, stages=stages, workers=workers)
        self.progress.say(plan_text(plan, self.workers.workers))
        if self.workers.dashboard is not None:
            self.progress.say(f"Dashboard: {self.workers.dashboard}")
        shared = "" if self.store is None else f" | {self._held(self.store)}"
        self.progress.say(f"Folder: {self.config.out}{shared}")
        if lines:
            self.progress.say(
                f"Continuing: {len(self.evaluations.records)} rewards and "
                f"{len(self.finals.records)} other nets are done, in {duration(elapsed)}"
            )

    def _held(self, store: Store) -> str:
        """How many evaluations a store holds, and how many of them this run may take."""
        ours = sum(record.get(FIELD) == dict(self.made_with) for record in store.records)
        others = len(store) - ours
        note = f", {others} of them made with other backends or versions" if others else ""
        return f"{store.path} holds {len(store)}{note}"


def refuse_failed(outcomes: Sequence[Outcome], total: int) -> None:
    """Raise UserError if more than a tenth of all that is asked for has failed."""
    reasons = [outcome.failed for outcome in outcomes if outcome.failed is not None]
    if reasons:
        refuse_failures(len(reasons), total, reasons[-1])


def in_words(kind: RewardKind, reward: float) -> str:
    """A reward as progress tells it: mIoU in percent, or -MMD^2 as it is."""
    return f"{100 * reward:.1f}" if kind == "miou" else f"{reward:.4f}"


def verdict(outcome: Outcome, kind: RewardKind = "miou") -> str:
    """What progress says about a net."""
    if outcome.failed:
        return "failed"
    return f"{REWARD_NAMES[kind]} {in_words(kind, outcome.reward)}"


def net_said(job: Job, outcome: Outcome, kind: RewardKind = "miou") -> str:
    """What progress says about a net that is none of a search."""
    notes = job.notes
    return f"{notes['nets']}: {notes['row']}, seed {notes['seed']} | {verdict(outcome, kind)}"


def plan_text(plan: Sequence[Work], workers: int) -> str:
    """What is to be done, one line a kind, from which weights, and how long all of it takes, about."""
    lines = ["Plan, in CPU seconds:"]
    for what, nets, fidelity, seconds in plan:
        train = fidelity.train
        size = f"{fidelity.size}, {fidelity.images} images, {train.steps} steps"
        lines.append(f"  {nets:5d} x {seconds:6.1f}  {what} ({train.net}, {size})")
    starts = (described(work.fidelity.train) for work in plan)
    lines += [f"  {start}" for start in dict.fromkeys(starts) if start]
    total = duration(sum(work.cost for work in plan) / max(workers, 1))
    lines.append(
        f"About {total} on {max(workers, 1)} worker(s), without compiling; what is known takes no time"
    )
    return "\n".join(lines)


def _refuse_former(out: Path) -> None:
    """Raise UserError for the folder of a run with candidates that are none any more."""
    file, known = out / folder.CONFIG, get_args(Candidate)
    try:
        stored = parse_json(file.read_bytes())["candidates"]
        gone = [str(name) for name in stored if name not in known]
    except (OSError, ValueError, KeyError, TypeError):
        return  # no folder of a run that selects, which `folder.refuse_foreign` says
    if gone:
        raise UserError(
            f"{file}: candidates holds {gone[0]!r}, which an earlier version had; now there are "
            f"{', '.join(known)}; use another --out"
        )


@contextmanager
def opened(
    config: AnyConfig, refuse: Callable[[Target], None] | None = None
) -> Iterator[Run[AnyConfig]]:
    """Open all that a job works with; close it afterwards.

    Args:
        config: the job, its fields checked.
        refuse: raises UserError for what cannot be done on this target. Whatever the user got wrong
            shows before the folder is made.

    Raises:
        UserError, DataError: what a user can get wrong.
    """
    try:
        renderer(config.renderer)
    except RendererError as error:
        raise UserError(str(error)) from None
    plain = {"engine": ENGINE, **asdict(config)}
    environment = worker_environment()
    with workers_of(config.executor, config.workers, config.scheduler, environment) as workers:
        answer = asked(workers)
        target = named_target(config, workers)
        _refuse_former(config.out)
        folder.refuse_foreign(config.out, plain, (*FREE_FIELDS, FIELD))
        if refuse is not None:
            refuse(target)
        store = None if config.store is None else Store(config.store)
        title = f"Target: {target.title}"
        if not target.real:  # rendering it takes a while; say at once that it is not real
            print(title, flush=True)
        target.at(config.reward.height, config.reward.width)
        if target.real:
            print(title, flush=True)
        ((_, own),) = answer
        plain[FIELD] = dict(own)
        with folder.opened(config.out, plain, free=FREE_FIELDS, packages=PACKAGES):
            evaluations, finals = (Log(config.out / name) for name in LOGS)
            run = Run(config, target, workers, evaluations, finals, store, Progress(1.0), own)
            try:
                yield run
            finally:
                run.progress.close()
