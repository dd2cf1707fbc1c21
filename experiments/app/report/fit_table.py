"""The report of `sdr-jax fit`: means and intervals, the table, and the contents of its page."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

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
from experiments.tables.stats import bounded, crossed, mean

Row = Literal["labels", "labels+renders", "renders", "labels+learnt"]
WORDS: dict[Row, str] = {
    "labels": "your labels alone",
    "labels+renders": "your labels and renders",
    "renders": "renders alone",
    "labels+learnt": "your labels and renders of learnt streets",
}
"""The training sets of the rows."""
MIXED = ", half of random and half of hand-set streets,"
"""The renders in words; those of earlier versions were all of random streets."""
MODEL, STRIP = "model", "predictions.png"
"""Files of the run folder: the net; images with their labels and predictions."""
FEWEST = 3
"""The least number of folds for an interval over folds."""


def derive(report: Report) -> Report:
    """Add means, intervals over folds and seeds, the gains by renders and by labels, and the verdict."""
    values = {row: _miou(own) for row, own in report["nets"].items()}
    rows = {
        row: {
            **bounded(_estimate(values[row])),
            **({"averaged": mean(report["averaged"][row])} if "averaged" in report else {}),
            "miou": miou(flat),
            "per_class": class_means(flat, report["classes"]),
        }
        for row, own in report["nets"].items()
        for flat in [[net for fold in own for net in fold]]
    }
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


def _miou(folds: Sequence[Sequence[Report | None]]) -> np.ndarray:
    """MIoU f64[folds, seeds] in percent, NaN if a net failed."""
    return np.array([[np.nan if net is None else net["miou"] for net in fold] for fold in folds])


def _estimate(values: np.ndarray) -> Report:
    """Mean and 95 % interval, and the mean of each fold; seeds with a failed net are left out.

    The interval is over folds and nets if there are at least `FEWEST` folds, otherwise over nets alone.
    """
    known = values[:, np.isfinite(values).all(axis=0)]
    if not known.size:
        return {"mean": None, "ci95": None, "folds": []}
    drawn = known if len(known) >= FEWEST else known.mean(axis=0, keepdims=True)
    mean, ci95 = crossed(drawn.tolist())
    return {"mean": mean, "ci95": ci95, "folds": known.mean(axis=1).tolist()}


def verdict(gain: Mapping[str, Any], labels: int) -> str:
    """A sentence on the gain by renders."""
    mean, ci95 = gain["mean"], gain["ci95"]
    own = f"your {labels} labels"
    if mean is None:
        return "Nets failed in training, so it is not known what renders add."
    if ci95 is None:
        return f"Renders add {mean:.1f} points to {own}, by one net each: --seeds 3 says how sure that is."
    low, high = ci95
    between = f"({low:.1f} to {high:.1f})"
    if low > 0:
        return f"Renders add {mean:.1f} points {between} to {own}."
    if high < 0:
        return f"Renders cost {-mean:.1f} points {between}: {own} alone are better."
    return f"Renders add {mean:.1f} points {between} to {own}, which may be chance."


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
                ("nets trained on", lambda row: WORDS[row["name"]]),
                *estimate("mIoU"),
                *estimate("over labels alone", lambda row: row["gain"], "+.1f"),
                *([("averaged", lambda row: number(row["averaged"]))] if averaged else []),
            ],
            [
                {"name": name, **own, "gain": report["gains"].get(name)}
                for name, own in report["rows"].items()
            ],
        ),
    ]
    sentences = (*_by_fold(report), *_over_images(report), *_from_labels(report))
    lines += [f"\n{sentence}" for sentence in sentences]
    lines += [f"\nNote: {note}." for note in report["notes"]]
    lines += ["", _left(report)]
    return "\n".join(lines)


def _tested_on(report: Report) -> str:
    folds = len(report["nets"]["labels"])
    over = "folds and nets" if folds >= FEWEST else "nets"
    return (
        f"mIoU in percent at {report['scored_at']} on {report['tested']} images that a net has not seen "
        f"({report['where']}), {report['seeds']} nets each; 95 % intervals over {over}. {_averaged(report)}"
        "Beside labels "
        f"{report['rendered_images']} renders{MIXED if report.get('streets') == 'mixed' else ''} are "
        f"{_rendered_share(report)}."
    )


def _averaged(report: Report) -> str:
    """A sentence on the mean of the heads' logits, if it was tested."""
    if "averaged" not in report:
        return ""
    return "Averaged: the mean of the logits of these heads, as in the saved model. "


def _rendered_share(report: Report) -> str:
    """The share of renders in batches of labels and renders."""
    first, last = (100 * (1 - (report.get(name) or 0.0)) for name in ("few_share", "last_share"))
    if report.get("last_share") is None:
        return f"{first:g} % of all batches"
    return f"{first:g} % of the first batch and {last:g} % of the last"


def _by_fold(report: Report) -> list[str]:
    gains = report["gains"]["labels+renders"]["folds"]
    each = ", ".join(f"{gain:+.1f}" for gain in gains)
    return [f"By fold, renders add {each}."] if len(gains) > 1 else []


def _over_images(report: Report) -> list[str]:
    """A sentence on the gain of the averaged network and what it depends on the tested images."""
    found = report.get("over_images", {}).get("labels+renders")
    if not found or found["ci95"] is None:
        return []
    low, high = found["ci95"]
    return [
        f"To the averaged network renders add {found['value']:.1f} points; 95 % bootstrap interval over "
        f"{found['units']}: {low:.1f} to {high:.1f}."
    ]


def _from_labels(report: Report) -> list[str]:
    names = ", ".join(report["not_rendered"])
    return [f"Learnt from labels alone: {names}."] if names else []


def _left(report: Report) -> str:
    return f"The net in {MODEL}/ was trained on {WORDS[report['recipe']]}."


def rows_of(learnt: bool) -> list[Row]:
    """The rows of a run, with those of learnt streets or without."""
    return [row for row in WORDS if learnt or row != "labels+learnt"]


def is_fit(report: Report) -> bool:
    """Whether a report is of `sdr-jax fit`, not of the main job."""
    return "where" in report


def content(report: Report, folder: Path, config: Mapping[str, Any], over: bool) -> dict[str, Any]:
    """The parts of the page that only `sdr-jax fit` has; see `experiments.app.report.page`.

    Args:
        report: the derived report, or what is known of it while the run goes on.
        folder: the run's folder.
        config: its configuration.
        over: whether the run is finished.
    """
    out, strip = Path(str(config["out"])), "colors" in report and (folder / STRIP).exists()
    steps = config["final"]["train"]["steps"]
    shown: dict[str, Any] = {
        "asked": [
            ("Your images", f"{report['labels']} labelled, {len(report['classes'])} classes"),
            (
                "Reported on",
                f"{report['tested']} images at {report['scored_at']}, {report['where']}",
            ),
            (
                "Renders beside labels",
                f"{report['rendered_images']}, {_rendered_share(report)}",
            ),
            ("Nets", f"{report['net']}, {steps} steps, {report['seeds']} seeds"),
            ("Preset", report["preset"]),
        ],
        "notes": report["notes"],
        "parts": {
            "examples": {"file": STRIP, "rows": rows_of(config["learnt"])} if strip else None,
            # Rewards of several folds are of different images: not one curve.
            **({"search": None} if report.get("folds", 1) > 1 else {}),
        },
    }
    if not over:
        return shown
    if "seconds" in report:
        shown["asked"].append(("Took", duration(report["seconds"]["total"])))
    rows, gains = report["rows"], report["gains"]
    added = [("renders add to your labels", gains["labels+renders"])]
    if "labels+learnt" in gains:
        added.append(("renders of learnt streets add to your labels", gains["labels+learnt"]))
    added.append(("your labels add to renders", report["labels_add"]))
    results = [[WORDS[cast(Row, name)], *cells(own)] for name, own in rows.items()]
    results += [[what, *cells(gain, "+.1f")] for what, gain in added]
    model = shlex.quote(str(out / MODEL))
    return {
        **shown,
        "verdict": report["verdict"],
        "following": [
            (
                "Next: label your other images with the net",
                f"{PROGRAM} predict {model} IMAGES --out DIR",
            ),
            (
                "Or test it on other labelled images",
                f"{PROGRAM} evaluate {model} DATA --json FILE",
            ),
        ],
        "cards": [
            *(
                (number(rows[row]["mean"]), "% mIoU", WORDS[row], rows[row])
                for row in cast(tuple[Row, ...], ("labels", "labels+renders"))
            ),
            *((number(gain["mean"], "+.1f"), "points", what, gain) for what, gain in added),
        ],
        "result_note": " ".join(
            [_tested_on(report), *_by_fold(report), *_over_images(report), _left(report)]
        ),
        "class_note": " ".join(
            ["Mean IoU of each class with 95 % intervals.", *_from_labels(report)]
        ),
        "by_class": {
            row: by_class(own, len(report["classes"])) for row, own in report["nets"].items()
        },
        "parts": {**shown["parts"], "result": results},
    }


def by_class(folds: Sequence[Sequence[Report | None]], count: int) -> list[Report]:
    """Mean and interval of each class, over the folds whose images have it."""
    absent = [None] * count
    values = np.array(
        [[absent if net is None else net["class_iou"] for net in fold] for fold in folds], float
    )
    known = np.isfinite(values).any(axis=1)  # folds, classes
    return [bounded(_estimate(values[known[:, k], :, k])) for k in range(count)]
