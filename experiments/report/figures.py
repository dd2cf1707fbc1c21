"""Plots of a run's result: its rows, classes, confusions, and what its images hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.report.html import Figure
from experiments.study.form import Report, number
from experiments.study.stats import statistics

NAMES = {
    "random": "random",
    "default": "by eye",
    "learnt": "learnt",
    "few": "few labels",
    "few+random": "few + random",
    "few+default": "few + by eye",
    "few+learnt": "few + learnt",
    "real": "target images",
}
"""Short names of rows."""
AXIS = {"title": {"text": "mIoU, %", "standoff": 8}, "zeroline": False}
LEAST = 0.01
"""Percent of the pixels below which a class is drawn at the edge."""


def colour(row: str) -> str:
    """Of a row; with few labels beside it it has another symbol, not another colour."""
    return "@" + row.rpartition("+")[2]


def symbol(row: str) -> str:
    """Of a row."""
    return "diamond" if "+" in row else "circle"


def rows(report: Report, order: Sequence[str], names: Mapping[str, str] = NAMES) -> Figure:
    """Mean and interval of each row, and its single nets."""
    data: list[dict[str, Any]] = []
    for row in reversed(order):
        entry, name = report["rows"][row], names[row]
        seeds = [v for v in entry["miou"] if v is not None]
        data.append(
            {
                "x": seeds, "y": [name] * len(seeds), "type": "scatter", "mode": "markers",
                "marker": {
                    "color": colour(row), "size": 11, "symbol": "line-ns-open", "line": {"width": 1.5},
                },
                "hovertemplate": f"{name}, one net: %{{x:.1f}} %<extra></extra>",
            }
        )  # fmt: skip
        if entry["mean"] is not None:
            data.append(
                {
                    "x": [entry["mean"]], "y": [name], "type": "scatter", "mode": "markers",
                    "error_x": around(entry, colour(row), 2.5),
                    "marker": {"color": colour(row), "size": 12, "symbol": symbol(row)},
                    "hovertemplate": f"{name}: %{{x:.1f}} % ({said(entry)})<extra></extra>",
                }
            )  # fmt: skip
    notes = [
        {
            "x": 1, "xref": "paper", "xanchor": "left", "y": names[row], "yref": "y", "showarrow": False,
            "text": f"<b>{number(report['rows'][row]['mean'])}</b>   {said(report['rows'][row])}",
            "align": "left", "xshift": 14, "font": {"color": "@ink", "size": 13},
        }
        for row in order
    ]  # fmt: skip
    layout = {
        "annotations": notes,
        "margin": {"l": 8, "r": 150, "t": 4, "b": 8},
        "xaxis": AXIS,
        "yaxis": {
            "showgrid": False,
            "tickfont": {"color": "@ink", "size": 13.5},
            "ticksuffix": "  ",
        },
    }
    return {"data": data, "layout": layout}


def said(entry: Report) -> str:
    """An interval in words."""
    ci95 = entry["ci95"]
    return "one seed" if ci95 is None else f"{ci95[0]:.1f} to {ci95[1]:.1f}"


def around(entry: Report, hue: str, thick: float) -> dict[str, Any]:
    """A row's interval as an error bar; none for one seed."""
    half = 0.0 if entry["ci95"] is None else entry["ci95"][1] - entry["mean"]
    return {"type": "data", "array": [half], "color": hue, "thickness": thick, "width": 0}


def classes(report: Report, order: Sequence[str]) -> Figure:
    """IoU of each class with its interval over seeds; a column of points for each class."""
    found = {row: class_rows(report["nets"][row], len(report["classes"])) for row in order}
    there = [k for k in range(len(report["classes"])) if found[order[0]][k]["mean"] is not None]
    best = order[-1]
    there.sort(key=lambda k: -(found[best][k]["mean"] or 0.0))
    shifts = np.linspace(-0.27, 0.27, len(order)) if len(order) > 1 else [0.0]
    data = []
    for row, shift in zip(order, shifts, strict=True):
        own = [found[row][k] for k in there]
        half = [0 if e["ci95"] is None else e["ci95"][1] - e["mean"] for e in own]
        data.append(
            {
                "x": [place + shift for place in range(len(there))],
                "y": [e["mean"] for e in own],
                "error_y": {
                    "type": "data", "array": half, "color": colour(row) + "/0.55", "thickness": 1.5,
                    "width": 0,
                },
                "customdata": [[report["classes"][k], said(found[row][k])] for k in there],
                "type": "scatter", "mode": "markers", "name": NAMES[row],
                "marker": {"color": colour(row), "size": 7, "symbol": symbol(row)},
                "hovertemplate": f"%{{customdata[0]}}, {NAMES[row]}: %{{y:.1f}} % "
                "(%{customdata[1]})<extra></extra>",
            }
        )  # fmt: skip
    layout = {
        "showlegend": True,
        "xaxis": {
            "tickvals": list(range(len(there))), "ticktext": [report["classes"][k] for k in there],
            "tickangle": -40, "showgrid": False, "range": [-0.6, len(there) - 0.4], "zeroline": False,
        },
        "yaxis": {"title": {"text": "IoU, %", "standoff": 8}, "range": [-2, 102]},
    }  # fmt: skip
    return {"data": data, "layout": layout}


def class_rows(nets: Sequence[Report | None], classes: int) -> list[Report]:
    """Mean and interval of each class over nets; those that failed are left out."""
    known = [net for net in nets if net is not None]
    return [statistics([net["class_iou"][k] for net in known]) for k in range(classes)]


def confusion(seen: Report, order: Sequence[str]) -> Figure | None:
    """For each row, how much of each true class was taken for which, in percent of that class."""
    names = seen["classes"]
    views = []
    for row in order:
        if row not in seen["confusion"]:
            continue
        counts = np.asarray(seen["confusion"][row]["pixels"], float)
        there = np.flatnonzero((counts.sum(axis=1) > 0) | (counts.sum(axis=0) > 0))
        total = counts.sum(axis=1, keepdims=True)
        percent = 100 * counts / np.maximum(total, 1)
        percent = percent[np.ix_(there, there)][::-1]  # the first class stands at the top
        own = [names[k] for k in there]
        trace = {
            "type": "heatmap", "x": own, "y": own[::-1], "z": np.round(percent, 2).tolist(),
            "text": [[f"{v:.0f}" if v >= 1 else "" for v in line] for line in percent],
            "texttemplate": "%{text}", "textfont": {"size": 10.5, "color": "@ink"}, "xgap": 1, "ygap": 1,
            "colorscale": [[0, "@learnt/0"], [0.02, "@learnt/0.08"], [1, "@learnt/0.75"]],
            "zmin": 0, "zmax": 100, "showscale": False,
            "hovertemplate": "%{z:.1f} % of %{y} taken for %{x}<extra></extra>",
        }  # fmt: skip
        layout = {
            "xaxis": {
                "side": "top", "tickangle": -40, "showgrid": False,
                "title": {"text": "taken for", "standoff": 10},
            },
            "yaxis": {"showgrid": False, "title": {"text": "true class", "standoff": 10}, "ticksuffix": " "},
        }  # fmt: skip
        nets = seen["confusion"][row]["nets"]
        views.append({"label": f"{NAMES[row]}, {nets} nets", "data": [trace], "layout": layout})
    return {"views": views} if views else None


def shares(seen: Report) -> Figure:
    """How much of the images each class is, and how far down it lies, by set."""
    names, sets = seen["classes"], [row for row in NAMES if row in seen["shares"]]
    last = seen["shares"][sets[-1]]["pixels"]  # of real images, where there are any
    order = sorted(range(len(names)), key=lambda k: last[k])
    data = []
    for row in sets:
        own = seen["shares"][row]
        for axis, values, hover in (
            ("", [max(own["pixels"][k], LEAST) for k in order], "%{x:.2f} % of the pixels"),
            ("2", [own["row"][k] for k in order], "%{x:.0f} % of the way down"),
        ):
            data.append(
                {
                    "x": values, "y": [names[k] for k in order], "xaxis": f"x{axis}", "yaxis": "y",
                    "type": "scatter", "mode": "markers", "name": f"{NAMES[row]}, {own['images']} images",
                    "showlegend": not axis,
                    "legendgroup": row, "marker": {"color": colour(row), "size": 8, "opacity": 0.85},
                    "hovertemplate": f"%{{y}}, {NAMES[row]}: {hover}<extra></extra>",
                }
            )  # fmt: skip
    layout = {
        "showlegend": True,
        "xaxis": {
            "domain": [0, 0.54], "type": "log", "title": {"text": "share of labelled pixels, %"},
            "tickvals": [0.01, 0.1, 1, 10, 100], "ticktext": ["0.01", "0.1", "1", "10", "100"],
            "range": [-2.1, 2],
        },
        "xaxis2": {
            "domain": [0.6, 1], "anchor": "y", "range": [0, 100], "zeroline": False,
            "title": {"text": "mean place in the image, %: 0 top, 100 bottom"},
        },
        "yaxis": {"ticksuffix": "  "},
    }  # fmt: skip
    return {"data": data, "layout": layout}


def ordered(report: Report) -> list[str]:
    """The rows as they are told: those beside few labels first, where there are any."""
    found = [row for row in NAMES if row in report["rows"]]
    return sorted(found, key=lambda row: not row.startswith("few"))
