"""The report of `sdr-jax fit`: means and intervals, the table, and the contents of its page."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from common.errors import counted
from common.interrupt import PROGRAM
from common.progress import duration
from experiments.tables.form import (
    Report,
    cells,
    class_means,
    estimate,
    miou,
    number,
    starts,
    table,
)
from experiments.tables.row_names import TRAINED_ON
from experiments.tables.stats import bounded, crossed, mean

Row = Literal["labels", "labels+renders", "renders", "labels+learnt"]
MIXED = f" ({TRAINED_ON['mixed']})"
"""The streets of the renders; those of earlier versions were all random."""
MODEL, STRIP = "model", "predictions.png"
"""Files of the run folder: the model; images with their labels and predictions."""
FEWEST = 3
"""The smallest number of folds for an interval over folds."""


def derive(report: Report) -> Report:
    """Add means, intervals over folds and seeds, the gains by renders and by labels, and the verdict."""
    values = {row: _miou(folds) for row, folds in report["nets"].items()}
    rows = {row: _row(report, row, values[row]) for row in values}
    gains = {
        row: _estimate(values[row] - values["labels"]) for row in rows if row.startswith("labels+")
    }
    best = max(
        (row for row in rows if row.startswith("labels") and rows[row]["mean"] is not None),
        key=lambda row: rows[row]["mean"],
        default="labels+renders",
    )
    return {
        **report,
        "rows": rows,
        "gains": gains,
        "labels_add": _estimate(values["labels+renders"] - values["renders"]),
        "recipe": best,
        "verdict": verdict(gains["labels+renders"], report["labels"]),
    }


def _row(report: Report, row: str, values: np.ndarray) -> Report:
    """The scores of a row, of which values f64[folds, seeds] are the mIoU of its networks."""
    nets = [net for fold in report["nets"][row] for net in fold]
    averaged = {"averaged": mean(report["averaged"][row])} if "averaged" in report else {}
    return {
        **bounded(_estimate(values)),
        **averaged,
        "miou": miou(nets),
        "per_class": class_means(nets, report["classes"]),
    }


def _miou(folds: Sequence[Sequence[Report | None]]) -> np.ndarray:
    """MIoU f64[folds, seeds] in percent, NaN where training failed."""
    return np.array([[np.nan if net is None else net["miou"] for net in fold] for fold in folds])


def _estimate(values: np.ndarray) -> Report:
    """Mean and 95 % interval, and the mean of each fold; seeds with a failed network are left out.

    The interval is over folds and networks if there are at least `FEWEST` folds, otherwise over networks
    alone.
    """
    complete = values[:, np.isfinite(values).all(axis=0)]
    if not complete.size:
        return {"mean": None, "ci95": None, "folds": []}
    samples = complete if len(complete) >= FEWEST else complete.mean(axis=0, keepdims=True)
    mean, ci95 = crossed(samples.tolist())
    return {"mean": mean, "ci95": ci95, "folds": complete.mean(axis=1).tolist()}


def verdict(gain: Mapping[str, Any], labels: int) -> str:
    """A sentence on the gain from renders."""
    mean, ci95 = gain["mean"], gain["ci95"]
    your_labels = f"your {counted(labels, 'label')}"
    if mean is None:
        return "Training failed for some networks, so the gain from renders is unknown."
    if ci95 is None:
        return (
            f"Renders add {mean:.1f} points to {your_labels}, measured with one network each; use --seeds 3 "
            "for an interval."
        )
    low, high = ci95
    between = f"({low:.1f} to {high:.1f})"
    if low > 0:
        return f"Renders add {mean:.1f} points {between} to {your_labels}."
    if high < 0:
        return f"Renders cost {-mean:.1f} points {between}: use {your_labels} alone."
    if mean < 0:
        return f"Renders change the mIoU of {your_labels} by {mean:.1f} points {between}: within noise."
    return f"Renders add {mean:.1f} points {between} to {your_labels}, which is within noise."


def text(report: Report) -> str:
    """The table and the verdict, in Markdown."""
    averaged = "averaged" in report
    lines = [
        report["verdict"],
        "",
        f"{_tested_on(report)}{starts(report)}",
        "",
        *table(
            [
                ("trained on", lambda row: TRAINED_ON[row["name"]]),
                *estimate("mIoU"),
                *estimate("gain over labels alone", lambda row: row["gain"], "+.1f"),
                *([("averaged", lambda row: number(row["averaged"]))] if averaged else []),
            ],
            [
                {"name": name, **row, "gain": report["gains"].get(name)}
                for name, row in report["rows"].items()
            ],
        ),
    ]
    sentences = (*_by_fold(report), *_over_images(report), *_not_rendered(report))
    lines += [f"\n{sentence}" for sentence in sentences]
    lines += [f"\nNote: {note}." for note in report["notes"]]
    lines += ["", _saved_model(report)]
    return "\n".join(lines)


def _tested_on(report: Report) -> str:
    folds = len(report["nets"]["labels"])
    over = "folds and networks" if folds >= FEWEST else "networks"
    seeds = report["seeds"]
    return (
        f"mIoU in percent at {report['scored_at']} on {report['tested']} images not used for training "
        f"({report['where']}), {seeds} network{'s' if seeds != 1 else ''} each; 95 % intervals over {over}. "
        f"{_averaged(report)}In labels + renders, {report['rendered_images']} renders"
        f"{MIXED if report.get('streets') == 'mixed' else ''} are {_rendered_share(report)}."
    )


def _averaged(report: Report) -> str:
    """A sentence on the average of the heads, if it was tested."""
    if "averaged" not in report:
        return ""
    return "Averaged: the mean of these heads' logits, as in the saved model. "


def _rendered_share(report: Report) -> str:
    """The share of renders in batches of labels and renders."""
    first, last = (100 * (1 - (report.get(name) or 0.0)) for name in ("few_share", "last_share"))
    if report.get("last_share") is None:
        return f"{first:g} % of all batches"
    return f"{first:g} % of the first batch and {last:g} % of the last"


def _by_fold(report: Report) -> list[str]:
    gains = report["gains"]["labels+renders"]["folds"]
    by_fold = ", ".join(f"{gain:+.1f}" for gain in gains)
    return [f"By fold, renders add {by_fold}."] if len(gains) > 1 else []


def _over_images(report: Report) -> list[str]:
    """A sentence on how much the averaged network's gain depends on the tested images."""
    gain = report.get("over_images", {}).get("labels+renders")
    if not gain or gain["ci95"] is None:
        return []
    low, high = gain["ci95"]
    return [
        f"For the averaged network, renders add {gain['value']:.1f} points; 95 % interval over "
        f"{gain['units']}: {low:.1f} to {high:.1f}."
    ]


def _not_rendered(report: Report) -> list[str]:
    names = ", ".join(report["not_rendered"])
    return [f"Not in the renders, so trained on labels alone: {names}."] if names else []


def _saved_model(report: Report) -> str:
    return f"The model in {MODEL}/ was trained on {TRAINED_ON[report['recipe']]}."


def rows_of(learnt: bool) -> list[Row]:
    """The rows of a run, with the row of optimised streets or without."""
    rows: list[Row] = ["labels", "labels+renders", "renders"]
    return [*rows, "labels+learnt"] if learnt else rows


def is_fit(report: Report) -> bool:
    """Whether a report is of `sdr-jax fit`, not of the main job."""
    return "where" in report


def content(
    report: Report, folder: Path, config: Mapping[str, Any], finished: bool
) -> dict[str, Any]:
    """The parts of the page that only `sdr-jax fit` has; see `experiments.app.report.page`.

    Args:
        report: the derived report; while the run is unfinished, its first fields.
        folder: the run's folder.
        config: its configuration.
        finished: whether the run is.
    """
    out, strip = Path(str(config["out"])), "colors" in report and (folder / STRIP).exists()
    steps = config["final"]["train"]["steps"]
    shown: dict[str, Any] = {
        "settings_in_words": [
            ("Your images", f"{report['labels']} labelled, {len(report['classes'])} classes"),
            (
                "Tested on",
                f"{report['tested']} images at {report['scored_at']}, {report['where']}",
            ),
            (
                "Renders mixed with labels",
                f"{report['rendered_images']}, {_rendered_share(report)}",
            ),
            ("Networks", f"{report['net']}, {steps} steps, {report['seeds']} seeds"),
            ("Preset", report["preset"]),
        ],
        "notes": report["notes"],
        "parts": {
            "examples": {"file": STRIP, "rows": rows_of(config["learnt"])} if strip else None,
            # Rewards of several folds are of different images: not one curve.
            **({"search": None} if report.get("folds", 1) > 1 else {}),
        },
    }
    if not finished:
        return shown
    if "seconds" in report:
        shown["settings_in_words"].append(("Time", duration(report["seconds"]["total"])))
    rows, gains = report["rows"], report["gains"]
    added = [("renders add to your labels", gains["labels+renders"])]
    if "labels+learnt" in gains:
        added.append(("optimised streets add to your labels", gains["labels+learnt"]))
    added.append(("your labels add to renders", report["labels_add"]))
    results = [[TRAINED_ON[name], *cells(row)] for name, row in rows.items()]
    results += [[label, *cells(gain, "+.1f")] for label, gain in added]
    model = shlex.quote(str(out / MODEL))
    return {
        **shown,
        "verdict": report["verdict"],
        "following": [
            (
                "Next: label your other images with the model",
                f"{PROGRAM} predict {model} IMAGES --out DIR",
            ),
            (
                "Or test it on other labelled images",
                f"{PROGRAM} evaluate {model} DATA --json FILE",
            ),
        ],
        "cards": [
            *(
                (number(rows[row]["mean"]), "% mIoU", TRAINED_ON[row], rows[row])
                for row in ("labels", "labels+renders")
            ),
            *((number(gain["mean"], "+.1f"), "points", label, gain) for label, gain in added),
        ],
        "result_note": " ".join(
            [_tested_on(report), *_by_fold(report), *_over_images(report), _saved_model(report)]
        ),
        "class_note": " ".join(
            ["Mean IoU of each class with 95 % intervals.", *_not_rendered(report)]
        ),
        "by_class": {
            row: by_class(folds, len(report["classes"])) for row, folds in report["nets"].items()
        },
        "parts": {**shown["parts"], "result": results},
    }


def by_class(folds: Sequence[Sequence[Report | None]], count: int) -> list[Report]:
    """Mean and interval of each class, over the folds whose test images have it."""
    absent = [None] * count
    values = np.array(
        [[absent if net is None else net["class_iou"] for net in fold] for fold in folds], float
    )
    tested = np.isfinite(values).any(axis=1)  # folds, classes
    return [bounded(_estimate(values[tested[:, k], :, k])) for k in range(count)]
