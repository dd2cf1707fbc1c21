"""A few labelled images beside every training set: what nets are then trained on, and the rows they add."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from experiments.config import Fidelity
from experiments.reward.miou import Source
from experiments.reward.truth import WithFew
from experiments.run.context import Run
from experiments.study.form import Report
from experiments.study.stats import statistics
from seg.data import LabelledImages

FEW = "few"
"""The row of nets that are trained on the few images alone; ``few+ROW`` has those of ROW, too."""
TRAINED_ON = {
    FEW: "the few labelled images alone",
    "few+random": "the few and random attributes",
    "few+default": "the few and hand-set attributes",
    "few+learnt": "the few and learnt attributes",
}
"""What the nets of these rows were trained on."""


def beside(run: Run[Any], fidelity: Fidelity, rendered: Source) -> Source:
    """A rendered set as the job trains on it: with the few labelled images, if it was given any."""
    if not run.target.few_names:
        return rendered
    return WithFew(rendered, run.truth(fidelity, "few"), run.config.few_share)


def rows(run: Run[Any], rendered: Mapping[str, Source], fidelity: Fidelity) -> dict[str, Source]:
    """The few images alone, and beside each rendered set; nothing where there are none."""
    if not run.target.few_names:
        return {}
    few: dict[str, Source] = {FEW: run.truth(fidelity, "few")}
    return few | {f"{FEW}+{name}": beside(run, fidelity, own) for name, own in rendered.items()}


def images_of(source: Source, fidelity: Fidelity) -> int:
    """Images that a net of a fidelity is trained on, each counted once."""
    if isinstance(source, LabelledImages):
        return len(source.images)
    return fidelity.images + (len(source.arrays.images) if isinstance(source, WithFew) else 0)


def about(run: Run[Any]) -> Report:
    """What a report says of the few images."""
    names = run.target.few_names
    return {"few_images": list(names), "few_share": run.config.few_share} if names else {}


def gains(rows: Mapping[str, Report]) -> Report:
    """What learnt renders add to the few images, and what they are ahead of other renders beside them."""
    if FEW not in rows:
        return {}
    ours = rows[f"{FEW}+learnt"]["miou"]
    others = (FEW, f"{FEW}+random", f"{FEW}+default")
    found = {other: statistics(ours, rows[other]["miou"])["gain"] for other in others}
    return {"gain_beside_few": {k: v or {"mean": None, "ci95": None} for k, v in found.items()}}


def words(report: Report, row: str, trained_on: Mapping[str, str]) -> str:
    """What a row was trained on, with the number of the few images."""
    count = len(report.get("few_images", ()))
    if count == 0:
        return trained_on[row]
    if row == "real":
        return f"all {report['reward_images'] + count} labelled images"
    return trained_on[row].replace("the few", f"the {count}", 1)
