"""A study from start to report: check, open, plan, work, write. The main job is also a study.

    STUDY = Study(FORM, plan, scores, check)     # does its own work
    STUDY = of_rows(FORM, rows, report, check)   # trains the networks of rows
    report = do(STUDY, config)

A study of rows gives each `Row` its training set, its fidelity, and the search that it waits for. The rest
follows from these: the plan with its cost, the order of the networks (those that wait for nothing fill the
gaps of the searches), the paired seeds, and the scores of every network. A stopped job resumes from its
folder. The `Form` of its report derives means and gains from the scores (`tables.stats`), the table as a list
of columns (`tables.form`) and the plot (`studies.figure`), so that ``--rederive`` trains no network.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple

from common.command import say
from common.errors import counted
from common.progress import duration
from common.workers.pool import Workers
from experiments import session
from experiments.attribute_search.loop import learn
from experiments.attribute_search.plans import plan_of, work_of
from experiments.config import Fidelity, LearntConfig, Rederived, read_attributes
from experiments.config import check as check_flags
from experiments.evaluation.job import Job, Result, Source
from experiments.session.session import AnyConfig, Session, Work, set_up_process
from experiments.tables.form import Form, Report, about, nets, rewrite, write_report
from experiments.tables.nets import paired_seeds
from experiments.targets.base import Target
from experiments.targets.named import named_target
from scene.held import hold
from scene.proposal import Streets


@dataclass(frozen=True)
class Study(Generic[AnyConfig]):
    """The parts in which jobs differ."""

    form: Form
    """The form of its report."""
    plan: Callable[[AnyConfig, Any], list[Work]]
    """Plans its networks; takes the result of ``prepare``, as ``scores`` does."""
    scores: Callable[[Session[AnyConfig], Any], Report]
    """Does the work, or the rest of it. Raises UserError, WorkerError."""
    check: Callable[[AnyConfig], None] = lambda config: None
    """Raises UserError with the flag for a field that only this job refuses."""
    prepare: Callable[[AnyConfig, Target], Any] = lambda config, target: None
    """Runs before the folder is made; raises UserError or DataError if the job does not fit this target."""
    target: Callable[[AnyConfig, Workers], Target] = named_target
    """Finds the target; raises UserError or DataError."""

    def __call__(self, config: AnyConfig) -> Report:
        """Do the whole job, as `do`."""
        return do(self, config)


def do(study: Study[AnyConfig], config: AnyConfig) -> Report:
    """Do a whole job, or the rest of it, and return its report; with ``--rederive`` only derive the report.

    Raises:
        UserError, DataError: errors of the user.
        WorkerError: worker processes keep dying.
    """
    if isinstance(config, Rederived) and config.rederive is not None:
        report = rewrite(study.form, config.rederive, config.out)
        say(study.form.text(report))
        return report
    set_up_process()  # checks of search methods start JAX
    check(study, config)
    prepared: list[Any] = []

    def prepare(target: Target) -> None:
        prepared.append(study.prepare(config, target))

    with session.open(config, prepare, study.target) as run:
        run.begin(study.plan(config, prepared[0]))
        report = write_report(study.form, study.scores(run, prepared[0]), config.out)
        share = run.workers.cpu_share()
        run.progress.say(study.form.text(report))
        if share is not None:
            run.progress.say(
                f"CPU use: {100 * share:.0f} % of {counted(run.workers.processes, 'core')}"
            )
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


Answers = Mapping[str, Any]
"""The results of a study's searches by name."""
Search = Callable[[Session[Any]], Any]
"""Does one search, or the rest of it."""


class Row(NamedTuple):
    """One row of a study's table: a network for each seed, trained in the same way."""

    place: Report
    """Fields that identify it in the report."""
    source: Callable[[Session[Any], Answers, int], Source]
    """Makes the training set of a seed's network."""
    fidelity: Fidelity
    what: str
    """The kind of its networks in the run folder, in words. Rows of one kind train one after the other."""
    name: str
    """The name of the row in the run folder."""
    after: str = ""
    """The search that it waits for, if any."""
    real: bool = False
    """Whether its images need no rendering."""
    pool: Mapping[str, Any] = {}
    """Fields of the pool of assets to change."""
    order: tuple[int, ...] = ()
    """Rows of a seed train in this order; a worker keeps the rendered dataset of the previous row."""


def of_rows(
    form: Form,
    rows: Callable[[AnyConfig, Target], Sequence[Row]],
    report: Callable[[Session[AnyConfig], Answers, list[Report]], Report],
    check: Callable[[AnyConfig], None] = lambda config: None,
    searches: Callable[[AnyConfig], Mapping[str, Search]] | None = None,
    work: Callable[[AnyConfig], list[Work]] | None = None,
) -> Study[AnyConfig]:
    """Make a study of rows.

    Args:
        form: the form of its report.
        rows: makes the rows. Raises UserError or DataError if the study does not fit this target.
        report: makes the report's fields in addition to the common ones, from the results of the searches and
            the place of every row with its ``nets``.
        check: as in `Study`.
        searches: searches by name in order; by default one for optimised streets if a row waits for it.
        work: plans the networks of the searches; without any, no row fills their gaps.
    """

    def optimises(study_rows: Sequence[Row]) -> bool:
        return any(row.after == LEARNT for row in study_rows)

    def search_work(config: Any, study_rows: Sequence[Row]) -> list[Work]:
        if work is None:
            return learnt_work(config) if optimises(study_rows) else []
        return work(config)

    def plan(config: Any, study_rows: Sequence[Row]) -> list[Work]:
        return [*search_work(config, study_rows), *_row_work(study_rows, config.seeds)]

    def scores(run: Session[Any], study_rows: Sequence[Row]) -> Report:
        answers: dict[str, Any] = {}
        default = {LEARNT: learnt_attributes} if optimises(study_rows) else {}
        for name, search in (default if searches is None else searches(run.config)).items():
            if search_work(run.config, study_rows):
                rendered = [row for row in study_rows if not row.real]
                run.runner.prefetch([job for _, job in _jobs(run, rendered, answers)])
            answers[name] = search(run)
        job_rows, jobs = (
            zip(*_jobs(run, study_rows, answers), strict=True) if study_rows else ((), ())
        )
        results: dict[int, list[Result]] = {id(row): [] for row in study_rows}
        for row, result in zip(job_rows, run.runner.test(jobs), strict=True):
            results[id(row)].append(result)
        scored = [{**row.place, "nets": nets(results[id(row)])} for row in study_rows]
        return {**about(run, run.config.final), **report(run, answers, scored)}

    return Study(form, plan, scores, check, rows)


def _row_work(rows: Sequence[Row], seeds: int) -> Iterator[Work]:
    """Plan the networks of all rows by fidelity and need of rendering."""
    kinds = [(row.fidelity, row.real) for row in rows]
    for fidelity, real in dict.fromkeys(kinds):
        count = kinds.count((fidelity, real))
        what = "images alone" if real else "rendered images"
        work = Work.on_images if real else Work.at
        yield work(f"networks on {what}, {count} rows x {seeds} seeds", count * seeds, fidelity)


def _jobs(run: Session[Any], rows: Sequence[Row], answers: Answers) -> Iterator[tuple[Row, Job]]:
    """Make the jobs of all rows that no longer wait for a search."""
    ready = [row for row in rows if not row.after or row.after in answers]
    for what in dict.fromkeys(row.what for row in ready):
        same_kind = sorted((row for row in ready if row.what == what), key=lambda row: row.order)
        for seed in paired_seeds(run):
            for row in same_kind:
                recipe = run.recipe(row.fidelity, **row.pool)
                notes = {"nets": what, "row": row.name, "seed": seed}
                yield row, Job(recipe, row.source(run, answers, seed), seed, notes)


LEARNT = "learnt"
"""The name of the search for streets, and of the row that waits for it."""


def learnt_work(config: LearntConfig) -> list[Work]:
    """Plan the networks of `learnt_attributes`."""
    return [] if config.learnt is not None else [work_of(config, [plan_of(config)])]


def learnt_attributes(run: Session[Any]) -> Streets:
    """Optimise the attributes for this target: read ``--learnt``, or do the search of the main job.

    A run of the main job with the same flags gives the same; with the same ``--store`` neither repeats
    evaluations of the other.

    Raises:
        UserError: ``--learnt`` is not an attributes.json.
    """
    config: LearntConfig = run.config
    if config.learnt is None:
        return learn(run).solution
    return hold(read_attributes("--learnt", config.learnt, config.space), config.held)


def attributes(run: Session[Any], answers: Answers, name: str) -> Streets:
    """Return the attributes of streets by a name that `streets_named` knows, or those of ``learnt``."""
    return answers.get(name) or run.config.streets(name)


def learnt_from(config: LearntConfig) -> str:
    """Name the origin of optimised streets, for reports."""
    return "a search of this run" if config.learnt is None else str(config.learnt)
