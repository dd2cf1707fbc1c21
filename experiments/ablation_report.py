"""The ablation in figures: ``ablation.json``, ``ablation.md`` and ``ablation.png``."""

from __future__ import annotations

from typing import Any

import numpy as np

from experiments.ablation_config import FULL
from experiments.figure import plt, png
from experiments.study_report import Form, interval, markdown, miou, number, statistics

TITLES = {
    FULL: "the full method",
    "no_relaxation": "no relaxation",
    "no_groups": "no groups: all 23 in one",
    "shuffled_groups": "shuffled groups: no regard to correlation",
    "no_environment": "environment not optimised",
    "no_positions": "positions not optimised",
    "no_densities": "densities not optimised",
    "random": "random attributes: no search",
}
PAPER = {
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


def derive(report: dict[str, Any]) -> dict[str, Any]:
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


def text(report: dict[str, Any]) -> str:
    """The table, in Markdown."""
    lines = [
        f"Target: {report['note']}. mIoU in percent at {report['scored_at']} on {report['test_images']} "
        f"test images, {report['seeds']} paired seeds of the final nets, 95 % intervals by Student's t. "
        f"Each variant is one search by {report['method'].replace('_', ' ')} with "
        f"{report['evaluations']} rewards at {report['rewards_at']}: intervals do not hold what another "
        "search of the same variant would have found.",
        "",
        *markdown(HEAD, [_cells(row) for row in report["rows"]]),
        "",
        "The paper's own differences are NOT of this run: another engine, nets with ImageNet weights, "
        "300 policy updates. Rewards are of the search's datasets: without relaxation or with fewer "
        "attributes they are other datasets, so only the nets' mIoU compares variants.",
    ]
    failed = sum(net is None for row in report["rows"] for net in row["nets"])
    failed += sum(_rewards(row).count(None) for row in report["rows"])
    if failed:
        lines += ["", f"{failed} nets failed in training and are left out."]
    return "\n".join(lines)


def _rewards(row: dict[str, Any]) -> list[float | None]:
    return [] if row["search"] is None else row["search"]["rewards"]


def _cells(row: dict[str, Any]) -> list[str]:
    gain = (row["gain"] or {}) if row["variant"] != FULL else {}
    rewards = _rewards(row)
    third = max(len(rewards) // 3, 1)
    known = [r for r in rewards if r is not None]
    return [
        TITLES[row["variant"]],
        number(row["mean"]),
        interval(row["ci95"]),
        number(gain.get("mean"), "+.1f"),
        interval(gain.get("ci95")),
        number(row["paper"], "+.1f"),
        str(len(rewards)),
        number(_mean(rewards[:third])),
        number(_mean(rewards[-third:])),
        number(max(known, default=None)),
    ]


def _mean(values: list[float | None]) -> float | None:
    known = [v for v in values if v is not None]
    return float(np.mean(known)) if known else None


def picture(report: dict[str, Any]) -> bytes:
    """MIoU of every variant, and its loss beside the paper's, as PNG."""
    rows = report["rows"]
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(13, 1.6 + 0.5 * len(rows)), sharey=True, layout="constrained"
    )
    places = np.arange(len(rows))
    known = [(k, row) for k, row in enumerate(rows) if row["mean"] is not None]
    left.barh(
        [k for k, _ in known], [row["mean"] for _, row in known],
        xerr=[_half(row["mean"], row["ci95"]) for _, row in known], capsize=3,
        color=["C0" if row["variant"] == FULL else "0.7" for _, row in known],
    )  # fmt: skip
    left.set_yticks(places, [TITLES[row["variant"]] for row in rows])
    left.invert_yaxis()
    left.set(xlabel="mIoU on the test images, %, 95 % intervals")
    lost = [(k, row["gain"]) for k, row in known if row["gain"] and row["variant"] != FULL]
    right.errorbar(
        [gain["mean"] for _, gain in lost], [k for k, _ in lost],
        xerr=[_half(gain["mean"], gain["ci95"]) for _, gain in lost],
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
    note = "" if report["real"] else " (not real data)"
    figure.suptitle(
        f"{report['target']}{note}, {report['method'].replace('_', ' ')}, "
        f"{report['evaluations']} rewards for each variant"
    )
    return png(figure)


def _half(mean: float, ci95: list[float] | None) -> float:
    return mean - ci95[0] if ci95 else 0.0


FORM = Form("ablation", derive, text, picture)
"""The report of ``python -m experiments.ablation``."""
