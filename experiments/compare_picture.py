"""``compare.png``: accuracy and time against the number of attributes, rewards against evaluations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from experiments.figure import plt, png

COLUMNS = 3
"""Panels beside each other."""


def picture(report: dict[str, Any]) -> bytes:
    """The picture of a comparison, as PNG.

    Args:
        report: as in ``compare.json``.
    """
    rows = report["rows"]
    methods = list(dict.fromkeys(row["method"] for row in rows))
    subsets = list(dict.fromkeys(row["subset"] for row in rows))
    colors = {method: f"C{k % 10}" for k, method in enumerate(methods)}
    counts = {row["subset"]: row["attributes"] for row in rows}
    panels = 2 + len(subsets) + (len(report["budgets"]) > 1)
    lines = -(-panels // COLUMNS)
    figure, grid = plt.subplots(
        lines, COLUMNS, figsize=(4.6 * COLUMNS, 4 * lines), layout="constrained", squeeze=False
    )
    axes = grid.ravel()
    for axis in axes[panels:]:
        axis.set_axis_off()
    axes = axes[:panels]

    def against_attributes(axis: Axes, value: Callable[[dict[str, Any]], Any]) -> None:
        """``value`` of a row: a number and its half interval, or None."""
        for k, method in enumerate(methods):
            offset = 0.06 * (k - (len(methods) - 1) / 2)  # lest the intervals lie on each other
            points = [
                (subsets.index(row["subset"]) + offset, *found)
                for row in rows
                if row["method"] == method and (found := value(row)) is not None
            ]
            if points:
                x, y, half = zip(*points, strict=True)
                axis.errorbar(
                    x, y, yerr=half, fmt="o-", ms=4, capsize=3, color=colors[method],
                    label=_words(method),
                )  # fmt: skip
        axis.set_xticks(range(len(subsets)), [str(counts[s]) for s in subsets])
        axis.set(xlabel="attributes optimised")

    against_attributes(axes[0], _accuracy)
    axes[0].set(ylabel="mIoU on the test images, %", title="final nets, 95 % intervals")
    against_attributes(axes[1], _minutes)
    axes[1].set(ylabel="minutes of one core, rewards and method", title="time of the search")
    axes[1].set_ylim(bottom=0)
    if panels > 2 + len(subsets):
        _gains(axes[-1], report, subsets[-1], colors)
    for axis, subset in zip(axes[2 : 2 + len(subsets)], subsets, strict=True):
        for row in rows:
            if row["subset"] == subset and row["search"] is not None:
                _rewards(axis, row, colors[row["method"]])
        axis.set(
            xlabel="evaluation", ylabel="mIoU on the reward images, %",
            title=f"{counts[subset]} attributes: mean so far (line), best (dots)",
        )  # fmt: skip
    for axis in axes[:3]:
        if axis.get_legend_handles_labels()[1]:
            axis.legend(fontsize=8)
    note = "" if report["real"] else " (not real data)"
    figure.suptitle(f"{report['target']}{note}, {report['evaluations']} rewards for each method")
    return png(figure)


def _words(method: str) -> str:
    return method.replace("_", " ")


def _accuracy(row: dict[str, Any]) -> tuple[float, float] | None:
    final = row["final"]
    if final is None or final["mean"] is None:
        return None
    return final["mean"], final["mean"] - final["ci95"][0] if final["ci95"] else 0.0


def _gains(axis: Axes, report: dict[str, Any], subset: str, colors: dict[str, str]) -> None:
    """The gain over random attributes from the cheapest to the final budget, on one subset."""
    rows = [r for r in report["rows"] if r["subset"] == subset and r["method"] in colors]
    for k, row in enumerate(rows):
        points = [
            (place + 0.06 * k, gain["mean"], gain["mean"] - gain["ci95"][0] if gain["ci95"] else 0)
            for place, budget in enumerate(row["budgets"])
            if row["search"] is not None and (gain := budget["gain"]) is not None
        ]
        if points:
            x, y, half = zip(*points, strict=True)
            axis.errorbar(x, y, yerr=half, fmt="o-", ms=4, capsize=3, color=colors[row["method"]])
    axis.axhline(0, color="0.7", lw=1)
    names = [budget.replace(", ", "\n") for budget in report["budgets"]]
    axis.set_xticks(range(len(names)), names, fontsize=8)
    axis.set(ylabel="gain over random attributes, mIoU", title="from the cheap to the final budget")


def _minutes(row: dict[str, Any]) -> tuple[float, float] | None:
    search = row["search"]
    if search is None:
        return None
    return (search["reward_seconds"]["core"] + search["method_seconds"]["cpu"]) / 60, 0.0


def _rewards(axis: Axes, row: dict[str, Any], color: str) -> None:
    """The mean reward so far and the best, failed evaluations left out."""
    rewards = np.array([np.nan if r is None else r for r in row["search"]["rewards"]])
    seen = np.cumsum(~np.isnan(rewards))
    mean = np.where(seen > 0, np.nancumsum(rewards) / np.maximum(seen, 1), np.nan)
    x = np.arange(1, len(rewards) + 1)
    axis.plot(x, mean, color=color, label=_words(row["method"]))
    axis.plot(x, np.fmax.accumulate(rewards), color=color, ls=":", lw=1)
