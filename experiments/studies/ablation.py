"""The paper's ablation: how much mIoU the search loses without each of its parts.

    sdr-jax study ablation --target camvid --data DIR --holdout 0006R0
    sdr-jax study ablation --target camvid --data DIR --method sdr       # the paper's search
    sdr-jax study ablation --target twin --preset smoke                  # a minute or two
    sdr-jax study ablation --rederive runs/a/ablation.json --out runs/b  # no training

Every variant is a search with the same number of evaluations: without relaxation, with all attributes in one
group, with groups that ignore correlation, and with environment, positions or densities left random. Networks
trained on the streets found are tested in pairs on the test images. The same command resumes a killed run.
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
from experiments.attribute_search.plans import SearchPlan
from experiments.config.cli import command
from experiments.config.jobs import AblationConfig, Variant
from experiments.config.presets import DENSITIES, ENVIRONMENT, POSITIONS
from experiments.session.session import Session, Work
from experiments.studies.figure import plt, png
from experiments.studies.search_columns import (
    core_seconds,
    failed_evaluations,
    reward_columns,
    rewards,
)
from experiments.tables.form import (
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
from experiments.tables.row_names import TRAINED_ON
from experiments.tables.skeleton import Answers, Row, Search, of_rows
from experiments.tables.stats import statistics
from experiments.targets.base import Target
from scene.attributes import names

FULL: Variant = "full"
"""The full method, with which variants are compared."""
RANDOM: Variant = "random"
"""All attributes random, without a search."""
TITLES: dict[Variant, str] = {
    FULL: "the full method",
    "no_relaxation": "no relaxation",
    "no_groups": "no groups: all attributes in one",
    "shuffled_groups": "shuffled groups: correlation ignored",
    "no_environment": "environment not optimised",
    "no_positions": "positions not optimised",
    "no_densities": "densities not optimised",
    RANDOM: f"{TRAINED_ON['random']}: no search",
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
        raise UserError("--search.method random_attributes does not search: the row random has it")
    if FULL not in config.variants:
        raise UserError(f"--variants must include {FULL}, with which the others are compared")
    plan_all(config)


def without(config: AblationConfig, variant: Variant) -> AblationConfig:
    """Configure a variant's search; `subset_of` returns its attributes."""
    if variant == "no_relaxation":
        return replace(config, search=replace(config.search, relaxation=0.0))
    if variant == "no_groups":
        return replace(config, groups=(names(config.space),))
    if variant == "shuffled_groups":
        return replace(config, groups=shuffled(config.groups, names(config.space), config.seed))
    return config


def subset_of(variant: Variant, config: AblationConfig) -> tuple[str, ...]:
    """Return the attributes that a variant optimises."""
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
    shuffled_names = iter(names[k] for k in order)
    return tuple(tuple(next(shuffled_names) for _ in group) for group in groups)


def plan_all(config: AblationConfig) -> dict[Variant, SearchPlan]:
    """Plan the search of every variant that has one; all start from the same random key.

    Raises:
        UserError: the evaluations do not fit the groups, or the method lacks an option.
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
    """Make the search of every variant."""
    return {variant: partial(search, plan=plan) for variant, plan in plan_all(config).items()}


def work(config: AblationConfig) -> list[Work]:
    """Plan the networks of these searches."""
    return [plans.work_of(config, list(plan_all(config).values()))]


def rows(config: AblationConfig, _: Target) -> list[Row]:
    """Make a row for the final networks of every variant."""

    def row(variant: Variant) -> Row:
        return Row(
            {"variant": variant},
            lambda run, answers, seed: (
                config.streets(RANDOM) if variant == RANDOM else answers[variant].solution
            ),
            config.final,
            what="ablation",
            name=variant,
            after="" if variant == RANDOM else variant,
        )

    return [row(variant) for variant in config.variants]


def report(run: Session[AblationConfig], answers: Answers, rows: list[Report]) -> Report:
    """Report the mIoU of every variant with its search."""
    config = run.config
    for row in rows:
        answer = answers.get(row["variant"])
        row["search"] = None if answer is None else _search(config, row["variant"], answer)
    return {
        "method": config.search.method,
        "evaluations": config.evaluations,
        "rewards_at": config.reward.size,
        "rows": rows,
    }


def _search(config: AblationConfig, variant: Variant, answer: Found) -> Report:
    changed, subset = without(config, variant), subset_of(variant, config)
    intervals = np.round(np.stack(answer.solution, axis=-1).astype(float), 6).tolist()
    return {
        "attributes": len(subset),
        "groups": [[name for name in group if name in subset] for group in changed.groups],
        "relaxation": changed.search.relaxation,
        "rewards": rewards(answer),
        "core_seconds": core_seconds(answer),
        # Centre and width of every attribute; random ones have 0.5 and 1.
        "solution": dict(zip(names(config.space), intervals, strict=True)),
    }


def derive(report: Report) -> Report:
    """Add means, intervals and differences of the networks' mIoU to the report."""
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
        "difference from the full method",
        lambda row: row["gain"] if row["variant"] != FULL else None,
        "+.1f",
    ),
    ("the paper's own", lambda row: number(row["paper"], "+.1f")),
    *reward_columns(lambda row: row["search"]["rewards"] if row["search"] else []),
]


def text(report: Report) -> str:
    """Write the table in Markdown."""
    rows = report["rows"]
    lines = [
        f"{introduction(report)} Each variant is one search by {words(report['method'])} with "
        f"{report['evaluations']} rewards at {report['rewards_at']}: another search of the same variant may "
        "find other streets, which the intervals do not cover.",
        "",
        *table(COLUMNS, rows),
        "",
        "The paper's own differences are NOT of this run: another engine, networks with ImageNet weights, "
        "300 policy updates. Compare variants by mIoU, not by rewards: without relaxation or with fewer "
        "attributes, rewards come from other datasets.",
        *failures(rows),
        *failed_evaluations(row["search"]["rewards"] for row in rows if row["search"]),
    ]
    return "\n".join(lines)


def picture(report: Report) -> bytes:
    """Plot mIoU and difference of every variant, with the paper's differences, as PNG."""
    rows = report["rows"]
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(13, 1.6 + 0.5 * len(rows)), sharey=True, layout="constrained"
    )
    shown = [(k, row) for k, row in enumerate(rows) if row["mean"] is not None]
    left.barh(
        [k for k, _ in shown], [row["mean"] for _, row in shown],
        xerr=error_bars([row for _, row in shown]), capsize=3,
        color=["C0" if row["variant"] == FULL else "0.7" for _, row in shown],
    )  # fmt: skip
    left.set_yticks(range(len(rows)), [TITLES[row["variant"]] for row in rows])
    left.invert_yaxis()
    left.set(xlabel="mIoU on the test images, %, 95 % intervals")
    gains = [(k, row["gain"]) for k, row in shown if row["gain"] and row["variant"] != FULL]
    right.errorbar(
        [gain["mean"] for _, gain in gains], [k for k, _ in gains],
        xerr=error_bars([gain for _, gain in gains]),
        fmt="o", capsize=3, label="here, paired seeds",
    )  # fmt: skip
    paper = [(row["paper"], k) for k, row in enumerate(rows) if row["paper"] is not None]
    places = [[point[axis] for point in paper] for axis in (0, 1)]
    right.plot(*places, "D", color="0.6", mfc="none", label="the paper's own")
    right.axvline(0, color="0.7", lw=0.8)
    right.set(xlabel="difference from the full method, mIoU points")
    right.legend(fontsize=8)
    figure.suptitle(
        f"{target_of(report)}, {words(report['method'])}, "
        f"{report['evaluations']} rewards for each variant"
    )
    return png(figure)


FORM = Form("ablation", derive, text, {"ablation.png": picture})
STUDY = of_rows(FORM, rows, report, check, searches, work)

if __name__ == "__main__":
    sys.exit(command("ablation"))
