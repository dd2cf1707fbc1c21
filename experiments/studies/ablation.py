"""The paper's ablation: the loss of the search without one of its parts.

    sdr-jax study ablation --target camvid --data DIR --holdout 0006R0
    sdr-jax study ablation --target camvid --data DIR --method sdr       # the paper's search
    sdr-jax study ablation --target twin --preset smoke                  # a minute or two
    sdr-jax study ablation --rederive runs/a/ablation.json --out runs/b  # no net at all

Every variant is a search with the same number of evaluations: without relaxation, with all attributes in one
group, with groups that ignore correlation, and with environment, positions or densities left random. Nets
trained on their answers are tested on the test images, paired. The same command continues a killed run.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from common.errors import UserError
from experiments.attribute_search import plans
from experiments.attribute_search.loop import Found, search
from experiments.attribute_search.rewards import SearchPlan
from experiments.config.cli import command
from experiments.config.jobs import AblationConfig, Variant
from experiments.config.presets import DENSITIES, ENVIRONMENT, POSITIONS
from experiments.session.session import Session, Work
from experiments.studies.figure import plt, png
from experiments.studies.search_columns import REWARDS, core_seconds, failed_evaluations, rewards
from experiments.tables.form import (
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
from experiments.tables.stats import statistics
from experiments.targets.base import Target
from scene.attributes import names

FULL: Variant = "full"
"""The full method, from which losses are measured."""
RANDOM: Variant = "random"
"""All attributes random, without a search."""
TITLES: dict[Variant, str] = {
    FULL: "the full method",
    "no_relaxation": "no relaxation",
    "no_groups": "no groups: all attributes in one",
    "shuffled_groups": "shuffled groups: no regard to correlation",
    "no_environment": "environment not optimised",
    "no_positions": "positions not optimised",
    "no_densities": "densities not optimised",
    RANDOM: "random attributes: no search",
}
FIXED: dict[Variant, tuple[str, ...]] = {
    "no_environment": ENVIRONMENT,
    "no_positions": POSITIONS,
    "no_densities": DENSITIES,
}
"""Attributes that variants leave random."""
PAPER: dict[Variant, float] = {
    "no_relaxation": -3.5,
    "no_groups": -7.9,
    "shuffled_groups": -2.9,  # 19.0 -> 16.1
    "no_environment": -3.4,
    "no_positions": -1.2,
    "no_densities": -2.1,
}
"""Differences in mIoU points from the full method (19.0). Source: the paper's ablation study."""
SHUFFLE = 2020
"""Part of the seed of the shuffled groups."""


def check(config: AblationConfig) -> None:
    """Raise UserError with the flag for a field out of range."""
    if config.search.method == "random_attributes":
        raise UserError("--search.method random_attributes searches for nothing")
    if FULL not in config.variants:
        raise UserError(f"--variants must hold {FULL}, from which losses are measured")
    planned(config)


def without(config: AblationConfig, variant: Variant) -> AblationConfig:
    """The configuration of a variant's search; `subset_of` gives its attributes."""
    if variant == "no_relaxation":
        return replace(config, search=replace(config.search, relaxation=0.0))
    if variant == "no_groups":
        return replace(config, groups=(names(config.space),))
    if variant == "shuffled_groups":
        return replace(config, groups=shuffled(config.groups, names(config.space), config.seed))
    return config


def subset_of(variant: Variant, config: AblationConfig) -> tuple[str, ...]:
    """The attributes that a variant optimises."""
    return tuple(name for name in config.varied if name not in FIXED.get(variant, ()))


def shuffled(
    groups: Sequence[Sequence[str]], names: Sequence[str], seed: int
) -> tuple[tuple[str, ...], ...]:
    """Make groups of the same sizes in the same order with random members.

    Args:
        groups: a partition of the names.
        names: the names in an order that does not depend on the groups.
        seed: seed of the choice.
    """
    order = np.random.default_rng([SHUFFLE, seed]).permutation(len(names))
    dealt = iter(names[k] for k in order)
    return tuple(tuple(next(dealt) for _ in group) for group in groups)


def planned(config: AblationConfig) -> dict[Variant, SearchPlan]:
    """Plan the search of every variant that has one; all begin with the same key.

    Raises:
        UserError: evaluations that do not fit its groups, or an option that the method lacks.
    """
    method = config.search.method
    return {
        variant: plans.plan(
            without(config, variant),
            variant,
            method,
            subset_of(variant, config),
            config.evaluations,
        )
        for variant in config.variants
        if variant != RANDOM
    }


def searches(config: AblationConfig) -> dict[str, Search]:
    """The search of every variant."""
    return {variant: partial(search, plan=plan) for variant, plan in planned(config).items()}


def work(config: AblationConfig) -> list[Work]:
    """The nets of these searches."""
    return [plans.work_of(config, list(planned(config).values()))]


def rows(config: AblationConfig, _: Target) -> list[Row]:
    """The final nets of every variant's answer."""

    def row(variant: Variant) -> Row:
        return Row(
            {"variant": variant},
            lambda run, made, seed: (
                config.streets(RANDOM) if variant == RANDOM else made[variant].solution
            ),
            config.final,
            what="ablation",
            name=variant,
            after="" if variant == RANDOM else variant,
        )

    return [row(variant) for variant in config.variants]


def report(run: Session[AblationConfig], made: Made, rows: list[Report]) -> Report:
    """Report the mIoU of every variant with its search."""
    config = run.config
    for row in rows:
        found = made.get(row["variant"])
        row["search"] = None if found is None else _search(config, row["variant"], found)
    return {
        "method": config.search.method,
        "evaluations": config.evaluations,
        "rewards_at": config.reward.size,
        "rows": rows,
    }


def _search(config: AblationConfig, variant: Variant, found: Found) -> Report:
    own, subset = without(config, variant), subset_of(variant, config)
    intervals = np.round(np.stack(found.solution, axis=-1).astype(float), 6).tolist()
    return {
        "attributes": len(subset),
        "groups": [[name for name in group if name in subset] for group in own.groups],
        "relaxation": own.search.relaxation,
        "rewards": rewards(found),
        "core_seconds": core_seconds(found),
        # Centre and width of every attribute; random ones have 0.5 and 1.
        "solution": dict(zip(names(config.space), intervals, strict=True)),
    }


def derive(report: Report) -> Report:
    """Add means, intervals and losses of the nets' mIoU to the report."""
    (full,) = [miou(row["nets"]) for row in report["rows"] if row["variant"] == FULL]
    rows = [
        {**row, **statistics(miou(row["nets"]), full), "paper": PAPER.get(row["variant"])}
        for row in report["rows"]
    ]
    return {**report, "rows": rows}


COLUMNS: list[Column] = [
    ("variant", lambda row: TITLES[row["variant"]]),
    *estimate("mIoU"),
    *estimate(
        "less the full method",
        lambda row: row["gain"] if row["variant"] != FULL else None,
        "+.1f",
    ),
    ("the paper's own", lambda row: number(row["paper"], "+.1f")),
    *REWARDS,
]


def text(report: Report) -> str:
    """The table, in Markdown."""
    rows = report["rows"]
    lines = [
        f"{introduction(report)} Each variant is one search by {words(report['method'])} with "
        f"{report['evaluations']} rewards at {report['rewards_at']}: intervals do not hold what another "
        "search of the same variant would have found.",
        "",
        *table(COLUMNS, rows),
        "",
        "The paper's own differences are NOT of this run: another engine, nets with ImageNet weights, "
        "300 policy updates. Rewards are of the search's datasets: without relaxation or with fewer "
        "attributes they are other datasets, so only the nets' mIoU compares variants.",
        *failures(rows),
        *failed_evaluations(row["search"]["rewards"] for row in rows if row["search"]),
    ]
    return "\n".join(lines)


def picture(report: Report) -> bytes:
    """Draw mIoU and loss of every variant with the paper's losses, as PNG."""
    rows = report["rows"]
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(13, 1.6 + 0.5 * len(rows)), sharey=True, layout="constrained"
    )
    known = [(k, row) for k, row in enumerate(rows) if row["mean"] is not None]
    left.barh(
        [k for k, _ in known], [row["mean"] for _, row in known],
        xerr=[half(row) for _, row in known], capsize=3,
        color=["C0" if row["variant"] == FULL else "0.7" for _, row in known],
    )  # fmt: skip
    left.set_yticks(range(len(rows)), [TITLES[row["variant"]] for row in rows])
    left.invert_yaxis()
    left.set(xlabel="mIoU on the test images, %, 95 % intervals")
    lost = [(k, row["gain"]) for k, row in known if row["gain"] and row["variant"] != FULL]
    right.errorbar(
        [gain["mean"] for _, gain in lost], [k for k, _ in lost],
        xerr=[half(gain) for _, gain in lost],
        fmt="o", capsize=3, label="here, paired seeds",
    )  # fmt: skip
    paper = [(row["paper"], k) for k, row in enumerate(rows) if row["paper"] is not None]
    places = [[each[axis] for each in paper] for axis in (0, 1)]
    right.plot(*places, "D", color="0.6", mfc="none", label="the paper's own")
    right.axvline(0, color="0.7", lw=0.8)
    right.set(xlabel="mIoU points against the full method")
    right.legend(fontsize=8)
    figure.suptitle(
        f"{target_of(report)}, {words(report['method'])}, "
        f"{report['evaluations']} rewards for each variant"
    )
    return png(figure)


FORM = Form("ablation", derive, text, {"ablation.png": picture})
STUDY = of_rows(FORM, rows, report, check, searches, work)
RUN = partial(do, STUDY)

if __name__ == "__main__":
    sys.exit(command("ablation"))
