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
ROWS = (FEW, f"{FEW}+random", f"{FEW}+default", f"{FEW}+learnt")
"""All of these rows."""


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
