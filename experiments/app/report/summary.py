"""The run's answer in figures: ``summary.json``, and the table that is printed."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.command import given
from experiments.evaluation.job import Result
from experiments.evaluation.store import each
from experiments.session.session import Session
from experiments.tables import few_rows
from experiments.tables.form import Report, about, class_means, interval, miou, nets, starts
from experiments.tables.stats import TOO_FEW, statistics
from scene.attributes import names
from scene.proposal import Proposal, describe

TRAINED_ON = {
    "random": "random attributes",
    "default": "hand-set attributes",
    "learnt": "learnt attributes",
    **few_rows.TRAINED_ON,
    "real": "the reward images themselves",
}
"""The training sets of the result's rows."""
ROWS = tuple(row for row in TRAINED_ON if row not in few_rows.TRAINED_ON)
"""Rows of a target with labelled reward images (otherwise without ``real``); ``--few`` adds others."""


def scores(run: Session[Any], rows: dict[str, list[Result]], learnt: Proposal) -> Report:
    """All measurements; mIoU in percent, unit values in [0, 1]."""
    config, target = run.config, run.target
    lines = each(run.evaluations.records + run.finals.records)
    return {
        **about(run, config.final),
        **few_rows.about(run),
        "seed": config.seed,
        "command": given(),
        "evaluations": len(run.evaluations.records),
        "failed": sum(line["failed"] is not None for line in lines),
        "seconds": {
            "render": round(sum(line["render_seconds"] for line in lines), 1),
            "train": round(sum(line["train_seconds"] for line in lines), 1),
            "total": round(run.progress.elapsed, 1),
        },
        "nets": {row: nets(outcomes) for row, outcomes in rows.items()},
        **describe(learnt),
        "hidden_centres": None if target.twin is None else target.twin.centre.tolist(),
    }


def derive(report: Report) -> Report:
    """Add means, intervals, two gains, and the recovery of the twin's attributes to the report.

    ``random``, ``default`` and ``learnt`` are also at the top level, but ``real`` there says whether the
    target is real data.
    """
    rows = {row: _row(own, report["classes"]) for row, own in report["nets"].items()}
    gains = {
        f"gain{over}": statistics(rows["learnt"]["miou"], rows[row]["miou"])["gain"]
        or {"mean": None, "ci95": None}
        for over, row in (("", "random"), ("_over_default", "default"))
    }
    absent = [name for name, value in rows["random"]["per_class"].items() if value is None]
    return {
        **report,
        "rows": rows,
        **{row: rows[row] for row in rows if row != "real"},
        **gains,
        **few_rows.gains(rows),
        "searches": [{"seed": report["seed"], "learnt": rows["learnt"]["mean"]}],
        "classes_absent_from_truth": absent,
        **({} if report["hidden_centres"] is None else {"recovery": _recovery(report)}),
    }


def _row(own: list[Report | None], classes: list[str]) -> Report:
    values = miou(own)
    found = statistics(values)
    per_class = {
        name: None if value is None else round(value, 3)
        for name, value in class_means(own, classes).items()
    }
    return {"miou": values, "mean": found["mean"], "ci95": found["ci95"], "per_class": per_class}


def _recovery(report: Report) -> Report:
    """The distances of the learnt centres from the twin's hidden ones, in unit values.

    They are those of common attributes: either space may be the smaller one, whose attributes come first.
    """
    own = report["components"][0]["attributes"]
    hidden = np.array(report["hidden_centres"])[: len(own)]
    both = names("extended")[: len(hidden)]
    error = np.abs(np.array([own[name]["unit"]["centre"] for name in both]) - hidden)
    return {
        "learnt_error": round(float(error.mean()), 4),
        "centre_error": round(float(np.abs(0.5 - hidden).mean()), 4),
        "by_attribute": {name: round(float(e), 4) for name, e in zip(both, error, strict=True)},
    }


def text(report: Report) -> str:
    """The result as a small table for people."""
    kind = "real images" if report["real"] else f"the {report['target']}, NOT real data"
    lines = [
        f"mIoU in percent on {report['test_images']} test images ({kind}), "
        f"{len(report['random']['miou'])} paired seeds, scored at {report['scored_at']}:"
    ]
    wide = max(8, *map(len, report["rows"]))
    for row, entry in report["rows"].items():
        lines.append(
            f"  {row:{wide}s} {_said(entry, '5.1f')}  {few_rows.words(report, row, TRAINED_ON)}"
        )
    lines.append(f"  {'gain':{wide}s} {_said(report['gain'], '+5.1f')}  learnt minus random")
    lines.append(
        f"  {'gain':{wide}s} {_said(report['gain_over_default'], '+5.1f')}  learnt minus hand-set"
    )
    for other, gain in report.get("gain_beside_few", {}).items():
        lines.append(f"  {'gain':{wide}s} {_said(gain, '+5.1f')}  few+learnt minus {other}")
    lines.append(f"  {advice(report)}")
    if report["classes_absent_from_truth"]:
        absent = ", ".join(report["classes_absent_from_truth"])
        lines.append(f"  left out of the mean, for they never occur in the truth: {absent}")
    if said := starts(report):
        lines.append(f" {said}")
    if report["failed"]:
        lines.append(f"  {report['failed']} evaluations failed in training and are left out")
    return "\n".join(lines)


def advice(report: Report) -> str:
    """Whether learnt streets are better than the default ones, and which to use, in one line."""
    beside = report.get("gain_beside_few")
    gain = beside["few+default"] if beside else report["gain_over_default"]
    means = {
        row: report["rows"][f"few+{row}" if beside else row]["mean"]
        for row in ("learnt", "default", "random")
    }
    scored = {row: mean for row, mean in means.items() if mean is not None}
    best = max(scored, key=scored.__getitem__, default="default")
    use = f"use the {best} ones" if best != "random" else "use random ones"
    if gain["mean"] is None:
        return f"Learnt and default streets cannot be compared: {use}."
    points, ci95 = f"{gain['mean']:+.1f} points", gain["ci95"]
    if ci95 is None:
        return f"Learnt minus default streets: {points} ({TOO_FEW}): {use}."
    significant = ci95[0] * ci95[1] > 0
    better = "better" if gain["mean"] > 0 else "worse"
    how = f"significantly {better} than" if significant else "within noise of"
    return f"Learnt streets are {how} default ones, {points} ({interval(ci95)}): {use}."


def _said(entry: Report, form: str) -> str:
    """A mean and its interval, in columns."""
    mean = "    -" if entry["mean"] is None else format(entry["mean"], form)
    ci95 = entry["ci95"]
    if entry["mean"] is not None and ci95 is None:
        return f"{mean}  {TOO_FEW}"
    return f"{mean}  " + (" " * 16 if ci95 is None else f"[{ci95[0]:6.1f}, {ci95[1]:6.1f}]")
