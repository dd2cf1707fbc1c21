"""The ablation in figures: ``ablation.json``, ``ablation.md`` and ``ablation.png``."""

from __future__ import annotations

from typing import Literal

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
from experiments.study.searches import Rewards, failed_evaluations, thirds
from experiments.study.stats import statistics

Variant = Literal[
    "full",
    "no_relaxation",
    "no_groups",
    "shuffled_groups",
    "no_environment",
    "no_positions",
    "no_densities",
    "random",
]
FULL: Variant = "full"
"""The whole method, from which losses are measured."""
RANDOM: Variant = "random"
"""All attributes random: what no search at all is worth."""
TITLES: dict[Variant, str] = {
    FULL: "the full method",
    "no_relaxation": "no relaxation",
    "no_groups": "no groups: all 23 in one",
    "shuffled_groups": "shuffled groups: no regard to correlation",
    "no_environment": "environment not optimised",
    "no_positions": "positions not optimised",
    "no_densities": "densities not optimised",
    RANDOM: "random attributes: no search",
}
PAPER: dict[Variant, float] = {
    "no_relaxation": -3.5,
    "no_groups": -7.9,
    "shuffled_groups": -2.9,  # 19.0 -> 16.1
    "no_environment": -3.4,
    "no_positions": -1.2,
    "no_densities": -2.1,
}
"""MIoU points against the full method (19.0). Source: the paper's ablation study."""
HEAD = (
    "variant", "mIoU", "95 % interval", "less the full method", "95 % interval",
    "the paper's own", "evaluations", "reward, first third", "last third", "best",
)  # fmt: skip


def derive(report: Report) -> Report:
    """The report with means, intervals and losses of its nets' scores."""
    (full,) = [row["nets"] for row in report["rows"] if row["variant"] == FULL]
    rows = [
        {
            **row,
            **statistics(miou(row["nets"]), miou(full)),
            "paper": PAPER.get(row["variant"]),
        }
        for row in report["rows"]
    ]
    return {**report, "rows": rows}


def text(report: Report) -> str:
    """The table, in Markdown."""
    lines = [
        f"{introduction(report)} Each variant is one search by {words(report['method'])} with "
        f"{report['evaluations']} rewards at {report['rewards_at']}: intervals do not hold what another "
        "search of the same variant would have found.",
        "",
        *markdown(HEAD, [_cells(row) for row in report["rows"]]),
        "",
        "The paper's own differences are NOT of this run: another engine, nets with ImageNet weights, "
        "300 policy updates. Rewards are of the search's datasets: without relaxation or with fewer "
        "attributes they are other datasets, so only the nets' mIoU compares variants.",
        *failures(report["rows"]),
        *failed_evaluations(_rewards(row) for row in report["rows"]),
    ]
    return "\n".join(lines)


def _rewards(row: Report) -> Rewards:
    return [] if row["search"] is None else row["search"]["rewards"]


def _cells(row: Report) -> list[str]:
    gain = row["gain"] if row["variant"] != FULL else None
    rewards = _rewards(row)
    first, last = thirds(rewards)
    return [
        TITLES[row["variant"]],
        *cells(row),
        *cells(gain, "+.1f"),
        number(row["paper"], "+.1f"),
        str(len(rewards)),
        number(first),
        number(last),
        number(max((r for r in rewards if r is not None), default=None)),
    ]


def picture(report: Report) -> bytes:
    """MIoU of every variant, and its loss beside the paper's, as PNG."""
    rows = report["rows"]
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(13, 1.6 + 0.5 * len(rows)), sharey=True, layout="constrained"
    )
    places = np.arange(len(rows))
    known = [(k, row) for k, row in enumerate(rows) if row["mean"] is not None]
    left.barh(
        [k for k, _ in known], [row["mean"] for _, row in known],
        xerr=[half(row) for _, row in known], capsize=3,
        color=["C0" if row["variant"] == FULL else "0.7" for _, row in known],
    )  # fmt: skip
    left.set_yticks(places, [TITLES[row["variant"]] for row in rows])
    left.invert_yaxis()
    left.set(xlabel="mIoU on the test images, %, 95 % intervals")
    lost = [(k, row["gain"]) for k, row in known if row["gain"] and row["variant"] != FULL]
    right.errorbar(
        [gain["mean"] for _, gain in lost], [k for k, _ in lost],
        xerr=[half(gain) for _, gain in lost],
        fmt="o", capsize=3, label="here, paired seeds",
    )  # fmt: skip
    paper = [(k, row["paper"]) for k, row in enumerate(rows) if row["paper"] is not None]
    right.plot(
        [p for _, p in paper], [k for k, _ in paper], "D", color="0.6", mfc="none",
        label="the paper's own",
    )  # fmt: skip
    right.axvline(0, color="0.7", lw=0.8)
    right.set(xlabel="mIoU points against the full method")
    right.legend(fontsize=8)
    figure.suptitle(
        f"{target_of(report)}, {words(report['method'])}, "
        f"{report['evaluations']} rewards for each variant"
    )
    return png(figure)


FORM = Form("ablation", derive, text, {"ablation.png": picture})
"""The report of ``python -m experiments.ablation``."""
