"""Sensitivity from start to report: records that are there, those that are missing, the figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

import sdr_jax
from experiments import config as run_config
from experiments import study_report
from experiments.errors import UserError
from experiments.evaluator import about
from experiments.finals import draw_units
from experiments.folder import RunFolder, refuse_foreign
from experiments.keys import evaluation_key
from experiments.main import main_on_target
from experiments.outcome import Outcome
from experiments.reward import evaluate
from experiments.search import make_space
from experiments.sensitivity_records import Records, choose, read
from experiments.sensitivity_report import FORM, summarize
from experiments.study import Study, Work, opened
from experiments.study_config import TargetConfig, defaults_on
from experiments.study_nets import score_proposals

SENSITIVITY_SEED = 20_000_000
"""Seeds begin here, above those of runs, ladders and the measurement of fidelity."""
LEAST = 8
"""Rewards that a model is fitted to."""


@dataclass(frozen=True, kw_only=True)
class SensitivityConfig(TargetConfig):
    """One analysis. Every field is a flag.

    What belongs to a search and to final nets has no effect here, but for --search.bins and
    --search.relaxation, from which attributes are drawn.
    """

    records: tuple[Path, ...] = ()
    """Stores of evaluations, folders that have one, or lines of bins and rewards; nothing is rendered."""
    records_config: str | None = None
    """Which configuration in them, by the name that experiments.store show prints; by default the one
    with the most rewards."""
    evaluations: int = 128
    """Without --records: rewards that the store must hold; the missing ones are of random attributes."""


def sensitivity_config(target: str, preset: str) -> SensitivityConfig:
    """The defaults of ``python -m experiments.sensitivity``."""
    config = defaults_on(SensitivityConfig, target, preset)
    if preset == "smoke":
        return replace(config, evaluations=12)
    if preset == "paper":
        return replace(config, evaluations=300)
    return config


def check(config: SensitivityConfig) -> None:
    """Raise UserError for a field out of range, by name."""
    run_config.check(config)
    if config.reward_kind != "miou":
        raise UserError("--reward-kind: sensitivity knows miou only")
    if config.evaluations < LEAST:
        raise UserError(f"--evaluations must be {LEAST} or more, not {config.evaluations}")
    if config.records_config is not None and not config.records:
        raise UserError("--records-config needs --records")
    width = config.search.relaxation
    if width is not None and not 0 <= width <= 1:
        raise UserError(f"--search.relaxation must lie in [0, 1], not {width}")


def run(config: SensitivityConfig) -> dict[str, Any]:
    """Analyse, and return what ``sensitivity.json`` holds.

    Raises:
        UserError, DataError: what a user can get wrong.
        WorkerError: worker processes keep dying.
    """
    check(config)
    if not config.records:
        with opened(config) as study:
            records = enough(record(study), str(study.store.path))
            return _report(config, study.target.real, study.target.title, records)
    where = ", ".join(map(str, config.records))
    records = enough(read(config.records, config, config.target, config.records_config), where)
    refuse_foreign(config, config.target)
    real = config.target != "twin"
    words = config.target if real else "the twin, NOT real data"
    folder = RunFolder(config, config.target)
    try:
        return _report(config, real, f"{words}, recorded in {where}", records)
    finally:
        folder.close()


def _report(config: SensitivityConfig, real: bool, note: str, records: Records) -> dict[str, Any]:
    said = {"target": config.target, "real": real, "note": note, "preset": config.preset}
    report = study_report.write(FORM, {**said, **summarize(records)}, config.out)
    print(f"{FORM.text(report)}\n{config.out / 'sensitivity.md'}", flush=True)
    return report


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


def proposals(config: SensitivityConfig) -> list[sdr_jax.Proposal]:
    """Proposals f32[23] with random bins for all attributes; more evaluations only add some."""
    rng = np.random.default_rng(config.seed)
    space = make_space(config)
    actions = rng.integers(0, config.search.bins, (config.evaluations, space.attributes))
    relaxed = jax.device_get(sdr_jax.relax(space, actions, config.search.relaxation))
    return [sdr_jax.Proposal(*pair) for pair in zip(*relaxed, strict=True)]


def record(study: Study[SensitivityConfig]) -> Records:
    """The store's rewards at the reward's stage, after making those that are missing."""
    config, store, stage = study.config, study.store, study.config.reward
    truth = study.truth(stage, "reward")
    own = about(config, stage, study.target, "reward", truth)["config"]
    first = SENSITIVITY_SEED + config.seed
    drawn = [(proposal, first + k) for k, proposal in enumerate(proposals(config))]
    missing = [
        (proposal, seed)
        for proposal, seed in drawn
        if store.get(evaluation_key(own, draw_units(proposal, seed, stage.streets), seed)) is None
    ]
    # Rewards that other runs have made at this stage count, too.
    known = sum(r["config"] == own and r["reward"] is not None for r in store.records)
    wanted = missing[: max(config.evaluations - known, 0)]
    progress = study.begin([Work.at("rewards of random attributes", len(wanted), stage)])
    evaluator = study.evaluator(stage, "reward")

    def said(index: int, outcome: Outcome) -> str:
        value = "failed" if outcome.failed else f"mIoU {100 * outcome.reward:.1f}"
        return f"reward {index + 1}/{len(wanted)} | {value}"

    score_proposals(evaluator, evaluate, wanted, stage, progress, said)
    return choose(store.records, study.target.name, own, str(store.path))


def main(description: str, arguments: Sequence[str] | None = None) -> int:
    """Parse, run, and turn what went wrong into one line. Returns the exit code."""
    return main_on_target("sensitivity", sensitivity_config, run, description, arguments)
