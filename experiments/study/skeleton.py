"""A job from start to report: check, open, plan, work, write. The main job and all studies are one of these.

STUDY = Study(FORM, plan, scores, check)
report = do(STUDY, config)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic

from experiments.config import LearntConfig, SearchConfig, read_attributes
from experiments.config import check as check_flags
from experiments.limits import refuse_too_large
from experiments.run.context import AnyConfig, Run, Work, opened
from experiments.run.learn import judged_on, learn, work_of
from experiments.study.form import Form, Report, rewrite, write_report
from experiments.target.base import Target
from scene.proposal import Streets, streets_named
from shell.progress import duration


def nothing(config: Any) -> None:
    """No checks beyond those of all jobs."""


def none(config: Any, target: Target) -> None:
    """Nothing to be prepared."""


@dataclass(frozen=True)
class Study(Generic[AnyConfig]):
    """What makes one job different from the others."""

    form: Form
    """Of its report."""
    plan: Callable[[AnyConfig], list[Work]]
    """The nets that it trains."""
    scores: Callable[[Run[AnyConfig], Any], Report]
    """Does the work, or what is left of it; is given what ``prepare`` made. Raises UserError, WorkerError."""
    check: Callable[[AnyConfig], None] = nothing
    """Raises UserError for a field that only this job has and that is out of range, by flag."""
    prepare: Callable[[AnyConfig, Target], Any] = none
    """Made before the folder is; raises UserError or DataError for what cannot be done on this target."""


def do(study: Study[AnyConfig], config: AnyConfig) -> Report:
    """Do a whole job, or what is left of it, and return its report; with ``--rederive`` only write that.

    Raises:
        UserError, DataError: what a user can get wrong.
        WorkerError: worker processes keep dying.
    """
    rederive: Path | None = getattr(config, "rederive", None)
    if rederive is not None:
        report = rewrite(study.form, rederive, config.out)
        print(study.form.text(report), flush=True)
        return report
    check(study, config)
    made: list[Any] = []

    def prepare(target: Target) -> None:
        if isinstance(config, SearchConfig):
            judged_on(target, config)
        made.append(study.prepare(config, target))

    with opened(config, prepare) as run:
        run.begin(study.plan(config))
        report = write_report(study.form, study.scores(run, made[0]), config.out)
        share = run.workers.cpu_share()
        run.progress.say(study.form.text(report))
        if share is not None:
            run.progress.say(f"Busy: {100 * share:.0f} % of {max(config.workers, 1)} core(s)")
        note = "" if run.target.real else f" (the {run.target.name}, not real data)"
        file = config.out / f"{study.form.name}.json"
        run.progress.say(f"Done in {duration(run.progress.elapsed)}{note}: {file}")
        return report


def check(study: Study[AnyConfig], config: AnyConfig) -> None:
    """Raise UserError for a configuration that the job cannot work with, by flag."""
    refuse_too_large(config)
    check_flags(config)
    if isinstance(config, LearntConfig) and config.learnt is not None:
        read_attributes("--learnt", config.learnt, config.space)
    study.check(config)


def learnt_work(config: LearntConfig) -> list[Work]:
    """What `learnt_attributes` trains."""
    return [] if config.learnt is not None else work_of(config)


def learnt_attributes(run: Run[Any]) -> Streets:
    """The attributes learnt for this target: from ``--learnt``, else by search, as the main job does.

    A run of the main job with the same flags and the same ``--store`` gives the same, and what one of them
    has scored, the other does not score again.

    Raises:
        UserError: ``--learnt`` is no attributes.json.
    """
    config: LearntConfig = run.config
    if config.learnt is None:
        return learn(run).streets
    return read_attributes("--learnt", config.learnt, config.space)


def attributes(run: Run[Any], name: str) -> Streets:
    """From which streets are drawn: by a name that `streets_named` knows, or ``learnt``."""
    if name == "learnt":
        return learnt_attributes(run)
    return streets_named(name, run.config.space, run.config.default_width)


def learnt_from(config: LearntConfig) -> str:
    """Where learnt attributes are from, for reports."""
    return "a search of this run" if config.learnt is None else str(config.learnt)
