"""Rows of networks trained on a labelled subset, alone or mixed with renders."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from experiments.config import Fidelity
from experiments.evaluation.job import Source
from experiments.session.session import Session
from experiments.tables.form import Report

FEW = "few"
"""The row of networks trained on the labelled subset alone; ``few+ROW`` adds the images of ROW."""
ROWS = (FEW, f"{FEW}+random", f"{FEW}+default", f"{FEW}+learnt")
"""All of these rows."""


def rows(
    run: Session[Any], rendered: Mapping[str, Source], fidelity: Fidelity
) -> dict[str, Source]:
    """Make the training sets with the labelled subset, if there is one: alone, and with each rendered set."""
    if not run.target.few_names:
        return {}
    few: dict[str, Source] = {FEW: run.images(fidelity, "few")}
    return few | {
        f"{FEW}+{name}": run.with_few(fidelity, source) for name, source in rendered.items()
    }


def about(run: Session[Any]) -> Report:
    """Describe the labelled subset, in fields of the report."""
    names = run.target.few_names
    return {"few_images": list(names), "few_share": run.config.few_share} if names else {}
