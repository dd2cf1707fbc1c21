"""``sensitivity.png``: how much each attribute matters, and how the reward changes along it."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure, SubFigure

from experiments.study.figure import plt, png
from experiments.study.form import Report, number, words

COLUMNS = 6


def picture(report: Report) -> bytes:
    """The picture, as PNG."""
    rows = report["attributes"]
    down = -(-len(rows) // COLUMNS)
    # Margins are given: a layout that is worked out takes ten seconds for so many axes.
    figure = plt.figure(figsize=(20, 2.5 * down + 0.8))
    left, right = figure.subfigures(1, 2, width_ratios=(1, 2.6), squeeze=False)[0]
    _bars(left, rows)
    _curves(right, report, down)
    note = "" if report["real"] else " (not real data)"
    r2 = number(report["r2"]["value"], ".2f") or "undefined"
    rewards = report["records"]["rewards"]
    figure.suptitle(f"{report['target']}{note}, {rewards} rewards, cross-validated R² {r2}")
    return png(figure, dpi=90)


def _bars(figure: Figure | SubFigure, rows: list[Report]) -> None:
    """Shares alone and with interactions, with their intervals, the largest on top."""
    axis = figure.subplots(gridspec_kw={"left": 0.36, "right": 0.97, "bottom": 0.07, "top": 0.92})
    places = np.arange(len(rows))
    for offset, kind, label in ((-0.2, "share", "alone"), (0.2, "total", "with interactions")):
        values = np.array([row[kind]["value"] for row in rows])
        ends = np.array([row[kind]["ci95"] for row in rows]).T
        # A skew posterior's mean may lie outside its interval.
        wings = np.maximum([values - ends[0], ends[1] - values], 0)
        axis.barh(places + offset, values, 0.4, xerr=wings, label=label, error_kw={"lw": 0.8})
    axis.set_yticks(places, [words(row["name"]) for row in rows], fontsize=8)
    axis.invert_yaxis()
    axis.set(xlabel="share of the reward's signal, %, 95 % intervals")
    axis.set_xlim(left=0)
    axis.legend(fontsize=8, loc="lower right")


def _curves(figure: Figure | SubFigure, report: Report, down: int) -> None:
    """Main effects of all attributes, in the order of the bars, on one scale of rewards."""
    margins = {"left": 0.05, "right": 0.99, "bottom": 0.05, "top": 0.92}
    spaces = {"hspace": 0.4, "wspace": 0.08}
    axes = figure.subplots(down, COLUMNS, sharey=True, gridspec_kw=margins | spaces).ravel()
    for axis in axes[len(report["attributes"]) :]:
        axis.set_axis_off()
    unit = report["curves"]["unit"]
    for row, axis in zip(report["attributes"], axes, strict=False):
        curve = report["curves"][row["name"]]
        axis.fill_between(unit, curve["low"], curve["high"], alpha=0.3, lw=0)
        axis.plot(unit, curve["mean"])
        axis.axhline(0, color="0.7", lw=0.6)
        # Evenly spaced in unit values, told in physical ones: some scales are logarithmic.
        ticks = [0, len(unit) // 2, len(unit) - 1]
        axis.set_xticks([unit[k] for k in ticks], [f"{curve['physical'][k]:.3g}" for k in ticks])
        axis.tick_params(labelsize=6)
        axis.set_title(f"{words(row['name'])}, {row['unit']}", fontsize=7)
    figure.supylabel("effect on mIoU, points, mean and 90 % band", fontsize=8)
