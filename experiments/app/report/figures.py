"""All plots of a run's page: its rows, classes and images, its search, what matters and what it cost."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.app.report.folder import RunFolder
from experiments.evaluation.store import each
from experiments.tables.form import Report, interval, number, words
from experiments.tables.stats import TOO_FEW, statistics
from scene.attributes import BY_NAME, Attribute

Figure = dict[str, Any]
"""A plot: ``data`` and ``layout`` as in plotly, or ``views``, a list of such plots with a ``label`` each, of
which one is shown. A colour ``@name`` is the style sheet's ``--name``; ``@name/0.2`` is the same at opacity
0.2. ``page.js`` adds what all axes share."""

NAMES = {
    "random": "random",
    "default": "hand-set",
    "learnt": "learnt",
    "few": "few labels",
    "few+random": "few + random",
    "few+default": "few + hand-set",
    "few+learnt": "few + learnt",
    "real": "target images",
    "labels": "your labels",
    "labels+renders": "labels + renders",
    "labels+learnt": "labels + learnt",
    "renders": "renders",
}
"""Short names of rows."""
STAGES = {"final": "final nets"}
"""The kinds of nets in logs, in words."""
LEAST = 0.01
"""The least percent of the pixels that is drawn; a class with less is drawn at the edge."""
COLUMNS, SMALL = 5, 128
"""The columns of the policy's small plots, and the pixels from one row of them to the next."""
NARROW = 1 / 3
"""The width up to which an interval is drawn as strongly as a single value."""
LISTED = {"showgrid": False, "ticksuffix": "  "}
"""An axis of names."""


def ordered(report: Report) -> list[str]:
    """The rows in the order of the page: rows with few labels first, if there are any."""
    found = [row for row in NAMES if row in report["rows"]]
    return sorted(found, key=lambda row: not row.startswith("few"))


def said(entry: Report) -> str:
    """An interval in words."""
    return interval(entry["ci95"]) or TOO_FEW


def rows(report: Report, order: Sequence[str]) -> Figure:
    """Mean and interval of each row, and its single nets."""
    data, notes = [], []
    for row in reversed(order):
        entry, name, hue = report["rows"][row], NAMES[row], _colour(row)
        seeds = [value for value in entry["miou"] if value is not None]
        mark = {"color": hue, "size": 11, "symbol": "line-ns-open", "line": {"width": 1.5}}
        data.append(_points(seeds, [name] * len(seeds), f"{name}, one net: %{{x:.1f}} %", mark))
        if entry["mean"] is not None:
            mark = {"color": hue, "size": 12, "symbol": _symbol(row)}
            hover = f"{name}: %{{x:.1f}} % ({said(entry)})"
            bars = {"error_x": _around([entry], hue, 2.5)}
            data.append(_points([entry["mean"]], [name], hover, mark, **bars))
        notes.append(
            {
                "x": 1, "xref": "paper", "xanchor": "left", "y": name, "yref": "y", "showarrow": False,
                "text": f"<b>{number(entry['mean'])}</b>   {said(entry)}", "align": "left", "xshift": 14,
                "font": {"color": "@ink", "size": 13},
            }
        )  # fmt: skip
    layout = {
        "annotations": notes,
        "margin": {"l": 8, "r": 150, "t": 4, "b": 8},
        "xaxis": {"title": "mIoU, %"},
        "yaxis": LISTED | {"tickfont": {"color": "@ink", "size": 13.5}},
    }
    return {"data": data, "layout": layout}


def classes(names: Sequence[str], found: Mapping[str, Sequence[Report]]) -> Figure:
    """IoU of each class with its interval, by row; a column of points for each class."""
    order = list(found)
    there = [k for k in range(len(names)) if found[order[0]][k]["mean"] is not None]
    there.sort(key=lambda k: -(found[order[-1]][k]["mean"] or 0.0))
    shifts = np.linspace(-0.27, 0.27, len(order)) if len(order) > 1 else [0.0]
    data = []
    for row, shift in zip(order, shifts, strict=True):
        own = [found[row][k] for k in there]
        data.append(
            _points(
                [place + shift for place in range(len(there))],
                [entry["mean"] for entry in own],
                f"%{{customdata[0]}}, {NAMES[row]}: %{{y:.1f}} % (%{{customdata[1]}})",
                {"color": _colour(row), "size": 7, "symbol": _symbol(row)},
                name=NAMES[row],
                customdata=[[names[k], said(entry)] for k, entry in zip(there, own, strict=True)],
                error_y=_around(own, _colour(row) + "/0.55", 1.5),
            )
        )
    layout = {
        "showlegend": True,
        "xaxis": {
            "tickvals": list(range(len(there))), "ticktext": [names[k] for k in there],
            "tickangle": -40, "showgrid": False, "range": [-0.6, len(there) - 0.4],
        },
        "yaxis": {"title": "IoU, %", "range": [-2, 102]},
    }  # fmt: skip
    return {"data": data, "layout": layout}


def confusion(seen: Report, order: Sequence[str]) -> Figure | None:
    """For each row, the percent of each true class that is predicted as each class."""
    views = []
    for row in (row for row in order if row in seen["confusion"]):
        counts = np.asarray(seen["confusion"][row]["pixels"], float)
        there = np.flatnonzero((counts.sum(axis=1) > 0) | (counts.sum(axis=0) > 0))
        percent = 100 * counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
        percent = percent[np.ix_(there, there)][::-1]  # the first class is at the top
        names = [seen["classes"][k] for k in there]
        trace = {
            "type": "heatmap", "x": names, "y": names[::-1], "z": np.round(percent, 2).tolist(),
            "text": [[f"{v:.0f}" if v >= 1 else "" for v in line] for line in percent],
            "texttemplate": "%{text}", "textfont": {"size": 10.5, "color": "@ink"}, "xgap": 1, "ygap": 1,
            "colorscale": [[0, "@learnt/0"], [0.02, "@learnt/0.08"], [1, "@learnt/0.75"]],
            "zmin": 0, "zmax": 100, "showscale": False,
            "hovertemplate": "%{z:.1f} % of %{y} taken for %{x}<extra></extra>",
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
        label = f"{NAMES[row]}, {seen['confusion'][row]['nets']} nets"
        views.append({"label": label, "data": [trace], "layout": layout})
    return {"views": views} if views else None


def shares(seen: Report) -> Figure:
    """The share of the pixels of each class, and its mean row, for each set of images."""
    sets = [row for row in NAMES if row in seen["shares"]]
    last = seen["shares"][sets[-1]]["pixels"]  # of real images, if there are any
    order = sorted(range(len(seen["classes"])), key=lambda k: last[k])
    names = [seen["classes"][k] for k in order]
    data = []
    for row in sets:
        own = seen["shares"][row]
        same: Figure = {
            "name": f"{NAMES[row]}, {own['images']} images",
            "legendgroup": row,
            "yaxis": "y",
        }
        mark = {"color": _colour(row), "size": 8, "opacity": 0.85}
        share = [max(own["pixels"][k], LEAST) for k in order]
        hover = f"%{{y}}, {NAMES[row]}: "
        data.append(_points(share, names, hover + "%{x:.2f} % of the pixels", mark, **same))
        down, same = [own["row"][k] for k in order], same | {"xaxis": "x2", "showlegend": False}
        data.append(_points(down, names, hover + "%{x:.0f} % of the way down", mark, **same))
    layout = {
        "showlegend": True,
        "xaxis": {
            "domain": [0, 0.54], "type": "log", "title": "share of labelled pixels, %",
            "tickvals": [0.01, 0.1, 1, 10, 100], "ticktext": ["0.01", "0.1", "1", "10", "100"],
            "range": [-2.1, 2],
        },
        "xaxis2": {
            "domain": [0.6, 1], "anchor": "y", "range": [0, 100],
            "title": "mean place in the image, %: 0 top, 100 bottom",
        },
        "yaxis": {"ticksuffix": "  "},
    }  # fmt: skip
    return {"data": data, "layout": layout}


def curve(run: RunFolder) -> Figure:
    """Every reward, the best so far, and what the method's model expected of each before it was made."""
    rewards = run.rewards
    known = np.flatnonzero(np.isfinite(rewards))
    place, values = (known + 1).tolist(), rewards[known]
    form = ":.1f} %" if run.percent else ":.4f}"
    best = np.maximum.accumulate(values).tolist()
    data = [
        *_expected(run, form),
        _points(
            place, values.tolist(), "evaluation %{x}: %{y" + form,
            {"color": "@soft/0.75", "size": 5.5}, name="reward",
        ),
        _points(
            place, best, "best so far: %{y" + form, {}, name="best so far",
            mode="lines", line={"color": "@real", "width": 2, "shape": "hv"},
        ),
    ]  # fmt: skip
    unit = "mIoU on the reward images, %" if run.percent else "reward, -MMD² on the reward images"
    layout = {"showlegend": True, "xaxis": {"title": "evaluation"}, "yaxis": {"title": unit}}
    return {"data": data, "layout": layout}


def _expected(run: RunFolder, form: str) -> list[Figure]:
    """What the model expected of each evaluation before it was made, and one standard deviation around it."""
    if run.expected is None or not np.isfinite(run.expected).any():
        return []
    mean, std = run.expected.reshape(-1, 2).T * (100 if run.percent else 1)
    x = np.flatnonzero(np.isfinite(mean) & np.isfinite(std))
    mean, std, place = mean[x], std[x], (x + 1).tolist()
    edge = {"mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", "showlegend": False}
    band = {"fill": "tonexty", "fillcolor": "@learnt/0.15"}
    line = {"mode": "lines", "line": {"color": "@learnt", "width": 1.5}}
    name = "model's mean and standard deviation, before"
    return [
        _points(place, (mean - std).tolist(), "", {}, **edge),
        _points(place, (mean + std).tolist(), "", {}, **edge, **band),
        _points(place, mean.tolist(), "the model expected %{y" + form, {}, name=name, **line),
    ]


def policy(run: RunFolder) -> tuple[Figure, int] | None:
    """The probability of each bin of each attribute by update, or the proposed centres; the plot's height."""
    attributes, recorded = run.attributes, run.probabilities
    if recorded is None and not run.evaluations:
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
        trace = _proposed(run, k) if recorded is None else _bins(attribute, recorded[:, k])
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


def importance(found: Sequence[Report]) -> Figure:
    """The share of the reward's variance that each attribute explains, alone and with others."""
    rows, data = found[::-1], []
    for key, hue, name in (
        ("total", "@learnt/0.3", "with interactions"),
        ("share", "@learnt", "alone"),
    ):
        values, ends = [row[key]["value"] for row in rows], [row[key]["ci95"] for row in rows]
        told = [
            [interval(e), f"{row['best']:.3g} {row['unit']}", row["worth"]]
            for row, e in zip(rows, ends, strict=True)
        ]
        hover = (
            f"%{{y}}, {name}: %{{x:.1f}} % (%{{customdata[0]}})<br>best at %{{customdata[1]}}, worth "
            "%{customdata[2]:.1f} points"
        )
        trace = _bars(values, [words(row["name"]) for row in rows], hover, name, hue)
        if key == "total":
            trace["error_x"] = {
                "type": "data", "symmetric": False, "color": "@soft", "thickness": 1, "width": 3,
                "array": [max(e[1] - v, 0) for v, e in zip(values, ends, strict=True)],
                "arrayminus": [max(v - e[0], 0) for v, e in zip(values, ends, strict=True)],
            }  # fmt: skip
        data.append(trace | {"customdata": told})
    layout = {
        "barmode": "overlay", "showlegend": True, "bargap": 0.35, "legend": {"traceorder": "reversed"},
        "xaxis": {"title": "share of the reward's variance, %", "rangemode": "tozero", "zeroline": True},
        "yaxis": LISTED,
    }  # fmt: skip
    return {"data": data, "layout": layout}


def costs(run: RunFolder) -> dict[str, dict[str, float]]:
    """CPU seconds of rendering and of training, and the number of nets, by stage in the order of the work."""
    found: dict[str, dict[str, float]] = defaultdict(
        lambda: {"nets": 0, "render": 0.0, "train": 0.0}
    )
    if streets := run.summary.get("seconds", {}).get("streets"):
        found["streets, shared by nets"] = {"nets": 0, "render": streets, "train": 0.0}
    staged = [("search", line) for line in each(run.evaluations)]
    for line in each(run.finals):
        name = str(line.get("nets", "other nets"))
        staged.append((STAGES.get(name, name), line))
    for stage, line in staged:
        own = found[stage]
        own["nets"] += 1
        own["render"] += line["render_seconds"]
        own["train"] += line["train_seconds"]
    return dict(found)


def cost(found: dict[str, dict[str, float]]) -> Figure:
    """CPU minutes of each stage."""
    stages = list(found)[::-1]
    data = [
        _bars(
            [found[s][key] / 60 for s in stages], stages, f"%{{y}}, {name}: %{{x:.1f}} min", name, hue
        )
        for key, name, hue in (
            ("render", "rendering", "@default"),
            ("train", "training and testing", "@learnt"),
        )
    ]  # fmt: skip
    layout = {
        "barmode": "stack", "showlegend": True, "bargap": 0.4, "legend": {"traceorder": "normal"},
        "xaxis": {"title": "minutes on one core", "zeroline": True}, "yaxis": LISTED,
    }  # fmt: skip
    return {"data": data, "layout": layout}


def _points(x: list, y: list, hover: str, marker: Figure, **more: Any) -> Figure:
    """Points, each with a text for the pointer; ``more`` may turn them into lines."""
    told = {"hovertemplate": f"{hover}<extra></extra>"} if hover else {}
    return {"type": "scatter", "mode": "markers", "x": x, "y": y, "marker": marker} | told | more


def _bars(x: list, y: list, hover: str, name: str, hue: str) -> Figure:
    """Horizontal bars."""
    return {
        "type": "bar", "orientation": "h", "x": x, "y": y, "name": name, "marker": {"color": hue},
        "hovertemplate": f"{hover}<extra></extra>",
    }  # fmt: skip


def _around(entries: Sequence[Report], hue: str, thick: float) -> Figure:
    """Intervals as error bars, where there are any."""
    half = [0.0 if e["ci95"] is None else e["ci95"][1] - e["mean"] for e in entries]
    return {"type": "data", "array": half, "color": hue, "thickness": thick, "width": 0}


def by_class(nets: Sequence[Report | None], names: Sequence[str]) -> list[Report]:
    """Mean and interval of each class over nets; those that failed are left out."""
    known = [net for net in nets if net is not None]
    return [statistics([net["class_iou"][k] for net in known]) for k in range(len(names))]


def _colour(row: str) -> str:
    """The colour of a row; labels beside the renders change its symbol, not its colour."""
    return "@" + row.rpartition("+")[2]


def _symbol(row: str) -> str:
    return "diamond" if "+" in row else "circle"
