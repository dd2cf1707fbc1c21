"""What every experiment on a named target begins with: target, workers, store, folder, attributes.

    with opened(config) as study:
        plan = [*search_work(config), Work.at("nets", count, config.final)]
        progress = study.begin(plan)
        learnt = learnt_attributes(study, progress)

A study that is started again does what is left: rewards and rendered nets come from the store, the
others from the run folder.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Generic, NamedTuple, TypeVar

import sdr_jax
from experiments import summary
from experiments.config import Config, Stage
from experiments.errors import UserError
from experiments.evaluator import Evaluator, Side
from experiments.finals import Finals, candidate_proposal
from experiments.folder import RunFolder, refuse_foreign, write_json
from experiments.ladder import cost_of, ladder, most_nets
from experiments.mmd_reward import feature_net
from experiments.progress import Progress
from experiments.reward import Truth, worker_environment
from experiments.search import search, total_updates
from experiments.store import FILE, Store
from experiments.study_config import StudyConfig, TargetConfig, read_learnt
from experiments.targets import Target, named_target
from scene.command import duration
from scene.render import RendererError, renderer
from scene.workers import WorkerPool

AnyTarget = TypeVar("AnyTarget", bound=TargetConfig)


class Work(NamedTuple):
    """Nets of one kind that a study trains."""

    what: str  # such as "rewards of the search"
    nets: int
    stage: Stage
    seconds: float  # of a CPU, each, about

    @classmethod
    def at(cls, what: str, nets: int, stage: Stage) -> Work:
        """Nets that are trained on a rendered dataset of the stage."""
        return cls(what, nets, stage, cost_of(stage))

    @property
    def cost(self) -> float:
        """Of all of it, in the units of ``cost_of``."""
        return self.nets * self.seconds


class Study(NamedTuple, Generic[AnyTarget]):
    """One study under way."""

    config: AnyTarget
    target: Target
    workers: WorkerPool
    store: Store  # of the run folder, unless ``--store`` names another
    folder: RunFolder

    def progress(self, total: float) -> Progress:
        """Progress through so much work, in the units of ``cost_of``."""
        return Progress(total, label="" if self.target.real else "twin, not real | ")

    def truth(self, stage: Stage, side: Side) -> Truth:
        """The target's labelled images of a side, at the stage's size."""
        images = getattr(self.target.at(stage.height, stage.width), side)
        return Truth(images.images, images.labels)

    def evaluator(self, stage: Stage, side: Side) -> Evaluator:
        """Scores nets at a stage on the images of a side."""
        truth = self.truth(stage, side)
        return Evaluator(self.config, stage, self.target, side, truth, self.workers, self.store)

    def begin(self, plan: Sequence[Work]) -> Progress:
        """Say what is about to be done and how long it takes, and count it from here."""
        progress = self.progress(sum(work.cost for work in plan))
        progress.say(plan_text(plan, self.config.workers))
        progress.say(f"Folder: {self.config.out} | {self.store.path} holds {len(self.store)}")
        return progress


@contextmanager
def opened(
    config: AnyTarget, refuse: Callable[[Target], None] | None = None
) -> Iterator[Study[AnyTarget]]:
    """Open all that a study works with; close it afterwards.

    Args:
        config: the run, its fields checked.
        refuse: raises UserError for what cannot be done on this target. Whatever the user got wrong
            shows before the folder is made.

    Raises:
        UserError, DataError: what a user can get wrong.
    """
    check_renderer(config.renderer)
    with WorkerPool(config.workers, worker_environment()) as workers:
        target = named_target(config.target, config, workers)
        refuse_foreign(config, target.name)
        if refuse is not None:
            refuse(target)
        store = Store(config.store or config.out / FILE)
        print(f"Target: {target.title}", flush=True)
        target.at(config.reward.height, config.reward.width)
        folder = RunFolder(config, target.name)
        try:
            yield Study(config, target, workers, store, folder)
        finally:
            folder.close()


def check_renderer(name: str) -> None:
    """Raise UserError if this machine cannot render with it."""
    try:
        renderer(name)
    except RendererError as error:
        raise UserError(str(error)) from None


def plan_text(plan: Sequence[Work], workers: int) -> str:
    """What is to be done, one line a kind, and how long all of it takes, about."""
    lines = ["Plan, in CPU seconds:"]
    for what, nets, stage, seconds in plan:
        size = f"{stage.width}x{stage.height}, {stage.images} images, {stage.train.steps} steps"
        lines.append(f"  {nets:5d} x {seconds:6.1f}  {what} ({stage.train.net}, {size})")
    total = duration(sum(work.cost for work in plan) / max(workers, 1))
    lines.append(
        f"About {total} on {max(workers, 1)} worker(s), without compiling; what is known takes no time"
    )
    return "\n".join(lines)


def search_work(config: StudyConfig) -> list[Work]:
    """What `learnt_attributes` trains."""
    if config.learnt is not None:
        return []
    rewards = total_updates(config) * config.search.datasets_per_update
    work = [Work.at("rewards of the search", rewards, config.reward)]
    candidates = len(config.candidates)
    if not config.ladder:
        nets = candidates * config.candidate_seeds
        return [*work, Work.at("nets of candidates", nets, config.final)]
    rungs = ladder(config)
    return work + [
        Work.at(f"nets of candidates at most, rung {number}", nets, rung.stage)
        for number, (nets, rung) in enumerate(
            zip(most_nets(candidates, rungs), rungs, strict=True), start=1
        )
    ]


def learnt_attributes(study: Study[Any], progress: Progress) -> sdr_jax.Proposal:
    """The attributes learnt for this target: from ``--learnt``, else by search, as the main job does.

    A run of ``experiments.camvid`` with the same flags and the same ``--store`` gives the same, and what
    one of them has scored, the other does not score again. What was learnt is left in
    ``attributes.json``.

    Args:
        study: its configuration is a `StudyConfig`.
        progress: told about every net of `search_work`.

    Raises:
        UserError: ``--learnt`` is no attributes.json.
    """
    config: Config = study.config
    if study.config.learnt is not None:
        return read_learnt(study.config.learnt)
    target, folder, workers = study.target, study.folder, study.workers
    net = None
    if config.reward_kind == "mmd":
        net = feature_net(config, target.table, folder.path, workers)
    images = target.at(config.reward.height, config.reward.width).reward
    truth = net.reference(images.images) if net else Truth(images.images, images.labels)
    cost = cost_of(config.reward)
    result = search(config, target, truth, folder, workers, progress, cost, study.store)
    split = target.at(config.final.height, config.final.width)
    cost = cost_of(config.final)
    finals = Finals(config, target, split, folder, workers, progress, cost, study.store, net)
    chosen, _ = finals.candidates(result)
    learnt = candidate_proposal(chosen, result)
    write_json(folder.path / "attributes.json", summary.attributes(learnt))
    return learnt
