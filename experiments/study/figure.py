"""Figures as bytes, drawn without a display."""

from __future__ import annotations

import io
from collections.abc import Sequence

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.study.form import Report, half

__all__ = ["curve", "plt", "png"]


def curve(axis: Axes, places: Sequence[float], rows: Sequence[Report], label: str) -> None:
    """Means of a report's rows against their places, with intervals; rows without a mean are left out."""
    pairs = [(x, row) for x, row in zip(places, rows, strict=True) if row["mean"] is not None]
    points = sorted((x, row["mean"], half(row)) for x, row in pairs)
    x, y, bars = np.array(points).reshape(-1, 3).T
    axis.errorbar(x, y, yerr=bars, fmt="o-", ms=4, capsize=3, label=label)


def png(figure: Figure, dpi: int = 110, tight: bool = False) -> bytes:
    """A figure as PNG, on demand without its empty margins; it is closed."""
    data = io.BytesIO()
    figure.savefig(data, dpi=dpi, format="png", bbox_inches="tight" if tight else None)
    plt.close(figure)
    return data.getvalue()
