"""The result of a run: ``summary.json``, and the table that is printed."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.command import running_command
from experiments.evaluation.job import Result
from experiments.evaluation.store import first_of_each
from experiments.session.session import Session
from experiments.tables import few_rows
from experiments.tables.form import Report, about, class_means, interval, miou, nets, starts
from experiments.tables.row_names import TRAINED_ON, trained_on
from experiments.tables.stats import TOO_FEW, statistics
from scene.attributes import names
from scene.proposal import Proposal, describe

ROWS = ("random", "default", "learnt", "real")
"""Rows of every target; ``--few`` adds others."""


def scores(run: Session[Any], rows: dict[str, list[Result]], learnt: Proposal) -> Report:
    """All measurements; mIoU in percent, unit values in [0, 1]."""
    config, target = run.config, run.target
    lines = first_of_each(run.evaluations.records + run.finals.records)
    return {
        **about(run, config.final),
        **few_rows.about(run),
        "seed": config.seed,
        "command": running_command(),
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
    """Add means, intervals, gains, and the recovery of the twin's attributes to the report.

    ``random``, ``default`` and ``learnt`` are also at the top level, but ``real`` there says whether the
    target is real data.
    """
    rows = {row: _row(scored, report["classes"]) for row, scored in report["nets"].items()}
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


def _row(scored: list[Report | None], classes: list[str]) -> Report:
    values = miou(scored)
    estimate = statistics(values)
    per_class = {
        name: None if value is None else round(value, 3)
        for name, value in class_means(scored, classes).items()
    }
    return {
        "miou": values,
        "mean": estimate["mean"],
        "ci95": estimate["ci95"],
        "per_class": per_class,
    }


def _recovery(report: Report) -> Report:
    """The distances of the optimised centres from the twin's hidden ones, in unit values.

    Only shared attributes count: either space may be the smaller one, whose attributes come first.
    """
    attributes = report["components"][0]["attributes"]
    hidden = np.array(report["hidden_centres"])[: len(attributes)]
    shared = names("extended")[: len(hidden)]
    error = np.abs(np.array([attributes[name]["unit"]["centre"] for name in shared]) - hidden)
    return {
        "learnt_error": round(float(error.mean()), 4),
        "centre_error": round(float(np.abs(0.5 - hidden).mean()), 4),
        "by_attribute": {name: round(float(e), 4) for name, e in zip(shared, error, strict=True)},
    }


def text(report: Report) -> str:
    """The result as a small table for people."""
    kind = "real images" if report["real"] else f"the {report['target']}, NOT real data"
    gains = {"learnt": {"random": report["gain"], "default": report["gain_over_default"]}}
    if few := report.get("gain_beside_few"):
        gains["few+learnt"] = few
    names = {row: trained_on(report, row) for row in report["rows"]}
    width = max(map(len, names.values())) + len("over ")
    lines = [
        f"mIoU in percent on {report['test_images']} test images ({kind}), "
        f"{len(report['random']['miou'])} paired seeds, at {report['scored_at']}:"
    ]
    for row, entry in report["rows"].items():
        lines.append(f"  {names[row]:{width}s}  {_with_interval(entry, '5.1f')}")
    for row, gain_over in gains.items():
        lines.append(f"Points gained by {names[row]}:")
        for other, gain in gain_over.items():
            lines.append(f"  {f'over {names[other]}':{width}s}  {_with_interval(gain, '+5.1f')}")
    lines.append(advice(report))
    if absent := report["classes_absent_from_truth"]:
        lines.append(
            f"No test image has these classes, so no mean includes them: {', '.join(absent)}"
        )
    if start := starts(report).strip():
        lines.append(start)
    if failed := report["failed"]:
        noun, verb = ("evaluations", "are") if failed > 1 else ("evaluation", "is")
        lines.append(f"{failed} {noun} failed in training and {verb} left out")
    return "\n".join(lines)


def advice(report: Report) -> str:
    """Say in one line whether optimised streets are better than the default ones, and which to use."""
    with_few = report.get("gain_beside_few")
    gain = with_few["few+default"] if with_few else report["gain_over_default"]
    means = {
        row: report["rows"][f"few+{row}" if with_few else row]["mean"]
        for row in ("learnt", "default", "random")
    }
    scored = {row: mean for row, mean in means.items() if mean is not None}
    best = max(scored, key=scored.__getitem__, default="default")
    use = f"use {TRAINED_ON[best]}."
    if gain["mean"] is None:
        return f"Optimised and default streets cannot be compared: {use}"
    points, ci95 = f"{gain['mean']:+.1f} points", gain["ci95"]
    if ci95 is None:
        return f"Optimised minus default streets: {points} ({TOO_FEW}): {use}"
    significant = ci95[0] * ci95[1] > 0
    better = "better" if gain["mean"] > 0 else "worse"
    how = f"significantly {better} than" if significant else "within noise of"
    return f"Optimised streets are {how} default streets, {points} ({interval(ci95)}): {use}"


def _with_interval(entry: Report, form: str) -> str:
    """A mean and its interval, in columns."""
    mean = "    -" if entry["mean"] is None else format(entry["mean"], form)
    ci95 = entry["ci95"]
    if entry["mean"] is not None and ci95 is None:
        return f"{mean}  {TOO_FEW}"
    return mean if ci95 is None else f"{mean}  [{ci95[0]:6.1f}, {ci95[1]:6.1f}]"
