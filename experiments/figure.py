"""Figures as bytes, drawn without a display."""

from __future__ import annotations

import io

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

__all__ = ["plt", "png"]


def png(figure: Figure, dpi: int = 110) -> bytes:
    """A figure as PNG; it is closed."""
    data = io.BytesIO()
    figure.savefig(data, dpi=dpi, format="png")
    plt.close(figure)
    return data.getvalue()
