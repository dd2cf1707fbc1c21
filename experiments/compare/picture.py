"""``compare.png``: accuracy and time against the number of attributes, rewards against evaluations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes

from experiments.study.figure import plt, png
from experiments.study.form import Report, half, target_of, words

COLUMNS = 3
"""Panels beside each other."""


def picture(report: Report) -> bytes:
    """The picture of a comparison, as PNG."""
    rows = report["rows"]
    methods = dict.fromkeys(row["method"] for row in rows)
    colors = {method: f"C{k % 10}" for k, method in enumerate(methods)}
    counts = {row["subset"]: row["attributes"] for row in rows}
    panels = 2 + len(counts) + (len(report["budgets"]) > 1)
    lines = -(-panels // COLUMNS)
    figure, grid = plt.subplots(
        lines, COLUMNS, figsize=(4.6 * COLUMNS, 4 * lines), layout="constrained", squeeze=False
    )
    axes = grid.ravel()
    for axis in axes[panels:]:
        axis.set_axis_off()
    accuracy, minutes, *others = axes[:panels]

    _against_attributes(accuracy, rows, colors, counts, _accuracy)
    accuracy.set(ylabel="mIoU on the test images, %", title="final nets, 95 % intervals")
    _against_attributes(minutes, rows, colors, counts, _minutes)
    minutes.set(ylabel="minutes of one core, rewards and method", title="time of the search")
    minutes.set_ylim(bottom=0)
    for axis, subset in zip(others, counts, strict=False):
        for row in rows:
            if row["subset"] == subset and row["search"] is not None:
                _rewards(axis, row, colors[row["method"]])
        axis.set(
            xlabel="evaluation", ylabel="mIoU on the reward images, %",
            title=f"{counts[subset]} attributes: mean so far (line), best (dots)",
        )  # fmt: skip
    if len(others) > len(counts):
        _gains(others[-1], report, colors)
    for axis in axes[:3]:
        if axis.get_legend_handles_labels()[1]:
            axis.legend(fontsize=8)
    spent = f"{report['evaluations']} rewards"
    if report.get("core_minutes"):
        spent = f"{report['core_minutes']:g} core-minutes"
    figure.suptitle(f"{target_of(report)}, {spent} for each method")
    return png(figure)


def _against_attributes(
    axis: Axes,
    rows: list[Report],
    colors: dict[str, str],
    counts: dict[str, int],
    value: Callable[[Report], tuple[float, float] | None],
) -> None:
    """``value`` of every row: a number and its half interval, or None."""
    subsets = list(counts)
    for k, method in enumerate(colors):
        offset = 0.06 * (k - (len(colors) - 1) / 2)  # lest the intervals lie on each other
        points = [
            (subsets.index(row["subset"]) + offset, *found)
            for row in rows
            if row["method"] == method and (found := value(row)) is not None
        ]
        _bars(axis, points, colors[method], words(method))
    axis.set_xticks(range(len(subsets)), [str(counts[subset]) for subset in subsets])
    axis.set(xlabel="attributes optimised")


def _bars(axis: Axes, points: list[tuple[float, float, float]], color: str, label: str) -> None:
    """Points (place, value, half interval), if there are any."""
    if points:
        x, y, bars = zip(*points, strict=True)
        axis.errorbar(x, y, yerr=bars, fmt="o-", ms=4, capsize=3, color=color, label=label)


def _accuracy(row: Report) -> tuple[float, float] | None:
    final = row["final"]
    return None if final is None or final["mean"] is None else (final["mean"], half(final))


def _minutes(row: Report) -> tuple[float, float] | None:
    search = row["search"]
    if search is None:
        return None
    return (search["reward_seconds"]["core"] + search["method_seconds"]["cpu"]) / 60, 0.0


def _gains(axis: Axes, report: Report, colors: dict[str, str]) -> None:
    """The gain over random attributes from the cheapest to the final budget, on the last subset."""
    rows = [row for row in report["rows"] if row["subset"] == report["rows"][-1]["subset"]]
    for k, row in enumerate(rows):
        points = [
            (place + 0.06 * k, gain["mean"], half(gain))
            for place, at in enumerate(row["budgets"])
            if row["search"] is not None and (gain := at["gain"]) is not None
        ]
        _bars(axis, points, colors[row["method"]], words(row["method"]))
    axis.axhline(0, color="0.7", lw=1)
    names = [budget.replace(", ", "\n") for budget in report["budgets"]]
    axis.set_xticks(range(len(names)), names, fontsize=8)
    axis.set(ylabel="gain over random attributes, mIoU", title="from the cheap to the final budget")


def _rewards(axis: Axes, row: Report, color: str) -> None:
    """The mean reward so far and the best, failed evaluations left out."""
    rewards = np.array([np.nan if r is None else r for r in row["search"]["rewards"]])
    seen = np.cumsum(~np.isnan(rewards))
    mean = np.where(seen > 0, np.nancumsum(rewards) / np.maximum(seen, 1), np.nan)
    x = np.arange(1, len(rewards) + 1)
    axis.plot(x, mean, color=color, label=words(row["method"]))
    axis.plot(x, np.fmax.accumulate(rewards), color=color, ls=":", lw=1)
