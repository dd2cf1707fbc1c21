"""Compare search methods, each in several searches, at equal numbers of rewards or at equal cost.

    sdr-jax study searches --target camvid --data DIR --holdout 0006R0 --space extended
    sdr-jax study searches --target camvid --data DIR --methods intervals --searches 3
    sdr-jax study searches --target camvid --data DIR --core-minutes 15   # methods at equal cost
    sdr-jax study searches --target twin --preset smoke                   # about a minute
    sdr-jax study searches --rederive runs/a/searches.json --out runs/b   # no training

The k-th search of every method has the seed --seed + k and equals the search of the main job with that seed
and method: with its --store, nothing is evaluated twice. With --core-minutes a search has as many rewards as
take so long; --subset then optimises only some attributes. Final networks of the optimised streets, of random
streets, of the default street and of the real images share their seeds, and intervals are over searches and
networks. The same command resumes a killed run.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial
from typing import Any

from common.errors import UserError, hint
from experiments.attribute_search import plans
from experiments.attribute_search.loop import Found, learn
from experiments.attribute_search.plans import SearchPlan
from experiments.config import check as check_flags
from experiments.config.cli import command
from experiments.config.jobs import ManyConfig
from experiments.evaluation.job import Source
from experiments.session.session import Session, Work
from experiments.studies.figure import plt, png
from experiments.studies.search_columns import (
    core_seconds,
    failed_evaluations,
    reward_columns,
    rewards,
)
from experiments.tables.form import (
    ONE_SEARCH,
    Column,
    Form,
    Report,
    error_bars,
    estimate,
    failures,
    introduction,
    miou,
    number,
    table,
    target_of,
    words,
)
from experiments.tables.row_names import FEW, TRAINED_ON
from experiments.tables.skeleton import Answers, Row, Search, of_rows
from experiments.tables.stats import Table, bounded, gain, less, mean, over_both
from experiments.targets.base import Target
from scene.attributes import names
from scene.proposal import describe

OVER = ("random", "default")
"""Rendered rows without a search, over which gains are measured."""
BASELINES = {row: TRAINED_ON[row] for row in (*OVER, FEW, "real")}
"""Rows without a search."""


def check(config: ManyConfig) -> None:
    """Raise UserError with the flag for a field out of range."""
    if "random_attributes" in config.methods:
        raise UserError("--methods random_attributes does not search: the row random has it")
    attributes = names(config.space)
    for name in config.subset or ():
        if name not in attributes:
            raise UserError(f"--subset: unknown attribute {name!r}; {hint(name, attributes)}")
        if name in config.held:
            raise UserError(f"--subset: attribute {name} is held by --fix")
    for name, search_config in configure_all(config).items():
        check_flags(search_config)
        plan_of(search_config, name)


def configure_all(config: ManyConfig) -> dict[str, ManyConfig]:
    """Configure every search, by name."""
    return {
        f"{method}-{seed}": replace(config, seed=seed, search=replace(config.search, method=method))
        for seed in range(config.seed, config.seed + config.searches)
        for method in config.methods
    }


def plan_of(config: ManyConfig, name: str) -> SearchPlan:
    """Plan one of the searches.

    Raises:
        UserError: an option is out of range, or the core minutes are too few.
    """
    if config.core_minutes is None:
        return plans.plan_of(config, name)
    method = config.search.method
    subset = config.subset or config.varied
    return plans.within(config, name, method, subset, config.core_minutes)


def searches(config: ManyConfig) -> dict[str, Search]:
    """Make every search."""
    return {
        name: partial(learn, config=one, name=name, plan=plan_of(one, name))
        for name, one in configure_all(config).items()
    }


def work(config: ManyConfig) -> list[Work]:
    """Plan the rewards of all searches."""
    all_plans = [plan_of(one, name) for name, one in configure_all(config).items()]
    rewards = plans.work_of(config, all_plans)
    return [rewards._replace(what=f"{rewards.what}, {len(all_plans)} searches")]


def rows(config: ManyConfig, target: Target) -> list[Row]:
    """Make rows for every search, plus the labelled subset if there is one, and rows without a search."""

    def images(side: Any, run: Session[ManyConfig], answers: Answers, seed: int) -> Source:
        return run.images(config.final, side)

    def streets(name: str, run: Session[ManyConfig], answers: Answers, seed: int) -> Source:
        return run.with_few(config.final, config.streets(name))

    def optimised(name: str, run: Session[ManyConfig], answers: Answers, seed: int) -> Source:
        answer: Found = answers[name]
        return run.with_few(config.final, answer.solution)

    def row(name: str, source: Any, after: str = "", real: bool = False) -> Row:
        return Row({"name": name}, source, config.final, "searches", name, after, real)

    return [
        *([row(FEW, partial(images, "few"), real=True)] if target.few_names else []),
        *(row(name, partial(streets, name)) for name in OVER),
        *(row(name, partial(optimised, name), name) for name in configure_all(config)),
        row("real", partial(images, "labelled"), real=True),
    ]


def report(run: Session[ManyConfig], answers: Answers, rows: list[Report]) -> Report:
    """Report the mIoU of every search's networks, and the course of the search."""
    config = run.config
    scored = {row["name"]: row["nets"] for row in rows}
    return {
        "rewards_at": config.reward.size,
        "core_minutes": config.core_minutes,
        "subset": config.subset,
        "evaluations": None if config.core_minutes else plans.plan_of(config).evaluations,
        "space": config.space,
        "baselines": {name: nets for name, nets in scored.items() if name in BASELINES},
        "searches": [
            {
                "method": one.search.method,
                "seed": one.seed,
                "rewards": rewards(answers[name]),
                "core_seconds": core_seconds(answers[name]),
                **describe(answers[name].solution),
                "nets": scored[name],
            }
            for name, one in configure_all(config).items()
        ],
    }


def derive(report: Report) -> Report:
    """Add a row for each method, over its searches and networks, and each search's gain to the report."""
    baselines = {name: miou(nets) for name, nets in report["baselines"].items()}
    real = mean(baselines["real"])

    def row(name: str, values: Table, searches: int) -> Report:
        scores = bounded(over_both(values))
        gains = {
            f"gain_over_{base}": None
            if name in BASELINES
            else over_both(less(values, baselines[base]))
            for base in OVER
        }
        share = None if scores["mean"] is None or not real else 100 * scores["mean"] / real
        return {"name": name, "searches": searches, **scores, **gains, "of_real": share}

    rows = [row(name, [values], 0) for name, values in baselines.items() if name != "real"]
    searches = []
    for search in report["searches"]:
        values = miou(search["nets"])
        gains = {f"over_{base}": gain(values, baselines[base]) for base in OVER}
        searches.append({**search, "learnt": mean(values), **gains})
    for method in dict.fromkeys(search["method"] for search in searches):
        nets = [miou(search["nets"]) for search in searches if search["method"] == method]
        rows.append(row(method, nets, len(nets)))
    rows.append(row("real", [baselines["real"]], 0))
    return {**report, "rows": rows, "searches": searches}


def _title(row: Report) -> str:
    """Write the training set of a row in words."""
    return BASELINES.get(row["name"], f"optimised by {words(row['name'])}")


COLUMNS: list[Column] = [
    ("trained on", _title),
    ("searches", lambda row: str(row["searches"] or "")),
    *estimate("mIoU"),
    *estimate("gain over random", lambda row: row["gain_over_random"], "+.1f"),
    *estimate("gain over default", lambda row: row["gain_over_default"], "+.1f"),
    ("of real, %", lambda row: number(row["of_real"], ".0f")),
]
EACH: list[Column] = [
    ("search", lambda search: words(search["method"])),
    ("seed", lambda search: str(search["seed"])),
    ("mIoU", lambda search: number(search["learnt"])),
    estimate("over random", lambda search: search["over_random"], "+.1f")[0],
    estimate("over default", lambda search: search["over_default"], "+.1f")[0],
    *reward_columns(lambda search: search["rewards"]),
]


def text(report: Report) -> str:
    """Write the tables in Markdown."""
    searches, labels = report["searches"], len(report.get("few_images", ()))
    nets = [*report["baselines"].values(), *(search["nets"] for search in searches)]
    lines = [
        introduction(report),
        "",
        f"{_spent(report)} at {report['rewards_at']} in the space {report['space']}{_subset(report)}. "
        + _intervals(report),
        *([f"All rendered sets are mixed with {labels} labelled images."] if labels else []),
        "",
        *table(COLUMNS, report["rows"]),
        "",
        "Every search: mIoU of its networks, and its rewards, in percent:",
        "",
        *table(EACH, searches),
        *failures([{"nets": row_nets} for row_nets in nets]),
        *failed_evaluations(search["rewards"] for search in searches),
    ]
    return "\n".join(lines)


def _intervals(report: Report) -> str:
    """Say what the intervals are over."""
    if _many(report):
        return (
            "Intervals of methods are over searches and seeds of networks, both random: a two-way analysis "
            "of variance with Satterthwaite's degrees of freedom."
        )
    return ONE_SEARCH


def _many(report: Report) -> bool:
    """Whether a method has several searches."""
    return max(row["searches"] or 0 for row in report["rows"]) > 1


def _spent(report: Report) -> str:
    """Say what every search had."""
    if report.get("core_minutes"):
        return f"Every search had rewards for {report['core_minutes']:g} minutes of a core"
    counts = sorted({len(search["rewards"]) for search in report["searches"]})
    return f"Every search had {' or '.join(map(str, counts))} rewards"


def _subset(report: Report) -> str:
    """Say which attributes were optimised; empty if all were."""
    subset = report.get("subset")
    return f"; {', '.join(subset)} were optimised, the others are random" if subset else ""


def picture(report: Report) -> bytes:
    """Plot the mIoU of every row with its interval, and of every search, as PNG."""
    rows = [row for row in report["rows"] if row["mean"] is not None]
    figure, axis = plt.subplots(figsize=(8, 1.2 + 0.45 * len(rows)), layout="constrained")
    for place, row in enumerate(rows):
        color = "0.4" if row["name"] in BASELINES else "C0"
        bar = error_bars([row])
        axis.errorbar(row["mean"], place, xerr=bar, fmt="o", capsize=4, color=color, zorder=3)
        searches = [s["learnt"] for s in report["searches"] if s["method"] == row["name"]]
        axis.plot(searches, [place + 0.2] * len(searches), "|", color=color, ms=9, alpha=0.7)
    axis.set_yticks(range(len(rows)), list(map(_title, rows)))
    axis.invert_yaxis()
    axis.grid(axis="x", alpha=0.3)
    over = "searches and networks" if _many(report) else "networks"
    axis.set(xlabel=f"mIoU on the test images, %\n95 % intervals over {over}; strokes: searches")
    axis.set_title(target_of(report), fontsize=10)
    return png(figure)


FORM = Form("searches", derive, text, {"searches.png": picture})
STUDY = of_rows(FORM, rows, report, check, searches, work)

if __name__ == "__main__":
    sys.exit(command("searches"))
