"""All plots of a run's page: rows, classes, images, search, importance of attributes, and cost."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.app.report.folder import RunFolder
from experiments.evaluation.store import first_of_each
from experiments.tables.form import Report, error_bars, interval, number, words
from experiments.tables.row_names import SHORT
from experiments.tables.stats import TOO_FEW
from scene.attributes import BY_NAME, Attribute

Figure = dict[str, Any]
"""A plot: ``data`` and ``layout`` as in plotly, or ``views``, a list of such plots with a ``label`` each, of
which one is shown. A colour ``@name`` is the style sheet's ``--name``; ``@name/0.2`` is the same at opacity
0.2. ``page.js`` adds what all axes share."""

STAGES = {"final": "final networks"}
"""The kinds of networks in logs, as they are shown."""
LEAST = 0.01
"""The smallest percentage of pixels that is drawn; a class with less is drawn at the edge."""
COLUMNS, SMALL = 5, 128
"""The columns of the policy's small plots, and the pixels from one row of them to the next."""
NARROW = 1 / 3
"""The width up to which an interval is drawn as strongly as a single value."""
NAME_AXIS = {"showgrid": False, "ticksuffix": "  "}
"""An axis of names."""


def interval_text(entry: Report) -> str:
    """The interval of a row or a gain, or why there is none."""
    return interval(entry["ci95"]) or TOO_FEW


def rows(report: Report, order: Sequence[str]) -> Figure:
    """Mean and interval of each row, and its single networks."""
    data, notes = [], []
    for row in reversed(order):
        entry, name, hue = report["rows"][row], SHORT[row], _colour(row)
        seeds = [value for value in entry["miou"] if value is not None]
        mark = {"color": hue, "size": 11, "symbol": "line-ns-open", "line": {"width": 1.5}}
        data.append(_points(seeds, [name] * len(seeds), f"{name}, one network: %{{x:.1f}} %", mark))
        if entry["mean"] is not None:
            mark = {"color": hue, "size": 12, "symbol": _symbol(row)}
            hover = f"{name}: %{{x:.1f}} % ({interval_text(entry)})"
            bars = {"error_x": _around([entry], hue, 2.5)}
            data.append(_points([entry["mean"]], [name], hover, mark, **bars))
        notes.append(
            {
                "x": 1, "xref": "paper", "xanchor": "left", "y": name, "yref": "y", "showarrow": False,
                "text": f"<b>{number(entry['mean'])}</b>   {interval_text(entry)}", "align": "left",
                "xshift": 14, "font": {"color": "@ink", "size": 13},
            }
        )  # fmt: skip
    layout = {
        "annotations": notes,
        "margin": {"l": 8, "r": 150, "t": 4, "b": 8},
        "xaxis": {"title": "mIoU, %"},
        "yaxis": NAME_AXIS | {"tickfont": {"color": "@ink", "size": 13.5}},
    }
    return {"data": data, "layout": layout}


def classes(names: Sequence[str], by_row: Mapping[str, Sequence[Report]]) -> Figure:
    """IoU of each class with its interval, by row; a column of points for each class."""
    order = list(by_row)
    tested = [k for k in range(len(names)) if by_row[order[0]][k]["mean"] is not None]
    tested.sort(key=lambda k: -(by_row[order[-1]][k]["mean"] or 0.0))
    shifts = np.linspace(-0.27, 0.27, len(order)) if len(order) > 1 else [0.0]
    data = []
    for row, shift in zip(order, shifts, strict=True):
        entries = [by_row[row][k] for k in tested]
        data.append(
            _points(
                [place + shift for place in range(len(tested))],
                [entry["mean"] for entry in entries],
                f"%{{customdata[0]}}, {SHORT[row]}: %{{y:.1f}} % (%{{customdata[1]}})",
                {"color": _colour(row), "size": 7, "symbol": _symbol(row)},
                name=SHORT[row],
                customdata=[
                    [names[k], interval_text(entry)]
                    for k, entry in zip(tested, entries, strict=True)
                ],
                error_y=_around(entries, _colour(row) + "/0.55", 1.5),
            )
        )
    layout = {
        "showlegend": True,
        "xaxis": {
            "tickvals": list(range(len(tested))), "ticktext": [names[k] for k in tested],
            "tickangle": -40, "showgrid": False, "range": [-0.6, len(tested) - 0.4],
        },
        "yaxis": {"title": "IoU, %", "range": [-2, 102]},
    }  # fmt: skip
    return {"data": data, "layout": layout}


def confusion(index: Report, order: Sequence[str]) -> Figure | None:
    """For each row, the percent of each true class that is predicted as each class."""
    views = []
    for row in (row for row in order if row in index["confusion"]):
        counts = np.asarray(index["confusion"][row]["pixels"], float)
        present = np.flatnonzero((counts.sum(axis=1) > 0) | (counts.sum(axis=0) > 0))
        percent = 100 * counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
        percent = percent[np.ix_(present, present)][::-1]  # the first class is at the top
        names = [index["classes"][k] for k in present]
        trace = {
            "type": "heatmap", "x": names, "y": names[::-1], "z": np.round(percent, 2).tolist(),
            "text": [[f"{v:.0f}" if v >= 1 else "" for v in line] for line in percent],
            "texttemplate": "%{text}", "textfont": {"size": 10.5, "color": "@ink"}, "xgap": 1, "ygap": 1,
            "colorscale": [[0, "@learnt/0"], [0.02, "@learnt/0.08"], [1, "@learnt/0.75"]],
            "zmin": 0, "zmax": 100, "showscale": False,
            "hovertemplate": "%{z:.1f} % of %{y} predicted as %{x}<extra></extra>",
        }  # fmt: skip
        layout = {
            "xaxis": {
                "side": "top",
                "tickangle": -40,
                "showgrid": False,
                "title": "predicted class",
            },
            "yaxis": {"showgrid": False, "title": "true class", "ticksuffix": " "},
        }
        label = f"{SHORT[row]}, {index['confusion'][row]['nets']} networks"
        views.append({"label": label, "data": [trace], "layout": layout})
    return {"views": views} if views else None


def shares(index: Report) -> Figure:
    """The share of pixels of each class, and its mean row, for each set of images."""
    sets = [row for row in SHORT if row in index["shares"]]
    last = index["shares"][sets[-1]]["pixels"]  # of real images, if there are any
    order = sorted(range(len(index["classes"])), key=lambda k: last[k])
    names = [index["classes"][k] for k in order]
    data = []
    for row in sets:
        measured = index["shares"][row]
        same: Figure = {
            "name": f"{SHORT[row]}, {measured['images']} images",
            "legendgroup": row,
            "yaxis": "y",
        }
        mark = {"color": _colour(row), "size": 8, "opacity": 0.85}
        share = [max(measured["pixels"][k], LEAST) for k in order]
        hover = f"%{{y}}, {SHORT[row]}: "
        data.append(_points(share, names, hover + "%{x:.2f} % of the pixels", mark, **same))
        heights = [measured["row"][k] for k in order]
        same = same | {"xaxis": "x2", "showlegend": False}
        data.append(_points(heights, names, hover + "%{x:.0f} % of the way down", mark, **same))
    layout = {
        "showlegend": True,
        "xaxis": {
            "domain": [0, 0.54], "type": "log", "title": "share of labelled pixels, %",
            "tickvals": [0.01, 0.1, 1, 10, 100], "ticktext": ["0.01", "0.1", "1", "10", "100"],
            "range": [-2.1, 2],
        },
        "xaxis2": {
            "domain": [0.6, 1], "anchor": "y", "range": [0, 100],
            "title": "mean height in the image, %: 0 top, 100 bottom",
        },
        "yaxis": {"ticksuffix": "  "},
    }  # fmt: skip
    return {"data": data, "layout": layout}


def curve(run: RunFolder) -> Figure:
    """Every reward, the best so far, and what the method's model predicted for each."""
    rewards = run.rewards
    succeeded = np.flatnonzero(np.isfinite(rewards))
    place, values = (succeeded + 1).tolist(), rewards[succeeded]
    best = np.maximum.accumulate(values).tolist()
    data = [
        *_predicted(run),
        _points(
            place, values.tolist(), "evaluation %{x}: %{y:.1f} %",
            {"color": "@soft/0.75", "size": 5.5}, name="reward",
        ),
        _points(
            place, best, "best so far: %{y:.1f} %", {}, name="best so far",
            mode="lines", line={"color": "@real", "width": 2, "shape": "hv"},
        ),
    ]  # fmt: skip
    layout = {
        "showlegend": True,
        "xaxis": {"title": "evaluation"},
        "yaxis": {"title": "mIoU on the validation images, %"},
    }
    return {"data": data, "layout": layout}


def _predicted(run: RunFolder) -> list[Figure]:
    """The model's prediction of each reward before it was known, with one standard deviation."""
    if run.expected is None or not np.isfinite(run.expected).any():
        return []
    mean, std = run.expected.reshape(-1, 2).T * 100
    x = np.flatnonzero(np.isfinite(mean) & np.isfinite(std))
    mean, std, place = mean[x], std[x], (x + 1).tolist()
    edge = {"mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", "showlegend": False}
    band = {"fill": "tonexty", "fillcolor": "@learnt/0.15"}
    line = {"mode": "lines", "line": {"color": "@learnt", "width": 1.5}}
    name = "predicted reward, with standard deviation"
    return [
        _points(place, (mean - std).tolist(), "", {}, **edge),
        _points(place, (mean + std).tolist(), "", {}, **edge, **band),
        _points(place, mean.tolist(), "predicted: %{y:.1f} %", {}, name=name, **line),
    ]


def policy(run: RunFolder) -> tuple[Figure, int] | None:
    """The probability of each bin of each attribute by update, or the proposed centres; the plot's height."""
    attributes, probabilities = run.attributes, run.probabilities
    if probabilities is None and not run.evaluations:
        return None
    lines = -(-len(attributes) // COLUMNS)
    height = lines * SMALL + 30
    wide, gap = 1 / COLUMNS, SMALL / height
    data: list[Figure] = []
    titles: list[Figure] = []
    layout: Figure = {"annotations": titles, "margin": {"l": 8, "r": 8, "t": 18, "b": 8}}
    for k, attribute in enumerate(attributes):
        line, column = divmod(k, COLUMNS)
        mark, left, top = str(k + 1) if k else "", column * wide + 0.035, 1 - line * gap
        same = {"showgrid": False, "tickfont": {"size": 10}, "automargin": False}
        layout[f"xaxis{mark}"] = same | {
            "domain": [left, (column + 1) * wide - 0.008], "anchor": f"y{mark}",
            "showticklabels": line == lines - 1, "nticks": 4,
        }  # fmt: skip
        layout[f"yaxis{mark}"] = same | {
            "domain": [top - 0.62 * gap, top - 0.02], "anchor": f"x{mark}", "range": [0, 1],
            "tickvals": [0, 0.5, 1], "ticktext": [f"{attribute.physical(u):.3g}" for u in (0, 0.5, 1)],
        }  # fmt: skip
        titles.append(
            {
                "text": _titled(attribute), "showarrow": False, "x": left, "xanchor": "left",
                "xref": "paper", "y": top - 0.02, "yanchor": "bottom", "yref": "paper",
                "font": {"size": 11, "color": "@ink"},
            }
        )  # fmt: skip
        if probabilities is None:
            trace = _proposed(run, k)
        else:
            trace = _bins(attribute, probabilities[:, k])
        data.append(trace | {"xaxis": f"x{mark}", "yaxis": f"y{mark}"})
    return {"data": data, "layout": layout}, height


def _titled(attribute: Attribute) -> str:
    """Name and unit; shares and probabilities need no unit."""
    name = words(attribute.name)
    return name if attribute.unit in ("share", "probability") else f"{name}, {attribute.unit}"


def _bins(attribute: Attribute, probabilities: np.ndarray) -> Figure:
    """Probabilities f32[updates, bins] as a heat map."""
    bins = probabilities.shape[1]
    ends = [f"{attribute.physical(k / bins):.3g}" for k in range(bins + 1)]
    names = [f"{ends[k]} to {ends[k + 1]} {attribute.unit}" for k in range(bins)]
    return {
        "type": "heatmap", "x": list(range(1, len(probabilities) + 1)),
        "y": [(k + 0.5) / bins for k in range(bins)], "z": np.round(100 * probabilities.T, 1).tolist(),
        "text": [[name] * len(probabilities) for name in names], "showscale": False, "zmin": 0, "zmax": 60,
        "colorscale": [[0, "@sheet"], [1, "@learnt"]],
        "hovertemplate": "update %{x}, %{text}: %{z:.0f} %<extra></extra>",
    }  # fmt: skip


def _proposed(run: RunFolder, index: int) -> Figure:
    """The centres of proposals in order; wide intervals are pale."""
    lines = [(n, r) for n, r in enumerate(run.evaluations, 1) if r["centre"] is not None]
    attribute = run.attributes[index]
    where = list(BY_NAME).index(attribute.name)
    centres = [r["centre"][where] for _, r in lines]
    opacity = [min(1.0, NARROW / max(r["width"][where], NARROW)) for _, r in lines]
    return _points(
        [n for n, _ in lines],
        centres,
        "evaluation %{x}: %{text}",
        {"color": "@learnt", "size": 3.5, "opacity": opacity},
        text=[f"{attribute.physical(u):.3g} {attribute.unit}" for u in centres],
    )


def importance(attributes: Sequence[Report]) -> Figure:
    """The share of the reward's variance that each attribute explains, alone and with others."""
    rows, data = attributes[::-1], []
    for key, hue, name in (
        ("total", "@learnt/0.3", "with interactions"),
        ("share", "@learnt", "alone"),
    ):
        values, ends = [row[key]["value"] for row in rows], [row[key]["ci95"] for row in rows]
        details = [
            [interval(e), f"{row['best']:.3g} {row['unit']}", row["worth"]]
            for row, e in zip(rows, ends, strict=True)
        ]
        hover = (
            f"%{{y}}, {name}: %{{x:.1f}} % (%{{customdata[0]}})<br>best at %{{customdata[1]}}, gain "
            "%{customdata[2]:.1f} points"
        )
        trace = _bars(values, [words(row["name"]) for row in rows], hover, name, hue)
        if key == "total":
            trace["error_x"] = {
                "type": "data", "symmetric": False, "color": "@soft", "thickness": 1, "width": 3,
                "array": [max(e[1] - v, 0) for v, e in zip(values, ends, strict=True)],
                "arrayminus": [max(v - e[0], 0) for v, e in zip(values, ends, strict=True)],
            }  # fmt: skip
        data.append(trace | {"customdata": details})
    layout = {
        "barmode": "overlay", "showlegend": True, "bargap": 0.35, "legend": {"traceorder": "reversed"},
        "xaxis": {"title": "share of the reward's variance, %", "rangemode": "tozero", "zeroline": True},
        "yaxis": NAME_AXIS,
    }  # fmt: skip
    return {"data": data, "layout": layout}


def costs(run: RunFolder) -> dict[str, dict[str, float]]:
    """CPU seconds of rendering and training, and the number of networks, by stage in order of work."""
    stages: dict[str, dict[str, float]] = defaultdict(
        lambda: {"nets": 0, "render": 0.0, "train": 0.0}
    )
    if streets := run.summary.get("seconds", {}).get("streets"):
        stages["streets, shared by networks"] = {"nets": 0, "render": streets, "train": 0.0}
    staged = [("search", line) for line in first_of_each(run.evaluations)]
    for line in first_of_each(run.finals):
        name = str(line.get("nets", "other networks"))
        staged.append((STAGES.get(name, name), line))
    for stage, line in staged:
        total = stages[stage]
        total["nets"] += 1
        total["render"] += line["render_seconds"]
        total["train"] += line["train_seconds"]
    return dict(stages)


def cost(seconds: dict[str, dict[str, float]]) -> Figure:
    """CPU minutes of each stage."""
    stages = list(seconds)[::-1]
    data = [
        _bars(
            [seconds[s][key] / 60 for s in stages], stages, f"%{{y}}, {name}: %{{x:.1f}} min", name, hue
        )
        for key, name, hue in (
            ("render", "rendering", "@default"),
            ("train", "training and testing", "@learnt"),
        )
    ]  # fmt: skip
    layout = {
        "barmode": "stack", "showlegend": True, "bargap": 0.4, "legend": {"traceorder": "normal"},
        "xaxis": {"title": "minutes of one core", "zeroline": True}, "yaxis": NAME_AXIS,
    }  # fmt: skip
    return {"data": data, "layout": layout}


def _points(x: list, y: list, hover: str, marker: Figure, **more: Any) -> Figure:
    """Points with hover texts; ``more`` may turn them into lines."""
    template = {"hovertemplate": f"{hover}<extra></extra>"} if hover else {}
    return (
        {"type": "scatter", "mode": "markers", "x": x, "y": y, "marker": marker} | template | more
    )


def _bars(x: list, y: list, hover: str, name: str, hue: str) -> Figure:
    """Horizontal bars."""
    return {
        "type": "bar", "orientation": "h", "x": x, "y": y, "name": name, "marker": {"color": hue},
        "hovertemplate": f"{hover}<extra></extra>",
    }  # fmt: skip


def _around(entries: Sequence[Report], hue: str, thick: float) -> Figure:
    """Intervals as error bars, where there are any."""
    below, above = error_bars(entries)
    return {
        "type": "data", "symmetric": False, "array": above, "arrayminus": below, "color": hue,
        "thickness": thick, "width": 0,
    }  # fmt: skip


def _colour(row: str) -> str:
    """The colour of a row; labels added to the renders change its symbol, not its colour."""
    return "@" + row.rpartition("+")[2]


def _symbol(row: str) -> str:
    return "diamond" if "+" in row else "circle"
