"""Figures as bytes, drawn without a display."""

from __future__ import annotations

import io

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

__all__ = ["plt", "png"]


def png(figure: Figure, dpi: int = 110, tight: bool = False) -> bytes:
    """A figure as PNG, on demand without its empty margins; it is closed."""
    data = io.BytesIO()
    figure.savefig(data, dpi=dpi, format="png", bbox_inches="tight" if tight else None)
    plt.close(figure)
    return data.getvalue()
