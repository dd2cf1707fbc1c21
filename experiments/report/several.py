"""Several runs on one page: rows side by side, curves over one another, and in what the runs differ."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from experiments.report import figures
from experiments.report.html import Figure, Section, document, missing, plot, table, text
from experiments.report.kept import Kept, label_of
from experiments.study.form import cells, number, words
from shell.folder import differences
from shell.progress import duration

COLOURS = ("@learnt", "@default", "@real", "@few", "@hidden", "@random")
"""Of runs, in their order."""
FREE = ("out", "workers", "store", "data", "versions")
"""Settings that decide no answer."""


def html(runs: Sequence[Kept]) -> str:
    """The whole page."""
    names = [label_of(run, runs) for run in runs]
    key = "".join(
        f'<span><i style="background:var(--{_hue(k)[1:]})"></i>{text(name)}: {text(run.summary["note"])}, '
        f"{text(run.path)}</span>"
        for k, (name, run) in enumerate(zip(names, runs, strict=True))
    )
    twins = sum(not run.summary["real"] for run in runs)
    warning = f'<p class="twin">The twin, no real data: {twins} of these runs.</p>' if twins else ""
    head = f'<h1>{len(runs)} runs side by side</h1>{warning}<div class="key">{key}</div>'
    sections = (
        result(runs, names),
        search(runs, names),
        classes(runs, names),
        attributes(runs, names),
        settings(runs, names),
    )
    return document(f"{len(runs)} runs: {', '.join(names)}", head, sections)


def _hue(number: int) -> str:
    return COLOURS[number % len(COLOURS)]


def _alike(runs: Sequence[Kept]) -> bool:
    """Whether all runs were scored on as many images of one target at one size."""
    about = {tuple(run.summary[k] for k in ("note", "test_images", "scored_at")) for run in runs}
    return len(about) == 1


def result(runs: Sequence[Kept], names: Sequence[str]) -> Section:
    """Every row of every run, and the gains."""
    there = [row for row in figures.NAMES if any(row in run.summary["rows"] for run in runs)]
    there.sort(key=lambda row: not row.startswith("few"))
    lines = [
        [figures.NAMES[row], *(_cell(run.summary["rows"].get(row), ".1f") for run in runs)]
        for row in there
    ]
    lines += [
        [what, *(_cell(run.summary[key], "+.1f") for run in runs)]
        for what, key in (
            ("learnt minus random", "gain"),
            ("learnt minus by eye", "gain_over_default"),
        )
    ]
    lines.append(["took", *(duration(run.summary["seconds"]["total"]) for run in runs)])
    shown = plot(_rows(runs, names, there), 26 * len(there) * len(runs) // 2 + 40 * len(there) + 60)
    note = (
        "mIoU in percent on the test images, with 95 % intervals over the seeds of each run."
        if _alike(runs)
        else "mIoU in percent, with 95 % intervals. These runs were scored on different images or sizes: "
        "only rows of one run may be compared."
    )
    return Section("result", "Result", shown + table(("mIoU, %", *map(text, names)), lines), note)


def _cell(entry: dict | None, form: str) -> str:
    mean, interval = cells(entry, form)
    return f"<b>{mean}</b>&ensp;{interval}" if mean else ""


def _rows(runs: Sequence[Kept], names: Sequence[str], there: Sequence[str]) -> Figure:
    """One band for each row, in it a point with its interval for each run."""
    shifts = np.linspace(0.28, -0.28, len(runs))
    data = []
    for k, (run, name) in enumerate(zip(runs, names, strict=True)):
        own = [(len(there) - 1 - n, run.summary["rows"].get(row)) for n, row in enumerate(there)]
        known = [(place, row) for place, row in own if row is not None and row["mean"] is not None]
        half = [0 if row["ci95"] is None else row["ci95"][1] - row["mean"] for _, row in known]
        data.append(
            {
                "type": "scatter", "mode": "markers", "name": name,
                "x": [row["mean"] for _, row in known], "y": [place + shifts[k] for place, _ in known],
                "error_x": {"type": "data", "array": half, "color": _hue(k), "thickness": 2, "width": 0},
                "marker": {"color": _hue(k), "size": 10},
                "customdata": [figures.said(row) for _, row in known],
                "hovertemplate": f"{name}: %{{x:.1f}} % (%{{customdata}})<extra></extra>",
            }
        )  # fmt: skip
    layout = {
        "showlegend": True,
        "xaxis": figures.AXIS,
        "yaxis": {
            "tickvals": list(range(len(there)))[::-1], "ticktext": [figures.NAMES[row] for row in there],
            "showgrid": False, "zeroline": False, "ticksuffix": "  ",
            "tickfont": {"color": "@ink", "size": 13.5},
        },
    }  # fmt: skip
    return {"data": data, "layout": layout}


def search(runs: Sequence[Kept], names: Sequence[str]) -> Section:
    """Rewards of all searches and the best so far, over one another."""
    kinds = {run.percent for run in runs}
    if len(kinds) > 1:
        return Section(
            "search", "Search", missing("These runs searched with rewards of different kinds.")
        )
    data = []
    for k, (run, name) in enumerate(zip(runs, names, strict=True)):
        rewards = run.rewards
        known = np.flatnonzero(np.isfinite(rewards))
        if not len(known):
            continue
        place, own = (known + 1).tolist(), rewards[known]
        both = {"type": "scatter", "x": place, "legendgroup": name}
        data += [
            {
                **both, "y": own.tolist(), "mode": "markers", "showlegend": False, "hoverinfo": "skip",
                "marker": {"color": _hue(k) + "/0.3", "size": 4.5},
            },
            {
                **both, "y": np.maximum.accumulate(own).tolist(), "mode": "lines", "name": name,
                "line": {"color": _hue(k), "width": 2, "shape": "hv"},
                "hovertemplate": f"{name}, best of %{{x}}: %{{y:.4~g}}<extra></extra>",
            },
        ]  # fmt: skip
    unit = (
        "mIoU on the reward images, %" if kinds == {True} else "reward, -MMD² on the reward images"
    )
    layout = {
        "showlegend": True,
        "xaxis": {"title": {"text": "evaluation"}, "zeroline": False},
        "yaxis": {"title": {"text": unit}, "zeroline": False},
    }
    return Section(
        "search",
        "Search",
        plot({"data": data, "layout": layout}, 400),
        "Points are rewards, lines the best so far.",
    )


def classes(runs: Sequence[Kept], names: Sequence[str]) -> Section:
    """IoU of each class by nets on each run's learnt streets."""
    known = list(
        dict.fromkeys(c for run in runs for c in run.summary["rows"]["learnt"]["per_class"])
    )
    lines = [
        [
            text(name),
            *(number(run.summary["rows"]["learnt"]["per_class"].get(name)) for run in runs),
        ]
        for name in known
    ]
    return Section(
        "classes",
        "Classes",
        table(("IoU, %", *map(text, names)), lines),
        "Means of nets on learnt streets.",
    )


def attributes(runs: Sequence[Kept], names: Sequence[str]) -> Section:
    """What each run has learnt, in physical units."""
    known = max((run.attributes for run in runs), key=len)
    lines = [
        [text(words(a.name)), *(_learnt(run, a.name) for run in runs), text(a.unit)] for a in known
    ]
    return Section(
        "attributes",
        "Learnt attributes",
        table(("attribute", *map(text, names), "unit"), lines),
        "From – to; of a mixture, each of its parts; of probabilities, the interval with their mean and "
        "variance.",
    )


def _learnt(run: Kept, name: str) -> str:
    found = [row["attributes"].get(name) for row in run.summary["components"]]
    ends = [
        tuple(f"{a['physical'][k]:.3g}" for k in ("low", "high")) for a in found if a is not None
    ]
    told = [low if low == high else f"{low} – {high}" for low, high in dict.fromkeys(ends)]
    return text(" | ".join(told))


def settings(runs: Sequence[Kept], names: Sequence[str]) -> Section:
    """In what the configurations differ from the first one's."""
    configs = [{k: v for k, v in run.config.items() if k not in FREE} for run in runs]
    fields = dict.fromkeys(
        name for other in configs[1:] for name, _, _ in differences(configs[0], other)
    )
    lines = [[text(name), *(text(json.dumps(_value(c, name))) for c in configs)] for name in fields]
    body = (
        table(("setting", *map(text, names)), lines)
        if lines
        else missing("They differ in nothing.")
    )
    commands = "".join(
        f"<h3>{text(name)}</h3><pre>{text(run.summary.get('command') or 'not recorded')}</pre>"
        for name, run in zip(names, runs, strict=True)
    )
    return Section("settings", "In what they differ", body + commands)


def _value(config: object, name: str) -> object:
    """A value by its dotted name; None where it is not."""
    for part in name.split("."):
        config = config.get(part) if isinstance(config, dict) else None
    return config
