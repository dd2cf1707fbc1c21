"""Sensitivity from start to report: records that are there, those that are missing, the figures."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments import presets
from experiments.config import Bins, Config, Preset, Rederived, TargetName
from experiments.reward.evaluator import Job
from experiments.reward.miou import Outcome
from experiments.run.context import FREE_FIELDS, PACKAGES, Run, Work, refuse_failed, verdict
from experiments.run.ladder import cost_of
from experiments.sensitivity.records import Records, choose, read
from experiments.sensitivity.report import FORM, summarize
from experiments.study.bins import random_bins
from experiments.study.form import Report, write_report
from experiments.study.skeleton import Study, do
from experiments.study.skeleton import check as check_all
from scene.version import ENGINE
from shell import folder
from shell.errors import UserError

SENSITIVITY_SEED = 20_000_000
"""Seeds begin here, above those of a run's rows and of the measurement of fidelity."""
LEAST = 8
"""Rewards that a model is fitted to."""


@dataclass(frozen=True, kw_only=True)
class SensitivityConfig(Config, Rederived):
    """One analysis. Every field is a flag."""

    search: Bins
    records: tuple[Path, ...] = ()
    """Stores of evaluations, run folders, or lines of bins and rewards; nothing is rendered."""
    records_config: str | None = None
    """Which configuration in them, by the name that experiments.store show prints; by default the one
    with the most rewards."""
    evaluations: int = 128
    """Without --records: rewards that there must be, those in --store included; the missing ones are of
    random attributes."""


def defaults(target: TargetName, preset: Preset) -> SensitivityConfig:
    """The defaults of ``python -m experiments.sensitivity``."""
    evaluations = {"smoke": 12, "quick": 128, "paper": 300}[preset]
    return presets.defaults(SensitivityConfig, target, preset, evaluations=evaluations)


def check(config: SensitivityConfig) -> None:
    """Raise UserError for a field out of range, by flag."""
    if config.evaluations < LEAST:
        raise UserError(f"--evaluations must be {LEAST} or more, not {config.evaluations}")
    if config.records_config is not None and not config.records:
        raise UserError("--records-config needs --records")


def analyse(config: SensitivityConfig) -> Report:
    """Do the whole study; with ``--records`` from these alone, without a target or workers.

    Raises:
        UserError, DataError: what a user can get wrong.
        WorkerError: worker processes keep dying.
    """
    if not config.records or config.rederive is not None:
        return do(STUDY, config)
    check_all(STUDY, config)
    where = ", ".join(map(str, config.records))
    records = enough(read(config.records, config, config.target_name, config.records_config), where)
    real = config.target != "twin"
    words = config.target if real else f"the {config.target_name}, NOT real data"
    plain = {"engine": ENGINE, **asdict(config)}
    with folder.opened(config.out, plain, free=FREE_FIELDS, packages=PACKAGES):
        told = _report(config, real, f"{words}, recorded in {where}", records)
        report = write_report(FORM, told, config.out)
    print(f"{FORM.text(report)}\n{config.out / 'sensitivity.md'}", flush=True)
    return report


def _report(config: SensitivityConfig, real: bool, note: str, records: Records) -> Report:
    said = {"target": config.target_name, "real": real, "note": note, "preset": config.preset}
    return {**said, **summarize(records)}


def enough(records: Records, where: str) -> Records:
    """The records themselves.

    Raises:
        UserError: there are too few to fit a model, or they are all the same.
    """
    rows = np.concatenate([records.centre, records.width], axis=1)
    different = len(np.unique(rows, axis=0))
    if different < LEAST:
        raise UserError(
            f"{where} holds rewards of {different} proposals; {LEAST} are the least to fit a model to"
        )
    if np.ptp(records.rewards) == 0:
        raise UserError(f"{where}: all {len(rows)} rewards are equal, so no attribute matters")
    return records


def plan(config: SensitivityConfig, _: Any = None) -> list[Work]:
    """At most all rewards; those that the store has need not be made."""
    return [Work.at("rewards of random attributes at most", config.evaluations, config.reward)]


def scores(run: Run[SensitivityConfig], _: Any) -> Report:
    """Make the rewards that are missing, and analyse all that there are."""
    records = enough(record(run), str(run.config.out if run.store is None else run.store.path))
    return _report(run.config, run.target.real, run.target.title, records)


def record(run: Run[SensitivityConfig]) -> Records:
    """All rewards at the reward's fidelity in the run's store and folder, once none is missing."""
    config = run.config
    evaluator = run.evaluator(run.recipe(config.reward))
    own, first = evaluator.about["config"], SENSITIVITY_SEED + config.seed
    cost = cost_of(config.reward)
    jobs = [
        Job(proposal, first + k, {"nets": "sensitivity"}, cost)
        for k, proposal in enumerate(random_bins(config, config.evaluations))
    ]
    # Rewards that other runs have made at this fidelity count, too.
    drawn = {evaluator.key(job.source, job.seed) for job in jobs}
    others = sum(
        line["config"] == own and None not in (line["reward"], line["centre"])
        for key, line in _known(run).items()
        if key not in drawn
    )
    wanted = jobs[: max(config.evaluations - others, 0)]
    run.progress.advance(cost * (len(jobs) - len(wanted)), replayed=True)

    def said(index: int, outcome: Outcome) -> str:
        return f"reward {index + 1}/{len(wanted)} | {verdict(outcome)}"

    outcomes = run.score([(evaluator, job) for job in wanted], log=run.finals, say=said)
    refuse_failed(outcomes, len(wanted))
    return choose(_known(run).values(), run.target.name, config.space, own, str(config.out))


def _known(run: Run[SensitivityConfig]) -> dict[str, dict[str, Any]]:
    """Evaluations by key: the store's and the run's own."""
    stored = [] if run.store is None else run.store.records
    return {line["key"]: line for line in (*stored, *run.finals.records)}


STUDY = Study(FORM, plan, scores, check)
