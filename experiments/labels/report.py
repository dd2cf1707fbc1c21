"""Labelled images and renders in figures: ``labels.json``, ``labels.md`` and ``labels.png``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.study.figure import curve, plt, png
from experiments.study.form import (
    Form,
    Report,
    cells,
    failures,
    introduction,
    markdown,
    mean,
    miou,
    number,
    statistics,
    target_of,
)
from experiments.study.stats import bootstrap

ALONE = "none"
"""In place of the name of a set of renders: labelled images alone."""
RENDERS = {
    ALONE: "none",
    "random": "random attributes",
    "default": "attributes set by eye",
    "mixed": "half of them random, half by eye",
    "learnt": "learnt attributes",
}
BESIDE = (0, 14)
"""Numbers of labelled images beside which it is told how many more the renders are worth."""
HEAD = (
    "labelled images", "renders", "mIoU", "95 % interval", "renders add", "95 % interval", "of all labels, %",
)  # fmt: skip


def reached(counts: Sequence[int], curve: Sequence[float], value: float) -> float:
    """Where a curve over numbers of labels first reaches a value.

    Between numbers it is straight over log N. Where even the first is higher that one is given, where none
    is as high the last.

    Args:
        counts: numbers of labels above 0, ascending.
        curve: of each.
        value: to be reached.
    """
    if curve[0] >= value:
        return float(counts[0])
    for k in range(1, len(counts)):
        low, high = curve[k - 1], curve[k]
        if high >= value:
            part = (value - low) / (high - low)
            return math.exp((1 - part) * math.log(counts[k - 1]) + part * math.log(counts[k]))
    return float(counts[-1])


def derive(report: Report) -> Report:
    """The report with means and intervals, what renders add, and how many labels they are worth."""
    values = {(row["labels"], row["renders"]): miou(row["nets"]) for row in report["rows"]}
    counts = sorted({count for count, renders in values if renders == ALONE})
    best = mean(values[counts[-1], ALONE])
    rows = []
    for row in report["rows"]:
        place = row["labels"], row["renders"]
        own = statistics(values[place])
        alone = values.get((row["labels"], ALONE)) if row["renders"] != ALONE else None
        add = None if alone is None else statistics(values[place], alone)["gain"]
        share = None if own["mean"] is None or not best else 100 * own["mean"] / best
        rows.append(
            {**row, "mean": own["mean"], "ci95": own["ci95"], "renders_add": add, "of_all": share}
        )
    worth = [
        _worth(values, counts, beside, renders)
        for renders in dict.fromkeys(renders for _, renders in values if renders != ALONE)
        for beside in BESIDE
        if (beside, renders) in values
    ]
    return {**report, "rows": rows, "worth": worth}


def _worth(values: dict[Any, list], counts: list[int], beside: int, renders: str) -> Report:
    """How many labels alone make nets as good as some labels beside renders, with the interval over seeds."""
    ours = np.array(values[beside, renders], float)  # NaN where a net failed
    alone = np.array([values[count, ALONE] for count in counts], float)

    def labels(seeds: np.ndarray) -> float:
        if np.isnan(ours[seeds]).all() or np.isnan(alone[:, seeds]).all(axis=1).any():
            return math.nan
        return reached(
            counts, np.nanmean(alone[:, seeds], axis=1).tolist(), float(np.nanmean(ours[seeds]))
        )

    found = bootstrap([len(ours)], labels, 0)
    value = found.value
    sure = (
        ""
        if value is None
        else "at most"
        if value <= counts[0]
        else "at least"
        if value >= counts[-1]
        else ""
    )
    return {
        "renders": renders, "beside": beside, "labels": value, "bound": sure,
        "ci95": found.ci95 if len(ours) > 1 else None,
    }  # fmt: skip


def text(report: Report) -> str:
    """The table, in Markdown."""
    share = report["few_share"]
    lines = [
        introduction(report),
        "",
        f"Nets ({report['net']}) are trained on labelled images of the {report['reward_images']} that there "
        f"are (a choice by seed, spread over sequences and time), alone or beside "
        f"{report['rendered_images']} rendered ones; then they are {100 * share:g} % of all batches. "
        "Intervals are over seeds of choice, streets and net.",
        "",
        *markdown(HEAD, [_cells(row) for row in report["rows"]]),
        "",
        *(said for entry in report["worth"] for said in _said(entry)),
    ]
    if report["learnt_from"]:
        lines += [
            "The search that learnt the attributes may have seen more labels than a row has.",
            "",
        ]
    return "\n".join([*lines[:-1], *failures(report["rows"])])


def _cells(row: Report) -> list[str]:
    place = [str(row["labels"]), RENDERS[row["renders"]]]
    return [*place, *cells(row), *cells(row["renders_add"], "+.1f"), number(row["of_all"], ".0f")]


def _said(entry: Report) -> list[str]:
    """A sentence about what renders are worth."""
    if entry["labels"] is None:
        return []
    what = f"Renders ({RENDERS[entry['renders']]})"
    ours = f"{entry['beside']} labelled images beside them" if entry["beside"] else "alone"
    bound = f"{entry['bound']} " if entry["bound"] else ""
    ci95 = entry["ci95"]
    sure = ""
    if ci95 is not None:
        low, high = (f"{end:.0f}" for end in ci95)
        ends = f"{low} to {high}" if low != high else f"{bound}{low}"
        sure = f" (95 % interval by bootstrap over seeds {ends})"
    verb = "with " if entry["beside"] else ""
    return [
        f"{what} {verb}{ours} are worth {bound}{entry['labels']:.0f} labelled images{sure}.",
        "",
    ]


def picture(report: Report) -> bytes:
    """MIoU against the number of labelled images, alone and beside renders, as PNG."""
    figure, axis = plt.subplots(figsize=(7, 4.5), layout="constrained")
    counts = sorted({row["labels"] for row in report["rows"]})
    nothing = min(count for count in counts if count) / 2  # where 0 stands on the logarithmic axis
    for k, renders in enumerate(dict.fromkeys(row["renders"] for row in report["rows"])):
        own = [row for row in report["rows"] if row["renders"] == renders]
        # Beside each other, lest the intervals lie on each other.
        places = [(row["labels"] or nothing) * (1 + 0.03 * k) for row in own]
        label = "labelled images alone" if renders == ALONE else f"and renders, {RENDERS[renders]}"
        curve(axis, places, own, label)
    axis.set_xscale("log")
    axis.set_xticks([count or nothing for count in counts], [str(count) for count in counts])
    axis.minorticks_off()
    axis.set(xlabel="labelled images", ylabel="mIoU on the test images, %")
    axis.legend(fontsize=8)
    figure.suptitle(f"{target_of(report)}, {report['net']}, 95 % intervals", fontsize=10)
    return png(figure)


FORM = Form("labels", derive, text, {"labels.png": picture})
"""The report of ``python -m experiments.labels``."""
