"""Many searches in figures: ``searches.json``, ``searches.md`` and ``searches.png``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from experiments.study.figure import plt, png
from experiments.study.form import (
    Form,
    Report,
    cells,
    failures,
    half,
    introduction,
    markdown,
    miou,
    number,
    target_of,
    words,
)
from experiments.study.searches import failed_evaluations, thirds
from experiments.study.stats import crossed, mean, statistics

BASELINES = {
    "random": "random attributes",
    "default": "attributes set by eye",
    "few": "the few labelled images alone",
    "real": "the reward images themselves",
}
"""Rows that no search makes."""
NETS = ("nets", "own_nets")
"""Of a search: on the answer that the judge chose, and on its method's own."""
OVER = ("random", "default")
"""Rendered rows that need no search: what gains are measured over."""
HEAD = (
    "nets trained on", "searches", "mIoU", "95 % interval",
    "gain over random", "95 % interval", "gain over by eye", "95 % interval", "of real, %",
)  # fmt: skip
EACH = (
    "search", "seed", "answer", "mIoU", "over random", "over by eye", "its method's own answer, mIoU",
    "reward, first third", "last third", "best",
)  # fmt: skip

Scores = Sequence[Sequence[float | None]]
"""One row for each search, a net for each seed; None where training failed."""


def over_both(values: Scores) -> Report:
    """Mean and interval over searches and seeds (`crossed`); seeds with a net that failed are left out."""
    known = [column for column in zip(*values, strict=True) if None not in column]
    if not known:
        return {"mean": None, "ci95": None}
    average, ci95 = crossed(np.array(known, float).T.tolist())
    return {"mean": average, "ci95": ci95}


def less(values: Scores, baseline: Sequence[float | None]) -> Scores:
    """Gains over a baseline's nets of the same seeds."""
    return [
        [
            None if a is None or b is None else a - b
            for a, b in zip(own, baseline, strict=True)
        ]
        for own in values
    ]  # fmt: skip


def derive(report: Report) -> Report:
    """The report with rows for each method, over its searches and nets, and what each search gained.

    A method has two: of the answers that the judge chose, and of its own ones, where these have nets.
    """
    baselines = {name: miou(own) for name, own in report["baselines"].items()}
    real = mean(baselines["real"])

    def row(name: str, values: Scores, searches: int, judged: bool = True) -> Report:
        own = over_both(values)
        gains = {
            f"gain_over_{base}": None
            if name in BASELINES
            else over_both(less(values, baselines[base]))
            for base in OVER
        }
        share = None if own["mean"] is None or not real else 100 * own["mean"] / real
        of_whom = {"name": name, "judged": judged, "searches": searches}
        return {**of_whom, **own, **gains, "of_real": share}

    rows = [row(name, [values], 0) for name, values in baselines.items() if name != "real"]
    searches = []
    for search in report["searches"]:
        values = miou(search["nets"])
        gains = {f"over_{base}": statistics(values, baselines[base])["gain"] for base in OVER}
        own = {"own_answer": mean(miou(search["own_nets"]))} if "own_nets" in search else {}
        searches.append({**search, "learnt": mean(values), **gains, **own})
    for kind in NETS:
        for method in dict.fromkeys(search["method"] for search in searches):
            nets = [s[kind] for s in searches if s["method"] == method and kind in s]
            if nets:
                rows.append(row(method, list(map(miou, nets)), len(nets), kind == "nets"))
    rows.append(row("real", [baselines["real"]], 0))
    return {**report, "rows": rows, "searches": searches}


def text(report: Report) -> str:
    """The tables, in Markdown."""
    rows = []
    for row in report["rows"]:
        gains = [cell for base in OVER for cell in cells(row[f"gain_over_{base}"], "+.1f")]
        searches, of_real = str(row["searches"] or ""), number(row["of_real"], ".0f")
        rows.append([_title(row), searches, *cells(row), *gains, of_real])
    each = []
    for search in report["searches"]:
        first, last = thirds(search["rewards"])
        known = [reward for reward in search["rewards"] if reward is not None]
        gains = [
            number((search[f"over_{base}"] or {"mean": None})["mean"], "+.1f") for base in OVER
        ]
        best = max(known) if known else None
        each.append([
            words(search["method"]), str(search["seed"]), search["chosen_candidate"],
            number(search["learnt"]), *gains, number(search.get("own_answer")),
            number(first), number(last), number(best),
        ])  # fmt: skip
    few = len(report.get("few_images", ()))
    nets = [{"nets": own} for own in report["baselines"].values()]
    nets += [
        {"nets": search[kind]} for search in report["searches"] for kind in NETS if kind in search
    ]
    lines = [
        introduction(report),
        "",
        f"Every search had {report['evaluations']} rewards at {report['rewards_at']} in the space "
        f"{report['space']}; its answer was chosen on the reward images, among its method's in several "
        "readings and the street set by eye. Intervals of methods are over searches and seeds of nets, "
        "both drawn at random: a two-way analysis of variance with "
        "Satterthwaite's degrees of freedom.",
        *([f"All rendered sets stand beside {few} labelled images."] if few else []),
        "",
        *markdown(HEAD, rows),
        *_by_eye(report["searches"]),
        "",
        "Every search, mIoU of its nets and rewards in percent:",
        "",
        *markdown(EACH, each),
        *failures(nets),
        *failed_evaluations(search["rewards"] for search in report["searches"]),
    ]
    return "\n".join(lines)


def _by_eye(searches: Sequence[Report]) -> list[str]:
    """A sentence about answers that are no gain over by eye by what they are, if there are any."""
    counts = []
    for method in dict.fromkeys(search["method"] for search in searches):
        own = [s["chosen_candidate"] == "default" for s in searches if s["method"] == method]
        if any(own):
            counts.append(f"{sum(own)} of {len(own)} of {words(method)}")
    return ["", f"Answers that are by eye itself: {', '.join(counts)}."] if counts else []


def _title(row: Report) -> str:
    """What the nets of a row were trained on."""
    own = "" if row["judged"] else ", without the judge"
    return BASELINES.get(row["name"], f"learnt by {words(row['name'])}{own}")


def picture(report: Report) -> bytes:
    """MIoU of every row with its interval, and of every search, as PNG."""
    rows = [row for row in report["rows"] if row["mean"] is not None]
    figure, axis = plt.subplots(figsize=(8, 1.2 + 0.45 * len(rows)), layout="constrained")
    for place, row in enumerate(rows):
        learnt = row["name"] not in BASELINES
        color = "C0" if learnt else "0.4"
        bar = half(row)
        axis.errorbar(row["mean"], place, xerr=bar, fmt="o", capsize=4, color=color, zorder=3)
        mine = "learnt" if row["judged"] else "own_answer"
        own = [s[mine] for s in report["searches"] if s["method"] == row["name"] and mine in s]
        axis.plot(own, [place + 0.2] * len(own), "|", color=color, ms=9, alpha=0.7)
    axis.set_yticks(range(len(rows)), list(map(_title, rows)))
    axis.invert_yaxis()
    axis.grid(axis="x", alpha=0.3)
    told = "95 % intervals over searches and nets; strokes: searches"
    axis.set(xlabel=f"mIoU on the test images, %\n{told}")
    axis.set_title(target_of(report), fontsize=10)
    return png(figure)


FORM = Form("searches", derive, text, {"searches.png": picture})
"""The report of ``python -m experiments.searches``."""
