"""Compare search methods on real rewards, at equal numbers of evaluations.

    sdr-jax study compare --target camvid --data DIR --holdout 0006R0     # the paper's figure
    sdr-jax study compare --target twin --preset smoke                    # seconds
    sdr-jax study compare --methods sdr cma_es --subsets all --no-finals  # only record rewards
    sdr-jax study compare --rederive runs/a/compare.json --out runs/b     # no net at all

Every method optimises 3, 5 and 7 positions with all other attributes random; nets trained on the answers are
tested on the test images. The same command continues a killed run.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from experiments.config import Fidelity
from experiments.config.cli import command
from experiments.config.studies import CompareConfig
from experiments.evaluation.job import Source
from experiments.run import plans
from experiments.run.context import Run, Work
from experiments.run.fidelities import fidelities
from experiments.run.rewards import SearchPlan
from experiments.run.search import Found, search
from experiments.study.figure import plt, png
from experiments.study.form import (
    Column,
    Form,
    Report,
    cells,
    estimate,
    failures,
    half,
    markdown,
    miou,
    number,
    starts,
    table,
    target_of,
    words,
)
from experiments.study.searches import core_seconds, failed_evaluations, rewards, thirds
from experiments.study.skeleton import Made, Row, Search, do, of_rows
from experiments.study.stats import statistics
from experiments.target.base import Target
from scene.attributes import names
from sdr_jax.names import MethodName
from shell.errors import UserError, refuse_repeats

RANDOM: MethodName = "random_attributes"
"""The row from which gains are measured; it needs no evaluation."""
ALL = "all"
"""The word for the subset of all attributes that are not held."""


class Compared(NamedTuple):
    """A method on a subset, which is a row of the table."""

    method: MethodName
    subset: tuple[str, ...]
    title: str  # the subset in one word
    name: str  # such as "sdr, 3 attributes"; no two rows share one


def check(config: CompareConfig) -> None:
    """Raise UserError with the flag for a field out of range."""
    if not config.subsets:
        raise UserError("--subsets needs at least one value")
    known = names(config.space)
    for subset in subsets_of(config):
        for name in subset:
            if name not in known:
                raise UserError(
                    f"--subsets: attribute {name!r} is unknown; known: {ALL}, {', '.join(known)}"
                )
            if name in config.held:
                raise UserError(f"--subsets: attribute {name} is held by --fix")
        refuse_repeats("--subsets", subset)
    refuse_repeats("--subsets", [",".join(sorted(subset)) for subset in subsets_of(config)])
    planned(config)


def subsets_of(config: CompareConfig) -> list[tuple[str, ...]]:
    """The subsets, with the word ``all`` spelt out."""
    return [config.varied if subset == (ALL,) else subset for subset in config.subsets]


def compared(config: CompareConfig) -> list[Compared]:
    """Methods and subsets in the order of the table."""
    subsets = subsets_of(config)
    sizes = [len(subset) for subset in subsets]
    found = []
    for subset in subsets:
        alone = sizes.count(len(subset)) == 1
        told = f"{len(subset)} attributes" if alone else ",".join(subset)
        title = ALL if set(subset) == set(config.varied) else ",".join(subset)
        found += [Compared(method, subset, title, f"{method}, {told}") for method in config.methods]
    return found


def planned(config: CompareConfig) -> list[SearchPlan]:
    """Plan every search.

    Raises:
        UserError: too few evaluations, or an option that a method lacks.
    """
    found = []
    for row in compared(config):
        own = row.name, row.method, row.subset
        if row.method == RANDOM:
            continue
        if config.core_minutes is None:
            found.append(plans.plan(config, *own, config.evaluations))
        else:
            found.append(plans.within(config, *own, config.core_minutes))
    return found


def searches(config: CompareConfig) -> dict[str, Search]:
    """Every method's search on every subset."""
    return {plan.name: partial(search, plan=plan) for plan in planned(config)}


def work(config: CompareConfig) -> list[Work]:
    """The rewards of these searches."""
    return [plans.work_of(config, planned(config))]


def budgets(config: CompareConfig) -> tuple[Fidelity, ...]:
    """The fidelities at which answers are tested, the final one last."""
    if not config.finals:
        return ()
    return fidelities(config.reward, config.final) if config.cheap_finals else (config.final,)


def said(fidelity: Fidelity) -> str:
    """Describe a fidelity in a few words."""
    return f"{fidelity.size}, {fidelity.images} images, {fidelity.train.steps} steps"


def rows(config: CompareConfig, _: Target) -> list[Row]:
    """Rows of nets of every answer at every budget."""

    def source(own: Compared, run: Run[CompareConfig], made: Made, seed: int) -> Source:
        if own.method == RANDOM:
            return config.streets("random")
        found: Found = made[own.name]
        return found.solution

    return [
        Row(
            {"name": own.name},
            partial(source, own),
            at,
            what=said(at),
            name=own.name,
            after="" if own.method == RANDOM else own.name,
        )
        for at in budgets(config)
        for own in compared(config)
    ]


def report(run: Run[CompareConfig], made: Made, rows: list[Report]) -> Report:
    """Report the mIoU of every method, subset and budget with the search."""
    config, workers = run.config, max(run.workers.workers, 1)
    return {
        "evaluations": config.evaluations if config.core_minutes is None else None,
        "core_minutes": config.core_minutes,
        "workers": workers,
        "rewards_at": config.reward.size,
        "seeds": config.seeds if config.finals else 0,
        "budgets": [said(fidelity) for fidelity in budgets(config)],
        "rows": [
            {
                "attributes": len(own.subset),
                "subset": own.title,
                "method": own.method,
                "search": _search(config, made[own.name], own, workers)
                if own.name in made
                else None,
                "budgets": [{"miou": miou(at["nets"])} for at in rows if at["name"] == own.name],
            }
            for own in compared(config)
        ],
    }


def _search(config: CompareConfig, found: Found, own: Compared, workers: int) -> Report:
    core = core_seconds(found)
    cpu, wall = round(found.cpu_seconds, 2), round(found.wall_seconds, 2)
    pairs = zip(names(config.space), *(part.tolist() for part in found.solution), strict=True)
    return {
        "rewards": rewards(found),
        "reward_seconds": {"core": core, "wall": round(core / workers, 2)},
        "method_seconds": {"cpu": cpu, "wall": wall},
        "solution": {
            name: {"centre": round(centre, 6), "width": round(width, 6)}
            for name, centre, width in pairs
            if name in own.subset
        },
    }


def derive(report: Report) -> Report:
    """Add means, intervals and gains of the nets, and figures of the rewards, to the report."""
    random = {row["subset"]: row["budgets"] for row in report["rows"] if row["method"] == RANDOM}
    return {**report, "rows": [_derived(row, random.get(row["subset"])) for row in report["rows"]]}


def _derived(row: Report, random: Sequence[Report] | None) -> Report:
    baselines = [None] * len(row["budgets"]) if random is None else [at["miou"] for at in random]
    budgets = [
        {"miou": at["miou"], **statistics(at["miou"], baseline)}
        for at, baseline in zip(row["budgets"], baselines, strict=True)
    ]
    search = row["search"]
    if search is not None:
        values = search["rewards"]
        counts = {"evaluations": len(values), "failed": values.count(None)}
        ends = dict(zip(("first_third", "last_third"), thirds(values), strict=True))
        search = {**search, **counts, **ends}
    return {
        **row,
        "search": search,
        "final": budgets[-1] if budgets else None,
        "budgets": budgets,
    }


def _spent(*keys: str) -> Any:
    """A cell with a figure of the row's search, empty without a search."""

    def value(row: Report) -> Any:
        found = row["search"]
        for key in keys:
            found = found and found.get(key)
        return found

    return value


COLUMNS: list[Column] = [
    ("attributes", lambda row: str(row["attributes"])),
    ("method", lambda row: words(row["method"])),
    *estimate("mIoU, %", lambda row: row["final"]),
    *estimate(
        "gain over random",
        lambda row: row["final"]["gain"] if row["final"] and row["method"] != RANDOM else None,
        "+.1f",
    ),
    ("rewards", lambda row: str(_spent("evaluations")(row) or 0)),
    *(
        (head, lambda row, keys=keys, form=form: number(_spent(*keys)(row), form))
        for head, keys, form in (
            ("reward, first third", ("first_third",), ".1f"),
            ("last third", ("last_third",), ".1f"),
            ("rewards, core s", ("reward_seconds", "core"), ".0f"),
            ("wall s", ("reward_seconds", "wall"), ".0f"),
            ("method, CPU s", ("method_seconds", "cpu"), ".1f"),
            ("wall s", ("method_seconds", "wall"), ".1f"),
        )
    ),
]


def text(report: Report) -> str:
    """The tables, in Markdown."""
    lines = [
        f"Target: {report['note']}. Rewards are mIoU at {report['rewards_at']} on the reward images; "
        f"final nets are scored at {report['scored_at']} on the test images, {report['seeds']} "
        f"paired seeds.{starts(report)}",
        "Each search ran once, and intervals are over seeds of the final nets. Rewards take a core of "
        f"a worker each; their wall time is that over {report['workers']} worker(s). "
        "A method's own time includes compiling it.",
        "",
        *table(COLUMNS, report["rows"]),
        *_budgets(report),
    ]
    searches = [row["search"]["rewards"] for row in report["rows"] if row["search"] is not None]
    random = [row for row in report["rows"] if row["method"] == RANDOM]
    # Random attributes are the same nets on every subset.
    trained = [row for row in report["rows"] if row["method"] != RANDOM] + random[:1]
    nets = [{"nets": at["miou"]} for row in trained for at in row["budgets"]]
    return "\n".join([*lines, *failed_evaluations(searches), *failures(nets)])


def _budgets(report: Report) -> list[str]:
    """Sentences on the gain over random attributes from the cheapest to the final budget."""
    rows = [row for row in report["rows"] if row["method"] != RANDOM]
    if len(report["budgets"]) < 2 or not any(at["gain"] for row in rows for at in row["budgets"]):
        return []
    lines = []
    for row in rows:
        gains = ["{} ({})".format(*cells(at["gain"], "+.1f")) for at in row["budgets"]]
        lines.append([str(row["attributes"]), words(row["method"]), *gains])
    return [
        "",
        "Gain over random attributes on the test images, with the 95 % interval, from the reward's budget "
        "to the final one:",
        "",
        *markdown(("attributes", "method", *report["budgets"]), lines),
    ]


Points = list[tuple[float, float, float]]
"""Position, value and half the interval."""
ACROSS = 3
"""Number of panels in a row."""


def picture(report: Report) -> bytes:
    """Draw accuracy and time against the number of attributes, and rewards against evaluations, as PNG."""
    rows = report["rows"]
    colors = {method: f"C{k % 10}" for k, method in enumerate(_of(rows, "method"))}
    counts = {row["subset"]: row["attributes"] for row in rows}
    panels = 2 + len(counts) + (len(report["budgets"]) > 1)
    down = -(-panels // ACROSS)
    figure, grid = plt.subplots(
        down, ACROSS, figsize=(4.6 * ACROSS, 4 * down), layout="constrained", squeeze=False
    )
    for axis in grid.flat[panels:]:
        axis.set_axis_off()
    accuracy, minutes, *others = grid.flat[:panels]

    def against_attributes(axis: Axes, value: Any) -> None:
        """``value`` of every row that has one, and half its interval."""
        subsets = list(counts)
        for k, (method, color) in enumerate(colors.items()):
            aside = 0.06 * (k - (len(colors) - 1) / 2)  # so that intervals do not overlap
            own = [row for row in rows if row["method"] == method and value(row) is not None]
            points = [(subsets.index(row["subset"]) + aside, *value(row)) for row in own]
            _bars(axis, points, color, method)
        axis.set_xticks(range(len(subsets)), [str(counts[subset]) for subset in subsets])
        axis.set(xlabel="attributes optimised")

    against_attributes(accuracy, _accuracy)
    accuracy.set(ylabel="mIoU on the test images, %", title="final nets, 95 % intervals")
    against_attributes(minutes, _minutes)
    minutes.set(ylabel="minutes of one core, rewards and method", title="time of the search")
    minutes.set_ylim(bottom=0)
    for axis, subset in zip(others, counts, strict=False):
        for row in rows:
            if row["subset"] == subset and row["search"] is not None:
                _rewards(axis, row, colors[row["method"]])
        axis.set(
            xlabel="evaluation", ylabel="mIoU on the reward images, %",
            title=f"{counts[subset]} attributes: mean so far (line), best (dots)",
        )  # fmt: skip
    if len(others) > len(counts):
        _gains(others[-1], report, colors)
    for axis in grid.flat[:3]:
        if axis.get_legend_handles_labels()[1]:
            axis.legend(fontsize=8)
    spent = f"{report['evaluations']} rewards"
    if report.get("core_minutes"):
        spent = f"{report['core_minutes']:g} core-minutes"
    figure.suptitle(f"{target_of(report)}, {spent} for each method")
    return png(figure)


def _of(rows: Iterable[Report], key: str) -> list[Any]:
    """The distinct values of a field."""
    return list(dict.fromkeys(row[key] for row in rows))


def _bars(axis: Axes, points: Points, color: str, method: str) -> None:
    """Points with their intervals, if there are any."""
    if points:
        x, y, bars = zip(*points, strict=True)
        axis.errorbar(x, y, yerr=bars, fmt="o-", ms=4, capsize=3, color=color, label=words(method))


def _accuracy(row: Report) -> tuple[float, float] | None:
    final = row["final"]
    return None if final is None or final["mean"] is None else (final["mean"], half(final))


def _minutes(row: Report) -> tuple[float, float] | None:
    search = row["search"]
    if search is None:
        return None
    return (search["reward_seconds"]["core"] + search["method_seconds"]["cpu"]) / 60, 0.0


def _gains(axis: Axes, report: Report, colors: dict[str, str]) -> None:
    """Draw the gain over random attributes from the cheapest to the final budget on the last subset."""
    rows = [row for row in report["rows"] if row["subset"] == report["rows"][-1]["subset"]]
    for k, row in enumerate(rows):
        points = [
            (place + 0.06 * k, gain["mean"], half(gain))
            for place, at in enumerate(row["budgets"])
            if row["search"] is not None and (gain := at["gain"]) is not None
        ]
        _bars(axis, points, colors[row["method"]], row["method"])
    axis.axhline(0, color="0.7", lw=1)
    names = [budget.replace(", ", "\n") for budget in report["budgets"]]
    axis.set_xticks(range(len(names)), names, fontsize=8)
    axis.set(ylabel="gain over random attributes, mIoU", title="from the cheap to the final budget")


def _rewards(axis: Axes, row: Report, color: str) -> None:
    """Draw the mean reward so far and the best, without failed evaluations."""
    rewards = np.array(row["search"]["rewards"], float)  # None is NaN
    seen = np.cumsum(~np.isnan(rewards))
    mean = np.where(seen > 0, np.nancumsum(rewards) / np.maximum(seen, 1), np.nan)
    x = np.arange(1, len(rewards) + 1)
    axis.plot(x, mean, color=color, label=words(row["method"]))
    axis.plot(x, np.fmax.accumulate(rewards), color=color, ls=":", lw=1)


FORM = Form("compare", derive, text, {"compare.png": picture})
STUDY = of_rows(FORM, rows, report, check, searches, work)
RUN = partial(do, STUDY)

if __name__ == "__main__":
    sys.exit(command("compare"))
