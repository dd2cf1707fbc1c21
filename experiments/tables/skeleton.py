"""A study from start to report: check, open, plan, work, write. The main job is a study, too.

    STUDY = Study(FORM, plan, scores, check)     # does its own work
    STUDY = of_rows(FORM, rows, report, check)   # trains the nets of rows
    report = do(STUDY, config)

A study of rows gives each `Row` its training set, its fidelity, and the search that it waits for. From these
follow the plan with its cost, the order of the nets (those that wait for nothing fill the gaps of the
searches), the paired seeds, and the scores of every net; a stopped job continues from its folder. The `Form`
of its report derives from the scores means and gains (`tables.stats`), the table as a list of columns
(`tables.form`) and the figure (`studies.figure`), so that ``--rederive`` needs no net.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple

from common.progress import duration
from common.workers.pool import Workers
from experiments import session
from experiments.attribute_search.learn import learn, work_of
from experiments.config import Fidelity, LearntConfig, Rederived, read_attributes
from experiments.config import check as check_flags
from experiments.evaluation.job import Job, Result, Source
from experiments.session.session import AnyConfig, Session, Work, set_up_process
from experiments.tables.form import Form, Report, about, nets, rewrite, write_report
from experiments.tables.nets import paired_seeds
from experiments.targets.base import Target
from experiments.targets.named import named_target
from scene.held import hold
from scene.proposal import Streets, streets_named


def nothing(config: Any) -> None:
    """No checks beyond those of all jobs."""


def none(config: Any, target: Target) -> None:
    """Prepare nothing."""


@dataclass(frozen=True)
class Study(Generic[AnyConfig]):
    """The parts in which jobs differ."""

    form: Form
    """The form of its report."""
    plan: Callable[[AnyConfig, Any], list[Work]]
    """Plans its nets; takes the result of ``prepare``, as ``scores`` does."""
    scores: Callable[[Session[AnyConfig], Any], Report]
    """Does the work, or the rest of it. Raises UserError, WorkerError."""
    check: Callable[[AnyConfig], None] = nothing
    """Raises UserError with the flag for a field of this job alone that is out of range."""
    prepare: Callable[[AnyConfig, Target], Any] = none
    """Runs before the folder is made; raises UserError or DataError if the job does not fit this target."""
    target: Callable[[AnyConfig, Workers], Target] = named_target
    """Finds the target; raises UserError or DataError."""


def do(study: Study[AnyConfig], config: AnyConfig) -> Report:
    """Do a whole job, or the rest of it, and return its report; with ``--rederive`` only derive that.

    Raises:
        UserError, DataError: errors of the user.
        WorkerError: worker processes keep dying.
    """
    if isinstance(config, Rederived) and config.rederive is not None:
        report = rewrite(study.form, config.rederive, config.out)
        print(study.form.text(report), flush=True)
        return report
    set_up_process()  # checks of search methods start JAX
    check(study, config)
    made: list[Any] = []

    def prepare(target: Target) -> None:
        made.append(study.prepare(config, target))

    with session.open(config, prepare, study.target) as run:
        run.begin(study.plan(config, made[0]))
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
    """Raise UserError with the flag for a configuration that the job cannot use."""
    check_flags(config)
    if isinstance(config, LearntConfig) and config.learnt is not None:
        read_attributes("--learnt", config.learnt, config.space)
    study.check(config)


Made = Mapping[str, Any]
"""The results of a study's searches by name."""
Search = Callable[[Session[Any]], Any]
"""Does one search, or the rest of it."""


class Row(NamedTuple):
    """One row of a study's table: a net for each seed, trained in the same way."""

    place: Report
    """Fields that identify it in the report."""
    source: Callable[[Session[Any], Made, int], Source]
    """Gives the training set of a seed's net."""
    fidelity: Fidelity
    what: str
    """The kind of its nets in the run folder, in words. Rows of one kind train one after the other."""
    name: str
    """The name of the row in the run folder."""
    after: str = ""
    """The search that it waits for, if any."""
    real: bool = False
    """Whether its images need no rendering."""
    pool: Mapping[str, Any] = {}
    """Its changes of fields of the pool of assets."""
    order: tuple[int, ...] = ()
    """Rows of a seed train in this order; a worker keeps the rendered dataset of the row before."""


def of_rows(
    form: Form,
    rows: Callable[[AnyConfig, Target], Sequence[Row]],
    report: Callable[[Session[AnyConfig], Made, list[Report]], Report],
    check: Callable[[AnyConfig], None] = nothing,
    searches: Callable[[AnyConfig], Mapping[str, Search]] | None = None,
    work: Callable[[AnyConfig], list[Work]] | None = None,
) -> Study[AnyConfig]:
    """Make a study of rows.

    Args:
        form: the form of its report.
        rows: gives the rows. Raises UserError or DataError if the study does not fit this target.
        report: gives the report's fields beside the common ones, from the results of the searches and the
            place of every row with its ``nets``.
        check: as in `Study`.
        searches: searches by name in order; by default attributes are learnt if a row waits for them.
        work: plans the nets of the searches; without any, no row fills their gaps.
    """

    def learns(own: Sequence[Row]) -> bool:
        return any(row.after == LEARNT for row in own)

    def searched(config: Any, own: Sequence[Row]) -> list[Work]:
        if work is None:
            return learnt_work(config) if learns(own) else []
        return work(config)

    def plan(config: Any, own: Sequence[Row]) -> list[Work]:
        return [*searched(config, own), *_planned(own, config.seeds)]

    def scores(run: Session[Any], own: Sequence[Row]) -> Report:
        made: dict[str, Any] = {}
        wanted = {LEARNT: learnt_attributes} if learns(own) else {}
        for name, search in (wanted if searches is None else searches(run.config)).items():
            if searched(run.config, own):
                ready = [row for row in own if not row.real]
                run.runner.prefetch([job for _, job in _jobs(run, ready, made)])
            made[name] = search(run)
        rows_of, jobs = zip(*_jobs(run, own, made), strict=True) if own else ((), ())
        results: dict[int, list[Result]] = {id(row): [] for row in own}
        for row, result in zip(rows_of, run.runner.test(jobs), strict=True):
            results[id(row)].append(result)
        told = [{**row.place, "nets": nets(results[id(row)])} for row in own]
        return {**about(run, run.config.final), **report(run, made, told)}

    return Study(form, plan, scores, check, rows)


def _planned(rows: Sequence[Row], seeds: int) -> Iterator[Work]:
    """Plan the nets of all rows by fidelity and need of rendering."""
    kinds = [(row.fidelity, row.real) for row in rows]
    for fidelity, real in dict.fromkeys(kinds):
        count = kinds.count((fidelity, real))
        what = "images alone" if real else "rendered images"
        work = Work.on_images if real else Work.at
        yield work(f"nets on {what}, {count} rows x {seeds} seeds", count * seeds, fidelity)


def _jobs(run: Session[Any], rows: Sequence[Row], made: Made) -> Iterator[tuple[Row, Job]]:
    """The jobs of all rows that no longer wait for a search."""
    ready = [row for row in rows if not row.after or row.after in made]
    for what in dict.fromkeys(row.what for row in ready):
        own = sorted((row for row in ready if row.what == what), key=lambda row: row.order)
        for seed in paired_seeds(run):
            for row in own:
                recipe = run.recipe(row.fidelity, **row.pool)
                notes = {"nets": what, "row": row.name, "seed": seed}
                yield row, Job(recipe, row.source(run, made, seed), seed, notes)


LEARNT = "learnt"
"""The name of the search for attributes, and of the row that waits for it."""


def learnt_work(config: LearntConfig) -> list[Work]:
    """Plan the nets of `learnt_attributes`."""
    return [] if config.learnt is not None else work_of(config)


def learnt_attributes(run: Session[Any]) -> Streets:
    """The attributes learnt for this target: from ``--learnt``, otherwise by the search of the main job.

    A run of the main job with the same flags gives the same; with the same ``--store`` neither repeats
    evaluations of the other.

    Raises:
        UserError: ``--learnt`` is no attributes.json.
    """
    config: LearntConfig = run.config
    if config.learnt is None:
        return learn(run).solution
    return hold(read_attributes("--learnt", config.learnt, config.space), config.held)


def attributes(run: Session[Any], made: Made, name: str) -> Streets:
    """The attributes of streets by a name that `streets_named` knows, or those of ``learnt``."""
    config = run.config
    return made.get(name) or hold(
        streets_named(name, config.space, config.default_width), config.held
    )


def learnt_from(config: LearntConfig) -> str:
    """The origin of learnt attributes, for reports."""
    return "a search of this run" if config.learnt is None else str(config.learnt)
