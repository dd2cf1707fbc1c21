"""Figures as bytes, drawn without a display."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

os.environ.setdefault("MPLBACKEND", "Agg")  # a notebook has set its own
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.tables.form import Report, error_bars

__all__ = ["curve", "curves", "plt", "png"]


def curve(axis: Axes, places: Sequence[float], rows: Sequence[Report], label: str) -> None:
    """Plot means of a report's rows against their places, with intervals; skip rows without a mean."""
    pairs = [(x, row) for x, row in zip(places, rows, strict=True) if row["mean"] is not None]
    pairs.sort(key=lambda pair: pair[0])
    means, bars = [row["mean"] for _, row in pairs], error_bars([row for _, row in pairs])
    axis.errorbar([x for x, _ in pairs], means, yerr=bars, fmt="o-", ms=4, capsize=3, label=label)


def curves(
    groups: Mapping[str, Sequence[Report]],
    place: Callable[[Report], float],
    ticks: Mapping[Any, str],
    across: str,
    title: str,
    log: bool = False,
) -> bytes:
    """Plot the mIoU of several groups of rows against their places, with intervals, as PNG.

    Args:
        groups: rows by label.
        place: returns the place of a row.
        ticks: labels of places.
        across: label of the horizontal axis.
        title: title of the plot.
        log: whether places are on a logarithmic scale.
    """
    figure, axis = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for k, (label, rows) in enumerate(groups.items()):
        # Groups are shifted so that intervals do not overlap.
        shift = k - (len(groups) - 1) / 2
        places = map(place, rows)
        curve(axis, [x * 1.025**shift if log else x + 0.05 * shift for x in places], rows, label)
    if log:
        axis.set_xscale("log")
    axis.set_xticks(list(ticks), list(ticks.values()))
    axis.minorticks_off()
    axis.set(xlabel=across, ylabel="mIoU on the test images, %")
    axis.legend(fontsize=8)
    figure.suptitle(title, fontsize=10)
    return png(figure)


def png(figure: Figure, dpi: int = 110) -> bytes:
    """Write a figure as PNG, and close it."""
    data = io.BytesIO()
    figure.savefig(data, dpi=dpi, format="png")
    plt.close(figure)
    return data.getvalue()
