"""Plots of a run's search: rewards, the policy through time, what matters, what it cost."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.report.html import Figure
from experiments.report.kept import Kept
from experiments.reward.store import each
from experiments.study.form import Report, words
from scene.attributes import Attribute
from shell.lines import Record

COLUMNS = 5
"""Of the policy's small plots."""
SMALL = 128
"""Pixels from one row of small plots to the next."""
NARROW = 1 / 3
"""An interval this wide or less is drawn as strongly as a single value."""


def curve(run: Kept) -> Figure:
    """Every reward, the best so far, and what the method's model held of each update before it was made."""
    rewards = run.rewards
    place = np.arange(1, len(rewards) + 1)
    known = np.isfinite(rewards)
    unit = " %" if run.percent else ""
    form = ".1f" if run.percent else ".4f"
    best = np.fmax.accumulate(np.where(known, rewards, -np.inf)) if known.any() else rewards[:0]
    seen = np.isfinite(best)
    data = [
        *expected(run, form, unit),
        {
            "x": place[known].tolist(), "y": rewards[known].tolist(), "type": "scatter", "mode": "markers",
            "name": "reward", "marker": {"color": "@soft/0.75", "size": 5.5},
            "hovertemplate": f"evaluation %{{x}}: %{{y:{form}}}{unit}<extra></extra>",
        },
        {
            "x": place[: len(best)][seen].tolist(), "y": best[seen].tolist(), "type": "scatter",
            "mode": "lines", "name": "best so far",
            "line": {"color": "@real", "width": 2, "shape": "hv"},
            "hovertemplate": f"best so far: %{{y:{form}}}{unit}<extra></extra>",
        },
    ]  # fmt: skip
    if known.any() and not run.percent:
        named = "reward, -MMD² on the reward images"
    else:
        named = "mIoU on the reward images, %"
    layout = {
        "showlegend": True,
        "xaxis": {"title": {"text": "evaluation"}, "zeroline": False},
        "yaxis": {"title": {"text": named, "standoff": 8}, "zeroline": False},
    }
    return {"data": data, "layout": layout}


def expected(run: Kept, form: str, unit: str) -> list[dict]:
    """What the model expected of each evaluation before it was made, and one standard deviation around it."""
    if run.expected is None or not np.isfinite(run.expected).any():
        return []
    mean, std = run.expected.reshape(-1, 2).T * (100 if run.percent else 1)
    x = np.flatnonzero(np.isfinite(mean) & np.isfinite(std))
    mean, std, place = mean[x], std[x], (x + 1).tolist()
    line = {"type": "scatter", "mode": "lines", "x": place, "line": {"width": 0}}
    quiet = {"hoverinfo": "skip", "showlegend": False}
    return [
        {**line, **quiet, "y": (mean - std).tolist()},
        {
            **line, **quiet, "y": (mean + std).tolist(), "fill": "tonexty", "fillcolor": "@learnt/0.15",
        },
        {
            **line, "y": mean.tolist(), "name": "model's mean and standard deviation, before",
            "line": {"color": "@learnt", "width": 1.5},
            "hovertemplate": f"the model expected %{{y:{form}}}{unit}<extra></extra>",
        },
    ]  # fmt: skip


def policy(run: Kept) -> tuple[Figure, int] | None:
    """How likely each bin of each attribute was after every update, or where proposals lay; its height."""
    attributes = run.attributes
    recorded = run.probabilities
    if recorded is not None and recorded.shape[1] != len(attributes):
        recorded = None
    if recorded is None and not run.evaluations:
        return None
    lines = -(-len(attributes) // COLUMNS)
    height = lines * SMALL + 30
    data: list[dict] = []
    titles: list[dict] = []
    layout: dict[str, Any] = {"annotations": titles, "margin": {"l": 8, "r": 8, "t": 18, "b": 8}}
    for k, attribute in enumerate(attributes):
        line, column = divmod(k, COLUMNS)
        mark = str(k + 1) if k else ""
        wide, gap = 1 / COLUMNS, SMALL / height
        top = 1 - line * gap
        layout[f"xaxis{mark}"] = {
            "domain": [column * wide + 0.035, (column + 1) * wide - 0.008], "anchor": f"y{mark}",
            "showgrid": False, "showticklabels": line == lines - 1, "tickfont": {"size": 10}, "nticks": 4,
            "zeroline": False, "automargin": False,
        }  # fmt: skip
        layout[f"yaxis{mark}"] = {
            "domain": [top - 0.62 * gap, top - 0.02], "anchor": f"x{mark}", "range": [0, 1],
            "showgrid": False,
            "tickvals": [0, 0.5, 1], "ticktext": [f"{attribute.physical(u):.3g}" for u in (0, 0.5, 1)],
            "tickfont": {"size": 10}, "zeroline": False, "automargin": False,
        }  # fmt: skip
        titles.append(
            {
                "text": _titled(attribute), "showarrow": False,
                "x": column * wide + 0.035, "xanchor": "left", "xref": "paper",
                "y": top - 0.02, "yanchor": "bottom", "yref": "paper", "font": {"size": 11, "color": "@ink"},
            }
        )  # fmt: skip
        if recorded is not None:
            data.append(_bins(attribute, recorded[:, k], mark))
        else:
            data.append(_proposed(attribute, k, run.evaluations, mark))
    return {"data": data, "layout": layout}, height


def _titled(attribute: Attribute) -> str:
    """Name and unit; names of shares and probabilities say that themselves."""
    name = words(attribute.name)
    return name if attribute.unit in ("share", "probability") else f"{name}, {attribute.unit}"


def _bins(attribute: Attribute, probabilities: np.ndarray, mark: str) -> dict:
    """Probabilities f32[updates, bins] as a picture."""
    bins = probabilities.shape[1]
    ends = [f"{attribute.physical(k / bins):.3g}" for k in range(bins + 1)]
    said = [f"{ends[k]} to {ends[k + 1]} {attribute.unit}" for k in range(bins)]
    return {
        "type": "heatmap", "xaxis": f"x{mark}", "yaxis": f"y{mark}",
        "x": list(range(1, len(probabilities) + 1)),
        "y": [(k + 0.5) / bins for k in range(bins)], "z": np.round(100 * probabilities.T, 1).tolist(),
        "text": [[name] * len(probabilities) for name in said], "showscale": False, "zmin": 0, "zmax": 60,
        "colorscale": [[0, "@sheet"], [1, "@learnt"]],
        "hovertemplate": "update %{x}, %{text}: %{z:.0f} %<extra></extra>",
    }  # fmt: skip


def _proposed(attribute: Attribute, index: int, records: list[Record], mark: str) -> dict:
    """Centres of what was proposed, one after the other; wide intervals are pale."""
    lines = [(n, r) for n, r in enumerate(records, 1) if r["centre"] is not None]
    return {
        "type": "scatter", "mode": "markers", "xaxis": f"x{mark}", "yaxis": f"y{mark}",
        "x": [n for n, _ in lines],
        "y": [r["centre"][index] for _, r in lines],
        "text": [f"{attribute.physical(r['centre'][index]):.3g} {attribute.unit}" for _, r in lines],
        "marker": {
            "color": "@learnt", "size": 3.5,
            "opacity": [min(1.0, NARROW / max(r["width"][index], NARROW)) for _, r in lines],
        },
        "hovertemplate": "evaluation %{x}: %{text}<extra></extra>",
    }  # fmt: skip


def importance(found: Sequence[Report]) -> Figure:
    """How much of the reward's variance attributes are, alone and with others, the first at the top."""
    rows = found[::-1]
    names = [words(row["name"]) for row in rows]
    data = []
    for key, hue, name in (
        ("total", "@learnt/0.3", "with interactions"),
        ("share", "@learnt", "alone"),
    ):
        values = [row[key]["value"] for row in rows]
        ends = [row[key]["ci95"] for row in rows]
        bars = {
            "type": "data", "symmetric": False, "color": "@soft", "thickness": 1, "width": 3,
            "array": [max(e[1] - v, 0) for v, e in zip(values, ends, strict=True)],
            "arrayminus": [max(v - e[0], 0) for v, e in zip(values, ends, strict=True)],
        }  # fmt: skip
        data.append(
            {
                "type": "bar", "orientation": "h", "y": names, "x": values, "name": name,
                "marker": {"color": hue}, "error_x": bars if key == "total" else {"visible": False},
                "customdata": [
                    [f"{e[0]:.1f} to {e[1]:.1f}", f"{row['best']:.3g} {row['unit']}", row["worth"]]
                    for row, e in zip(rows, ends, strict=True)
                ],
                "hovertemplate": f"%{{y}}, {name}: %{{x:.1f}} % (%{{customdata[0]}})<br>best at "
                "%{customdata[1]}, worth %{customdata[2]:.1f} points<extra></extra>",
            }
        )  # fmt: skip
    layout = {
        "barmode": "overlay", "showlegend": True, "bargap": 0.35, "legend": {"traceorder": "reversed"},
        "xaxis": {"title": {"text": "share of the reward's variance, %"}, "rangemode": "tozero"},
        "yaxis": {"ticksuffix": "  ", "showgrid": False},
    }  # fmt: skip
    return {"data": data, "layout": layout}


STAGES = {"candidate": "model selection", "final": "final nets"}
"""What logs call nets, for people; rungs of the ladder select, too."""


def costs(run: Kept) -> dict[str, dict[str, float]]:
    """CPU seconds of rendering and of training, and the number of nets, by stage in the order of the work."""
    found: dict[str, dict[str, float]] = defaultdict(
        lambda: {"nets": 0, "render": 0.0, "train": 0.0}
    )
    staged = [("search", line) for line in each(run.evaluations)]
    staged += [(_stage(line), line) for line in each(run.finals)]
    for stage, line in staged:
        own = found[stage]
        own["nets"] += 1
        own["render"] += line["render_seconds"]
        own["train"] += line["train_seconds"]
    return dict(found)


def _stage(line: Record) -> str:
    name = str(line.get("nets", "other nets"))
    return (
        f"model selection, {name.replace('-', ' ')}"
        if name.startswith("rung")
        else STAGES.get(name, name)
    )


def cost(found: dict[str, dict[str, float]]) -> Figure:
    """CPU minutes of each stage."""
    stages = list(found)[::-1]
    data = [
        {
            "type": "bar", "orientation": "h", "name": name, "marker": {"color": hue},
            "y": stages, "x": [found[s][key] / 60 for s in stages],
            "hovertemplate": f"%{{y}}, {name}: %{{x:.1f}} min<extra></extra>",
        }
        for key, name, hue in (
            ("render", "rendering", "@default"),
            ("train", "training and scoring", "@learnt"),
        )
    ]  # fmt: skip
    layout = {
        "barmode": "stack", "showlegend": True, "bargap": 0.4, "legend": {"traceorder": "normal"},
        "xaxis": {"title": {"text": "minutes on one core"}},
        "yaxis": {"ticksuffix": "  ", "showgrid": False},
    }  # fmt: skip
    return {"data": data, "layout": layout}
