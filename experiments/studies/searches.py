"""Compares several searches of several methods, at equal numbers of rewards or at equal cost.

    sdr-jax study searches --target camvid --data DIR --holdout 0006R0 --space extended
    sdr-jax study searches --target camvid --data DIR --methods intervals --searches 3
    sdr-jax study searches --target camvid --data DIR --core-minutes 15   # methods at equal cost
    sdr-jax study searches --target twin --preset smoke                   # about a minute
    sdr-jax study searches --rederive runs/a/searches.json --out runs/b   # no net at all

The k-th search of every method has the seed --seed + k and equals the search of the main job with that seed
and method: with its --store, nothing is evaluated twice. With --core-minutes a search has as many rewards as
take so long; --subset then optimises some attributes alone. Final nets of all answers, of random attributes,
of the hand-set street and of the reward images share their seeds, and intervals are over searches and nets.
The same command continues a killed run.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial
from typing import Any

from common.errors import UserError
from experiments.attribute_search import learn, plans
from experiments.attribute_search.loop import Found
from experiments.attribute_search.rewards import SearchPlan
from experiments.config import check as check_flags
from experiments.config.cli import command
from experiments.config.jobs import ManyConfig
from experiments.evaluation.job import Source
from experiments.session.session import Session, Work
from experiments.studies.figure import plt, png
from experiments.studies.search_columns import core_seconds, failed_evaluations, rewards, thirds
from experiments.tables import few_rows
from experiments.tables.form import (
    ONE_SEARCH,
    Column,
    Form,
    Report,
    estimate,
    failures,
    half,
    introduction,
    miou,
    number,
    table,
    target_of,
    words,
)
from experiments.tables.skeleton import Made, Row, Search, do, of_rows
from experiments.tables.stats import Table, bounded, gain, less, mean, over_both
from experiments.targets.base import Target
from scene.attributes import names
from scene.proposal import describe

BASELINES = {
    "random": "random attributes",
    "default": "hand-set attributes",
    "few": "the few labelled images alone",
    "real": "the reward images themselves",
}
"""Rows without a search."""
OVER = ("random", "default")
"""Rendered rows without a search, over which gains are measured."""


def check(config: ManyConfig) -> None:
    """Raise UserError with the flag for a field out of range."""
    if "random_attributes" in config.methods:
        raise UserError("--methods random_attributes searches for nothing: it is the row random")
    if config.subset is not None:
        check_subset(config.subset, config)
    for name, own in configured(config).items():
        check_flags(own)
        plan_of(own, name)


def check_subset(subset: tuple[str, ...], config: ManyConfig) -> None:
    """Raise UserError for attributes that are unknown or held, or for a subset that has no effect."""
    attributes = names(config.space)
    for name in subset:
        if name not in attributes:
            raise UserError(f"--subset: unknown attribute {name!r}; known: {', '.join(attributes)}")
        if name in config.held:
            raise UserError(f"--subset: attribute {name} is held by --fix")


def configured(config: ManyConfig) -> dict[str, ManyConfig]:
    """The configuration of every search by name."""
    return {
        f"{method}-{seed}": replace(config, seed=seed, search=replace(config.search, method=method))
        for seed in range(config.seed, config.seed + config.searches)
        for method in config.methods
    }


def plan_of(config: ManyConfig, name: str) -> SearchPlan:
    """Plan one of the searches.

    Raises:
        UserError: an option out of range, or too few core minutes.
    """
    if config.core_minutes is None:
        return learn.plan_of(config, name)
    method = config.search.method
    subset = config.subset or config.varied
    return plans.within(config, name, method, subset, config.core_minutes)


def searches(config: ManyConfig) -> dict[str, Search]:
    """Every search."""
    return {
        name: partial(learn.learn, config=own, name=name, plan=plan_of(own, name))
        for name, own in configured(config).items()
    }


def work(config: ManyConfig) -> list[Work]:
    """Plan the rewards of all searches."""
    found: dict[str, list[Work]] = {}
    for name, own in configured(config).items():
        for kind in learn.work_of(own, plan_of(own, name)):
            found.setdefault(kind.what, []).append(kind)
    return [
        kind[0]._replace(what=f"{what}, {len(kind)} searches", nets=sum(each.nets for each in kind))
        for what, kind in found.items()
    ]


def rows(config: ManyConfig, target: Target) -> list[Row]:
    """Rows of every answer, beside the few labelled images if there are any, and rows without a search."""

    def images(side: Any, run: Session[ManyConfig], made: Made, seed: int) -> Source:
        return run.images(config.final, side)

    def streets(name: str, run: Session[ManyConfig], made: Made, seed: int) -> Source:
        return run.with_few(config.final, config.streets(name))

    def answer(name: str, run: Session[ManyConfig], made: Made, seed: int) -> Source:
        found: Found = made[name]
        return run.with_few(config.final, found.solution)

    def row(name: str, source: Any, after: str = "", real: bool = False) -> Row:
        return Row({"name": name}, source, config.final, "searches", name, after, real)

    return [
        *([row(few_rows.FEW, partial(images, "few"), real=True)] if target.few_names else []),
        *(row(name, partial(streets, name)) for name in OVER),
        *(row(name, partial(answer, name), name) for name in configured(config)),
        row("real", partial(images, "labelled"), real=True),
    ]


def report(run: Session[ManyConfig], made: Made, rows: list[Report]) -> Report:
    """Report the mIoU of every search's nets, and the course of the search."""
    config = run.config
    scored = {row["name"]: row["nets"] for row in rows}
    return {
        **few_rows.about(run),
        "rewards_at": config.reward.size,
        "core_minutes": config.core_minutes,
        "subset": config.subset,
        "evaluations": None if config.core_minutes else learn.plan_of(config).evaluations,
        "space": config.space,
        "baselines": {name: own for name, own in scored.items() if name in BASELINES},
        "searches": [
            {
                "method": own.search.method,
                "seed": own.seed,
                "rewards": rewards(made[name]),
                "core_seconds": core_seconds(made[name]),
                **describe(made[name].solution),
                "nets": scored[name],
            }
            for name, own in configured(config).items()
        ],
    }


def derive(report: Report) -> Report:
    """Add a row for each method, over its searches and nets, and each search's gain to the report.

    Earlier versions chose a search's answer by model selection; of their reports the method's own is shown.
    """
    baselines = {name: miou(own) for name, own in report["baselines"].items()}
    real = mean(baselines["real"])

    def row(name: str, values: Table, searches: int) -> Report:
        own = bounded(over_both(values))
        gains = {
            f"gain_over_{base}": None
            if name in BASELINES
            else over_both(less(values, baselines[base]))
            for base in OVER
        }
        share = None if own["mean"] is None or not real else 100 * own["mean"] / real
        return {"name": name, "searches": searches, **own, **gains, "of_real": share}

    rows = [row(name, [values], 0) for name, values in baselines.items() if name != "real"]
    searches = []
    for search in report["searches"]:
        values = miou(_nets(search))
        gains = {f"over_{base}": gain(values, baselines[base]) for base in OVER}
        searches.append({**search, "learnt": mean(values), **gains})
    for method in dict.fromkeys(search["method"] for search in searches):
        nets = [miou(_nets(search)) for search in searches if search["method"] == method]
        rows.append(row(method, nets, len(nets)))
    rows.append(row("real", [baselines["real"]], 0))
    return {**report, "rows": rows, "searches": searches}


def _nets(search: Report) -> list[Report | None]:
    """Scores of the nets of a search's answer; in earlier reports another may have been chosen instead."""
    scored: list[Report | None] = search["own_nets" if "own_nets" in search else "nets"]
    return scored


def _title(row: Report) -> str:
    """The training set of a row in words."""
    return BASELINES.get(row["name"], f"learnt by {words(row['name'])}")


def _best(search: Report) -> float | None:
    return max((reward for reward in search["rewards"] if reward is not None), default=None)


COLUMNS: list[Column] = [
    ("nets trained on", _title),
    ("searches", lambda row: str(row["searches"] or "")),
    *estimate("mIoU"),
    *estimate("gain over random", lambda row: row["gain_over_random"], "+.1f"),
    *estimate("gain over hand-set", lambda row: row["gain_over_default"], "+.1f"),
    ("of real, %", lambda row: number(row["of_real"], ".0f")),
]
EACH: list[Column] = [
    ("search", lambda search: words(search["method"])),
    ("seed", lambda search: str(search["seed"])),
    ("mIoU", lambda search: number(search["learnt"])),
    estimate("over random", lambda search: search["over_random"], "+.1f")[0],
    estimate("over hand-set", lambda search: search["over_default"], "+.1f")[0],
    ("rewards", lambda search: str(len(search["rewards"]))),
    ("reward, first third", lambda search: number(thirds(search["rewards"])[0])),
    ("last third", lambda search: number(thirds(search["rewards"])[1])),
    ("best", lambda search: number(_best(search))),
]


def text(report: Report) -> str:
    """The tables, in Markdown."""
    searches, beside = report["searches"], len(report.get("few_images", ()))
    nets = [*report["baselines"].values(), *map(_nets, searches)]
    lines = [
        introduction(report),
        "",
        f"{_spent(report)} at {report['rewards_at']} in the space {report['space']}{_subset(report)}. "
        + _intervals(report),
        *([f"All rendered sets stand beside {beside} labelled images."] if beside else []),
        "",
        *table(COLUMNS, report["rows"]),
        "",
        "Every search, mIoU of its nets and rewards in percent:",
        "",
        *table(EACH, searches),
        *failures([{"nets": own} for own in nets]),
        *failed_evaluations(search["rewards"] for search in searches),
    ]
    return "\n".join(lines)


def _intervals(report: Report) -> str:
    """What the intervals are over, in words."""
    if _many(report):
        return (
            "Intervals of methods are over searches and seeds of nets, both drawn at random: a two-way "
            "analysis of variance with Satterthwaite's degrees of freedom."
        )
    return ONE_SEARCH


def _many(report: Report) -> bool:
    """Whether a method has several searches."""
    return max(row["searches"] or 0 for row in report["rows"]) > 1


def _spent(report: Report) -> str:
    """What every search had, in words."""
    if report.get("core_minutes"):
        return f"Every search had rewards for {report['core_minutes']:g} minutes of a core"
    counts = sorted({len(search["rewards"]) for search in report["searches"]})
    return f"Every search had {' or '.join(map(str, counts))} rewards"


def _subset(report: Report) -> str:
    """Which attributes were optimised, in words; nothing where all were."""
    subset = report.get("subset")
    return f"; {', '.join(subset)} were optimised, the others are random" if subset else ""


def picture(report: Report) -> bytes:
    """Draw the mIoU of every row with its interval, and of every search, as PNG."""
    rows = [row for row in report["rows"] if row["mean"] is not None]
    figure, axis = plt.subplots(figsize=(8, 1.2 + 0.45 * len(rows)), layout="constrained")
    for place, row in enumerate(rows):
        color = "0.4" if row["name"] in BASELINES else "C0"
        bar = half(row)
        axis.errorbar(row["mean"], place, xerr=bar, fmt="o", capsize=4, color=color, zorder=3)
        own = [s["learnt"] for s in report["searches"] if s["method"] == row["name"]]
        axis.plot(own, [place + 0.2] * len(own), "|", color=color, ms=9, alpha=0.7)
    axis.set_yticks(range(len(rows)), list(map(_title, rows)))
    axis.invert_yaxis()
    axis.grid(axis="x", alpha=0.3)
    over = "searches and nets" if _many(report) else "nets"
    told = f"95 % intervals over {over}; strokes: searches"
    axis.set(xlabel=f"mIoU on the test images, %\n{told}")
    axis.set_title(target_of(report), fontsize=10)
    return png(figure)


FORM = Form("searches", derive, text, {"searches.png": picture})
STUDY = of_rows(FORM, rows, report, check, searches, work)
RUN = partial(do, STUDY)

if __name__ == "__main__":
    sys.exit(command("searches"))
