"""A few labelled images beside every training set, and the rows that they add."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from experiments.config import Fidelity
from experiments.evaluation.job import Source
from experiments.session.session import Session
from experiments.tables.form import Report
from experiments.tables.stats import statistics

FEW = "few"
"""The row of nets that are trained on the few images alone; ``few+ROW`` adds the images of ROW."""
TRAINED_ON = {
    FEW: "the few labelled images alone",
    "few+random": "the few and random attributes",
    "few+default": "the few and hand-set attributes",
    "few+learnt": "the few and learnt attributes",
}
"""The training sets of these rows."""


def rows(
    run: Session[Any], rendered: Mapping[str, Source], fidelity: Fidelity
) -> dict[str, Source]:
    """The few images alone, and beside each rendered set; nothing without few images."""
    if not run.target.few_names:
        return {}
    few: dict[str, Source] = {FEW: run.images(fidelity, "few")}
    return few | {f"{FEW}+{name}": run.with_few(fidelity, own) for name, own in rendered.items()}


def about(run: Session[Any]) -> Report:
    """The report's fields on the few images."""
    names = run.target.few_names
    return {"few_images": list(names), "few_share": run.config.few_share} if names else {}


def gains(rows: Mapping[str, Report]) -> Report:
    """The gains of learnt renders over the few images alone, and over other renders beside them."""
    if FEW not in rows:
        return {}
    ours = rows[f"{FEW}+learnt"]["miou"]
    others = (FEW, f"{FEW}+random", f"{FEW}+default")
    found = {other: statistics(ours, rows[other]["miou"])["gain"] for other in others}
    return {"gain_beside_few": {k: v or {"mean": None, "ci95": None} for k, v in found.items()}}


def words(report: Report, row: str, trained_on: Mapping[str, str]) -> str:
    """The training set of a row in words, with the number of the few images."""
    count = len(report.get("few_images", ()))
    if count == 0:
        return trained_on[row]
    if row == "real":
        return f"all {report['reward_images'] + count} labelled images"
    return trained_on[row].replace("the few", f"the {count}", 1)
