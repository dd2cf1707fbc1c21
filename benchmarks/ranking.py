"""Summaries of the table of searches: ranks, losses and a plot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.stats import rankdata

from benchmarks.report import Row, table

Values = Mapping[tuple[str, str], np.ndarray]
"""(method, problem) -> f64[budgets seeds]."""


def _names(values: Mapping[tuple[str, str], Any]) -> tuple[list[str], list[str]]:
    return [list(dict.fromkeys(key[i] for key in values)) for i in (0, 1)]  # type: ignore[return-value]


def mean_ranks(values: Values) -> dict[str, float]:
    """Compute the mean rank of each method over all problems and budgets, best (lowest) first."""
    methods, problems = _names(values)
    means = np.stack([[values[m, p].mean(axis=1) for p in problems] for m in methods])
    ranks = rankdata(-means, axis=0).mean(axis=(1, 2))
    return {methods[i]: float(ranks[i]) for i in np.argsort(ranks, kind="stable")}


def behind(values: Values, reference: str, budgets: tuple[int, ...]) -> list[Row]:
    """Tabulate the paired difference of a method from its best rival, also in standard errors."""
    methods, problems = _names(values)
    rivals = [method for method in methods if method != reference]
    if reference not in methods or not rivals:
        return []
    rows: list[Row] = []
    for problem in problems:
        for i, budget in enumerate(budgets):
            best = max(rivals, key=lambda m: float(values[m, problem][i].mean()))
            difference = values[reference, problem][i] - values[best, problem][i]
            many = len(difference) > 1
            se = float(difference.std(ddof=1) / np.sqrt(len(difference))) if many else None
            rows.append(
                {
                    "problem": problem,
                    "evaluations": budget,
                    "best rival": best,
                    "difference": float(difference.mean()),
                    "se": se,
                    "in se": float(difference.mean()) / se if se else None,
                }
            )
    return rows


def text(ranks: dict[str, float], lost: list[Row], reference: str) -> str:
    """Format the ranks and the losses as Markdown."""
    parts = ["Mean rank over all problems and numbers of evaluations:"]
    parts.append(table([{"method": m, "mean rank": rank} for m, rank in ranks.items()]))
    if lost:
        parts += [f"{reference} less the best rival, paired by seed:", table(lost)]
    return "\n\n".join(parts)


def plot(course: Mapping[tuple[str, str], Mapping[int, float]], path: str, reference: str) -> None:
    """Draw the value of the recommendation against evaluations, one panel per problem."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    methods, problems = _names(course)
    columns = min(3, len(problems))
    lines = -(-len(problems) // columns)
    figure, axes = plt.subplots(
        lines, columns, figsize=(4.4 * columns, 3.4 * lines), squeeze=False, layout="constrained"
    )
    for axis, problem in zip(axes.flat, problems, strict=False):
        for k, method in enumerate(methods):
            x, y = zip(*sorted(course[method, problem].items()), strict=True)
            # Other methods have ten colours, then the same with dashed lines.
            style: dict[str, Any] = {
                "lw": 1.2,
                "color": f"C{k % 10}",
                "ls": "-" if k < 10 else "--",
            }
            if method == reference:
                style = {"lw": 2.6, "color": "black", "zorder": 3}
            axis.plot(x, y, label=method.replace("_", " "), **style)
        axis.set(title=problem, xlabel="evaluations", ylabel="true value of the answer")
    for axis in axes.flat[len(problems) :]:
        axis.axis("off")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=8)
    figure.savefig(path, dpi=110)
    plt.close(figure)
