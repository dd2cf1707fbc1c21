"""Compares several searches of several methods, at equal numbers of rewards or at equal cost.

    sdr-jax study searches --target camvid --data DIR --holdout 0006R0 --space extended
    sdr-jax study searches --target camvid --data DIR --methods intervals --searches 3
    sdr-jax study searches --target camvid --data DIR --core-minutes 15   # methods at equal cost
    sdr-jax study searches --target twin --preset smoke                   # about a minute
    sdr-jax study searches --rederive runs/a/searches.json --out runs/b   # no net at all

The k-th search of every method has the seed --seed + k and equals the search of the main job with that seed
and method: with its --store, nothing is evaluated twice. With --core-minutes a search has as many rewards as
take so long, and its answer is its method's own; --subset then optimises some attributes alone. Final nets of
all answers, of random attributes, of the hand-set street and of the reward images share their seeds, and
intervals are over searches and nets. The same command continues a killed run.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial
from typing import Any

from experiments.config import check as check_flags
from experiments.config.cli import command
from experiments.config.studies import ManyConfig
from experiments.evaluation.job import Source
from experiments.run import few, learn, plans
from experiments.run.context import Run, Work
from experiments.run.learn import Learnt
from experiments.run.rewards import SearchPlan
from experiments.study.figure import plt, png
from experiments.study.form import (
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
from experiments.study.searches import core_seconds, failed_evaluations, rewards, selection, thirds
from experiments.study.skeleton import Made, Row, Search, do, of_rows
from experiments.study.stats import Table, bounded, gain, less, mean, over_both
from experiments.target.base import Target
from scene.attributes import names
from scene.proposal import describe
from shell.errors import UserError

BASELINES = {
    "random": "random attributes",
    "default": "hand-set attributes",
    "few": "the few labelled images alone",
    "real": "the reward images themselves",
}
"""Rows without a search."""
NETS = ("nets", "own_nets")
"""Rows of a search: the answer that model selection chose, and that of its method."""
OVER = ("random", "default")
"""Rendered rows without a search, over which gains are measured."""
OWN_ANSWER = "own "
"""Prefix of a search's name for its method's answer without model selection."""


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
    if config.core_minutes is None:
        raise UserError("--subset needs --core-minutes")
    known = names(config.space)
    for name in subset:
        if name not in known:
            raise UserError(f"--subset: attribute {name!r} is unknown; known: {', '.join(known)}")
        if name in config.held:
            raise UserError(f"--subset: attribute {name} is held by --fix")


def configured(config: ManyConfig) -> dict[str, ManyConfig]:
    """The configuration of every search by name; with equal core minutes its own answer is the candidate."""
    if config.core_minutes is not None:
        config = replace(config, candidates=("argmax",), candidate_seeds=1)
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
    """Every search, with its own model selection."""
    return {
        name: partial(learn.learn, config=own, name=name, plan=plan_of(own, name))
        for name, own in configured(config).items()
    }


def work(config: ManyConfig) -> list[Work]:
    """Plan rewards and candidates of all searches."""
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

    def images(side: Any, run: Run[ManyConfig], made: Made, seed: int) -> Source:
        return run.images(config.final, side)

    def streets(name: str, run: Run[ManyConfig], made: Made, seed: int) -> Source:
        return few.beside(run, config.final, config.streets(name))

    def answer(name: str, own: bool, run: Run[ManyConfig], made: Made, seed: int) -> Source:
        found: Learnt = made[name]
        return few.beside(run, config.final, found.found.solution if own else found.streets)

    def row(name: str, source: Any, after: str = "", real: bool = False) -> Row:
        return Row({"name": name}, source, config.final, "searches", name, after, real)

    return [
        *([row(few.FEW, partial(images, "few"), real=True)] if target.few_names else []),
        *(row(name, partial(streets, name)) for name in OVER),
        *(
            row(prefix + name, partial(answer, name, bool(prefix)), name)
            for name in configured(config)
            for prefix in _answers(config)
        ),
        row("real", partial(images, "labelled"), real=True),
    ]


def _answers(config: ManyConfig) -> tuple[str, ...]:
    """Prefixes of the names of a search's answers: the chosen one, and its method's own if it may differ."""
    return ("", OWN_ANSWER) if config.core_minutes is None else ("",)


def report(run: Run[ManyConfig], made: Made, rows: list[Report]) -> Report:
    """Report the mIoU of every search's nets, and the course of the search."""
    config = run.config
    scored = {row["name"]: row["nets"] for row in rows}
    return {
        **few.about(run),
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
                **selection(made[name]),
                "rewards": rewards(made[name].found),
                "core_seconds": core_seconds(made[name].found),
                **describe(made[name].streets),
                **{
                    kind: scored[prefix + name]
                    for kind, prefix in zip(NETS, _answers(config), strict=False)
                },
            }
            for name, own in configured(config).items()
        ],
    }


def derive(report: Report) -> Report:
    """Add rows for each method, over its searches and nets, and each search's gain to the report.

    A method has two rows: of the answers that model selection chose, and of its own if these have nets.
    """
    baselines = {name: miou(own) for name, own in report["baselines"].items()}
    real = mean(baselines["real"])

    def row(name: str, values: Table, searches: int, judged: bool = True) -> Report:
        own = bounded(over_both(values))
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
        gains = {f"over_{base}": gain(values, baselines[base]) for base in OVER}
        own = {"own_answer": mean(miou(search["own_nets"]))} if "own_nets" in search else {}
        searches.append({**search, "learnt": mean(values), **gains, **own})
    for kind in NETS:
        for method in dict.fromkeys(search["method"] for search in searches):
            nets = [s[kind] for s in searches if s["method"] == method and kind in s]
            if nets:
                rows.append(row(method, list(map(miou, nets)), len(nets), kind == "nets"))
    rows.append(row("real", [baselines["real"]], 0))
    return {**report, "rows": rows, "searches": searches}


def _title(row: Report) -> str:
    """The training set of a row in words."""
    own = "" if row["judged"] else ", without model selection"
    return BASELINES.get(row["name"], f"learnt by {words(row['name'])}{own}")


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
    ("answer", lambda search: search["chosen_candidate"]),
    ("mIoU", lambda search: number(search["learnt"])),
    estimate("over random", lambda search: search["over_random"], "+.1f")[0],
    estimate("over hand-set", lambda search: search["over_default"], "+.1f")[0],
    ("its method's own answer, mIoU", lambda search: number(search.get("own_answer"))),
    ("rewards", lambda search: str(len(search["rewards"]))),
    ("reward, first third", lambda search: number(thirds(search["rewards"])[0])),
    ("last third", lambda search: number(thirds(search["rewards"])[1])),
    ("best", lambda search: number(_best(search))),
]


def text(report: Report) -> str:
    """The tables, in Markdown."""
    searches, beside = report["searches"], len(report.get("few_images", ()))
    nets = [*report["baselines"].values()]
    nets += [search[kind] for search in searches for kind in NETS if kind in search]
    lines = [
        introduction(report),
        "",
        f"{_spent(report)} at {report['rewards_at']} in the space {report['space']}; {_chosen(report)}"
        f"{_subset(report)}. " + _intervals(report),
        *([f"All rendered sets stand beside {beside} labelled images."] if beside else []),
        "",
        *table(COLUMNS, report["rows"]),
        *_hand_set(searches),
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


def _chosen(report: Report) -> str:
    """How answers were chosen, in words."""
    if report.get("core_minutes"):
        return "its answer is its method's own"
    return (
        "its answer was chosen on the reward images, among its method's in several readings and the "
        "hand-set street"
    )


def _subset(report: Report) -> str:
    """Which attributes were optimised, in words; nothing where all were."""
    subset = report.get("subset")
    return f"; {', '.join(subset)} were optimised, the others are random" if subset else ""


def _hand_set(searches: list[Report]) -> list[str]:
    """A sentence on the number of answers that are the hand-set street, if any are."""
    counts = []
    for method in dict.fromkeys(search["method"] for search in searches):
        own = [s["chosen_candidate"] == "default" for s in searches if s["method"] == method]
        if any(own):
            counts.append(f"{sum(own)} of {len(own)} of {words(method)}")
    return ["", f"Answers that are hand-set: {', '.join(counts)}."] if counts else []


def picture(report: Report) -> bytes:
    """Draw the mIoU of every row with its interval, and of every search, as PNG."""
    rows = [row for row in report["rows"] if row["mean"] is not None]
    figure, axis = plt.subplots(figsize=(8, 1.2 + 0.45 * len(rows)), layout="constrained")
    for place, row in enumerate(rows):
        color = "0.4" if row["name"] in BASELINES else "C0"
        bar = half(row)
        axis.errorbar(row["mean"], place, xerr=bar, fmt="o", capsize=4, color=color, zorder=3)
        mine = "learnt" if row["judged"] else "own_answer"
        own = [s[mine] for s in report["searches"] if s["method"] == row["name"] and mine in s]
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
