"""The result of a run: ``summary.json``, and the table that is printed."""

from __future__ import annotations

import shlex
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from common.command import PROGRAM, running_command
from common.errors import counted
from experiments.app.report import result
from experiments.app.report.result import Kind
from experiments.evaluation.job import Result
from experiments.evaluation.store import first_of_each
from experiments.session.session import Session
from experiments.tables import compared
from experiments.tables.form import Report, about, interval, nets
from experiments.tables.row_names import TRAINED_ON, trained_on
from experiments.tables.stats import TOO_FEW
from scene.attributes import names
from scene.proposal import Proposal, describe

ROWS = ("random", "default", "learnt", "real")
"""Rows of every target; ``--few`` adds others."""
OVER = {
    "few+learnt": ("few", "few+default", "few+random"),
    "learnt": ("default", "random"),
}
"""Rows of optimised streets, each with those over which its gain is measured."""
IMAGES = 1000
"""The number of images in the command that renders more of the optimised streets."""


def scores(run: Session[Any], rows: dict[str, list[Result]], learnt: Proposal) -> Report:
    """All measurements; mIoU in percent, unit values in [0, 1]."""
    config, target = run.config, run.target
    lines = first_of_each(run.evaluations.records + run.finals.records)
    return {
        **about(run, config.final),
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
    """Add means, intervals, gains, and the recovery of the twin's attributes to the report."""
    folds = folds_of(report)
    rows = {row: compared.row(nets, report["classes"]) for row, nets in folds.items()}
    return {
        **report,
        "rows": rows,
        "gains": {
            ours: {other: compared.gain(folds[ours], folds[other]) for other in others}
            for ours, others in OVER.items()
            if ours in rows
        },
        "classes_absent_from_truth": [
            name for name, value in rows["random"]["per_class"].items() if value is None
        ],
        **({} if report["hidden_centres"] is None else {"recovery": _recovery(report)}),
    }


def folds_of(report: Report) -> dict[str, compared.Folds]:
    """The networks of each row, all of which are tested on the same images."""
    return {row: [nets] for row, nets in report["nets"].items()}


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


def verdict(report: Report) -> str:
    """Say whether optimised streets are better than the default ones, and which to use."""
    few = "few+" if "few+learnt" in report["rows"] else ""
    gain = report["gains"][f"{few}learnt"][f"{few}default"]
    means = {row: report["rows"][few + row]["mean"] for row in ("learnt", "default", "random")}
    scored = {row: mean for row, mean in means.items() if mean is not None}
    use = f"use {TRAINED_ON[max(scored, key=scored.__getitem__, default='default')]}."
    images = len(report.get("few_images", ()))
    optimised = f"With {counted(images, 'labelled image')}, optimised" if images else "Optimised"
    if gain["mean"] is None:
        return f"{optimised} and default streets cannot be compared, because training failed: {use}"
    points, ci95 = f"{gain['mean']:+.1f} points", gain["ci95"]
    if ci95 is None:
        return f"{optimised} minus default streets: {points} ({TOO_FEW}): {use}"
    better = "better" if gain["mean"] > 0 else "worse"
    how = f"significantly {better} than" if ci95[0] * ci95[1] > 0 else "within noise of"
    return f"{optimised} streets are {how} default streets, {points} ({interval(ci95)}): {use}"


def gains(report: Report) -> dict[str, Report]:
    """The gains of optimised streets by their name."""
    return {
        f"{trained_on(report, ours)} over {trained_on(report, other)}": gain
        for ours, over in report["gains"].items()
        for other, gain in over.items()
    }


def note(report: Report) -> str:
    """Sentences on the rows."""
    kind = "real images" if report["real"] else f"the {report['target']}, NOT real data"
    absent = ", ".join(report["classes_absent_from_truth"])
    also = (
        f" No test image has these classes, so no mean includes them: {absent}." if absent else ""
    )
    return (
        f"Mean IoU in percent on {report['test_images']} test images ({kind}) at {report['scored_at']}, "
        f"{counted(report['seeds'], 'paired seed')}; 95 % intervals over seeds.{also}"
    )


def settings(run: Any) -> list[tuple[str, str]]:
    """The main settings and the data of a `RunFolder`."""
    report, config = run.summary, run.config
    train, options = config.get("final", {}).get("train", {}), config.get("search", {})
    count = len(report.get("few_images", ()))
    few = f"{count} images, {100 * report['few_share']:.0f} % of every batch" if count else "none"
    net, steps = train.get("net", "?"), train.get("steps", "?")
    return [
        ("Rewards", f"{len(run.evaluations)}, measured on {report['reward_images']} images"),
        ("Tested on", f"{report['test_images']} other images at {report['scored_at']}"),
        ("Labels mixed with renders", few),
        ("Search", f"{options.get('method', '?')}, space {config.get('space', 'scenex')}"),
        ("Networks", f"{net}, {steps} steps, {counted(report['seeds'], 'seed')}"),
    ]


def following(run: Any) -> list[tuple[str, str]]:
    """The next commands after the run of a `RunFolder`, each with what it does."""
    out = Path(str(run.config.get("out", run.path)))
    words = [PROGRAM, "render", "--attributes", str(out / "attributes.json")]
    words += ["--images", str(IMAGES), "--out", str(out / "streets")]
    more = (f"Next: render {IMAGES:,} images of these streets", shlex.join(words))
    if run.summary["real"]:
        return [more]
    return [more, ("Or check your own labelled images", f"{PROGRAM} doctor DATA")]


KIND = Kind(
    verdict=verdict,
    main_rows=lambda report: ("few+learnt" if "few+learnt" in report["rows"] else "learnt", "real"),
    gains=gains,
    folds=folds_of,
    note=note,
    class_note=lambda report: "",
    settings=settings,
    following=following,
)
text = partial(result.text, KIND)
