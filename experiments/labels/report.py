"""Labelled images and renders in figures: ``labels.json``, ``labels.md`` and ``labels.png``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import stats

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

ALONE = "none"
"""In place of the name of a set of renders: labelled images alone."""
RENDERS = {
    ALONE: "none",
    "random": "random attributes",
    "default": "attributes set by eye",
    "mixed": "half of them random, half by eye",
    "learnt": "learnt attributes",
}
GRID = 201
"""Numbers of labels, evenly over log N, at which a paired interval is worked out, beside the nets' own."""
BESIDE = (0, 14)
"""Numbers of labelled images beside which it is told how many more the renders are worth."""
HEAD = (
    "labelled images", "renders", "mIoU", "95 % interval", "renders add", "95 % interval", "of all labels, %",
)  # fmt: skip


def reached(counts: Sequence[float], curve: Sequence[float], value: float) -> float:
    """Where a curve over numbers of labels first reaches a value.

    Between numbers it is straight over log N. Where even the first is higher that one is given, where none
    is as high the last.

    Args:
        counts: numbers of labels above 0, in the order in which the curve is followed.
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
    """How many labels alone make nets as good as some labels beside renders, and the 95 % interval."""
    ours = np.array(values[beside, renders], float)  # NaN where a net failed
    alone = np.array([values[count, ALONE] for count in counts], float)
    known = np.isfinite(ours) & np.isfinite(alone).all(axis=0)
    value, ci95 = worth(counts, alone[:, known], ours[known])
    sure = (
        ""
        if value is None
        else "at most"
        if value <= counts[0]
        else "at least"
        if value >= counts[-1]
        else ""
    )
    return {"renders": renders, "beside": beside, "labels": value, "bound": sure, "ci95": ci95}


def worth(
    counts: Sequence[int], alone: np.ndarray, ours: np.ndarray
) -> tuple[float | None, list[float | None] | None]:
    """How many labels alone make nets as good as others, and the 95 % confidence interval.

    The value is where the mean curve of labels alone first reaches the others' mean. The interval holds all
    numbers of labels N at which the paired t interval of (others - labels alone) holds 0, each seed's curve
    being straight over log N between its nets: the inverted paired t test, from the lowest such number to
    the highest. In simulations of 3, 5 and 10 seeds it covers the truth in 95 to 98 %. Where the test does
    not exclude the first or the last number, numbers beyond may be as good, and this end is None.

    Args:
        counts: numbers of labels above 0, ascending.
        alone: mIoU f64[counts, seeds] of nets on so many labels alone.
        ours: mIoU f64[seeds] of the others.

    Returns:
        Value and interval; None without a seed, and no interval for a single one.

    Source: Fieller (1954), "Some problems in interval estimation": a confidence set by inverting a t test.
    """
    seeds = len(ours)
    if seeds == 0:
        return None, None
    value = reached(counts, alone.mean(axis=1).tolist(), float(ours.mean()))
    if seeds == 1:
        return value, None
    first, last = counts[0], counts[-1]
    grid = np.union1d(np.geomspace(first, last, GRID), counts)
    curves = [np.interp(np.log(grid), np.log(counts), own) for own in alone.T]
    differences = ours[:, None] - np.array(curves)
    mean = differences.mean(axis=0)
    half = stats.t.ppf(0.975, seeds - 1) * differences.std(axis=0, ddof=1) / math.sqrt(seeds)
    low = reached(
        grid.tolist(), (half - mean).tolist(), 0.0
    )  # no longer surely better than labels alone
    high = reached(
        grid[::-1].tolist(), (half + mean)[::-1].tolist(), 0.0
    )  # the last that is not surely worse
    return value, [None if low <= first else low, None if high >= last else high]


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
    sure = "" if ci95 is None else f" (95 % interval {_ends(*ci95)})"
    verb = "with " if entry["beside"] else ""
    return [
        f"{what} {verb}{ours} are worth {bound}{entry['labels']:.0f} labelled images{sure}.",
        "",
    ]


def _ends(low: float | None, high: float | None) -> str:
    """An interval in words; an end that is None is open."""
    if low is None:
        return "open at both ends" if high is None else f"at most {high:.0f}"
    return f"at least {low:.0f}" if high is None else f"{low:.0f} to {high:.0f}"


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
