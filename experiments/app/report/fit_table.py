"""The report of `sdr-jax fit`: means and intervals, the table, and the contents of its page."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Literal

from common.command import PROGRAM
from common.errors import counted
from experiments.app.report import result
from experiments.app.report.result import Kind
from experiments.tables import compared
from experiments.tables.form import Report, number
from experiments.tables.row_names import TRAINED_ON
from experiments.tables.stats import TOO_FEW, mean

Row = Literal["labels", "labels+renders", "renders", "labels+learnt"]
MODEL = "model"
"""The folder of the model in the run folder."""


def derive(report: Report) -> Report:
    """Add means, intervals over folds and seeds, the gains by renders and by labels, and the verdict."""
    folds, classes = report["nets"], report["classes"]
    rows = {row: compared.row(nets, classes) for row, nets in folds.items()}
    for row, values in report.get("averaged", {}).items():
        rows[row]["averaged"] = mean(values)
    gains = {
        row: compared.gain(folds[row], folds["labels"]) for row in rows if row.startswith("labels+")
    }
    with_labels = (row for row in rows if row.startswith("labels"))
    tested = {row: score for row in with_labels if (score := saved_score(rows[row])) is not None}
    best = max(tested, key=tested.__getitem__, default="labels+renders")
    return {
        **report,
        "rows": rows,
        "gains": gains,
        "labels_add": compared.gain(folds["labels+renders"], folds["renders"]),
        "recipe": best,
        "verdict": verdict(gains["labels+renders"], report["labels"]),
    }


def saved_score(row: Report) -> float | None:
    """The mean mIoU of networks as the saved model is: with averaged heads, if it has several."""
    averaged = row.get("averaged")
    return row["mean"] if averaged is None else averaged


def verdict(gain: Mapping[str, Any], labels: int) -> str:
    """A sentence on the gain from renders."""
    mean, ci95 = gain["mean"], gain["ci95"]
    your_labels = f"your {counted(labels, 'label')}"
    if mean is None:
        return "Training failed for some networks, so the gain from renders is unknown."
    if ci95 is None:
        return (
            f"Renders change the mIoU of {your_labels} by {mean:+.1f} points, measured with {TOO_FEW}; "
            "use --seeds 3."
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


def gains(report: Report) -> dict[str, Report]:
    """The gains by their name."""
    named = {"renders add to your labels": report["gains"]["labels+renders"]}
    if "labels+learnt" in report["gains"]:
        named["optimised streets add to your labels"] = report["gains"]["labels+learnt"]
    return named | {"your labels add to renders": report["labels_add"]}


def note(report: Report) -> str:
    """Sentences on the rows."""
    sentences = [*_by_fold(report), *_over_images(report), _saved_model(report)]
    return " ".join([_tested_on(report), *sentences])


def _tested_on(report: Report) -> str:
    folds = len(report["nets"]["labels"])
    over = "folds and networks" if folds >= compared.FEWEST else "networks"
    seeds = report["seeds"]
    return (
        f"mIoU in percent at {report['scored_at']} on {report['tested']} images not used for training "
        f"({report['where']}), {counted(seeds, 'network')} each; 95 % intervals over {over}. "
        f"{_fold_labels(report)}{_averaged(report)}In labels + renders, {report['rendered_images']} renders "
        f"({TRAINED_ON[report['streets']]}) are {_rendered_share(report)}."
    )


def _fold_labels(report: Report) -> str:
    """A sentence on the labels that each fold trains on."""
    counts = report.get("fold_labels", [])
    if len(counts) < 2:
        return ""
    between = f"{min(counts)} to {max(counts)}" if min(counts) < max(counts) else f"{counts[0]}"
    return f"Each fold trains on {between} of your {counted(report['labels'], 'label')}. "


def _averaged(report: Report) -> str:
    """A sentence on the average of the heads, if it was tested."""
    scores = [
        f"{number(entry['averaged'])} with {TRAINED_ON[row]}"
        for row, entry in report["rows"].items()
        if entry.get("averaged") is not None
    ]
    if not scores:
        return ""
    return f"Averaging the networks' logits, as the saved model does, reaches {', '.join(scores)}. "


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
        f"Over the pixels of all these images together, renders change the mIoU of the averaged network by "
        f"{gain['value']:+.1f} points; 95 % interval over {gain['units']}: {low:.1f} to {high:.1f}."
    ]


def class_note(report: Report) -> str:
    """Sentences on classes that are not rendered, and on those that some folds do not test, if any."""
    sentences = []
    if names := ", ".join(report["not_rendered"]):
        sentences.append(f"Not in the renders, so trained on labels alone: {names}.")
    if names := ", ".join(_tested_in_some_folds(report)):
        sentences.append(
            f"Not in every fold's test images, so mIoU is not the mean of classes: {names}."
        )
    return " ".join(sentences)


def _tested_in_some_folds(report: Report) -> list[str]:
    """The classes that the test images of some folds have, and of others lack."""
    folds, classes = report["nets"]["labels"], report["classes"]
    tested = [len(entry["folds"]) for entry in compared.by_class(folds, len(classes))]
    return [name for name, count in zip(classes, tested, strict=True) if 0 < count < len(folds)]


def _saved_model(report: Report) -> str:
    return f"The model in {MODEL}/ was trained on {TRAINED_ON[report['recipe']]}."


def rows_of(learnt: bool) -> list[Row]:
    """The rows of a run, with the row of optimised streets or without."""
    rows: list[Row] = ["labels", "labels+renders", "renders"]
    return [*rows, "labels+learnt"] if learnt else rows


def is_fit(report: Report) -> bool:
    """Whether a report is of `sdr-jax fit`, not of the main job."""
    return "where" in report


def settings(run: Any) -> list[tuple[str, str]]:
    """The main settings and the data of a `RunFolder`."""
    report, steps = run.summary, run.config["final"]["train"]["steps"]
    renders = f"{report['rendered_images']}, {_rendered_share(report)}"
    return [
        ("Your images", f"{report['labels']} labelled, {len(report['classes'])} classes"),
        ("Tested on", f"{report['tested']} images at {report['scored_at']}, {report['where']}"),
        ("Renders mixed with labels", renders),
        ("Networks", f"{report['net']}, {steps} steps, {counted(report['seeds'], 'seed')}"),
    ]


def following(run: Any) -> list[tuple[str, str]]:
    """The next commands after the run of a `RunFolder`, each with what it does."""
    model = shlex.quote(str(Path(str(run.config["out"])) / MODEL))
    return [
        (
            "Next: label your other images with the model",
            f"{PROGRAM} predict {model} IMAGES --out DIR",
        ),
        ("Or test it on other labelled images", f"{PROGRAM} evaluate {model} DATA --json FILE"),
    ]


KIND = Kind(
    verdict=lambda report: report["verdict"],
    main_rows=lambda report: ("labels", "labels+renders"),
    gains=gains,
    folds=lambda report: report["nets"],
    note=note,
    class_note=class_note,
    settings=settings,
    following=following,
)
text = partial(result.text, KIND)
