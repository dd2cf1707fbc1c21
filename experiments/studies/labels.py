"""Measures labelled images alone and beside renders: how many labels do renders replace?

    sdr-jax study labels --target camvid --data DIR --holdout 0006R0
    sdr-jax study labels --target camvid --data DIR --learnt a.json --counts 0 14 266
    sdr-jax study labels --target twin --preset smoke                  # a minute or two
    sdr-jax study labels --rederive runs/a/labels.json --out runs/b    # no net at all

Nets are trained on 0, 7, 14, ... labelled images (a seeded choice, spread over sequences and time), on these
beside renders, and tested on the test images. The same command continues a killed run.
"""

from __future__ import annotations

import math
import sys
from functools import partial
from typing import Any

import numpy as np

from common.errors import UserError
from experiments.config.cli import command
from experiments.config.jobs import LabelsConfig
from experiments.evaluation.job import LabelledSubset, Source
from experiments.session.session import Session
from experiments.studies.figure import curves
from experiments.tables.form import (
    Column,
    Form,
    Report,
    estimate,
    failures,
    introduction,
    miou,
    number,
    table,
    target_of,
)
from experiments.tables.skeleton import (
    LEARNT,
    Made,
    Row,
    attributes,
    do,
    learnt_from,
    of_rows,
)
from experiments.tables.stats import bounded, estimated, gain, mean, worth
from experiments.targets.base import Target
from experiments.targets.few import spread
from seg.beside import TrainingSet

ALONE = "none"
"""The word for labelled images alone, without a set of renders."""
RENDERS = {
    ALONE: "none",
    "random": "random attributes",
    "default": "hand-set attributes",
    "mixed": "half of them random, half hand-set",
    "learnt": "learnt attributes",
}
FIRST, SHARES = (0, 7, 14), (0.1, 0.25, 0.5, 1.0)
"""Default numbers of labelled images: these, and then shares of all."""
BESIDE = (0, 14)
"""Numbers of labelled images beside which the report says how many labels renders replace."""


def check(config: LabelsConfig) -> None:
    """Raise UserError with the flag for a field out of range."""
    if config.learnt is not None and LEARNT not in config.rendered:
        raise UserError(f"--learnt has no effect with --renders {' '.join(config.rendered)}")
    if config.counts is not None and sum(count > 0 for count in config.counts) < 2:
        raise UserError("--counts needs at least two numbers above 0: between them is a curve")


def counts_of(config: LabelsConfig, target: Target) -> tuple[int, ...]:
    """The numbers of labelled images in ascending order.

    Raises:
        UserError: there are fewer.
    """
    there = len(target.reward_names)
    if config.counts is None:
        shares = [math.floor(share * there + 0.5) for share in SHARES]
        return tuple(sorted({count for count in (*FIRST, *shares) if count <= there}))
    if max(config.counts) > there:
        raise UserError(
            f"--counts {max(config.counts)} is more than the {there} labelled images of {target.name}"
        )
    return tuple(sorted(config.counts))


def rows(config: LabelsConfig, target: Target) -> list[Row]:
    """Rows of every number of labelled images, alone and beside each set of renders."""
    return [
        Row(
            {"labels": count, "renders": renders},
            partial(_source, count, renders),
            config.final,
            what="labels",
            name=f"{count} labels, {renders}",
            after=LEARNT if renders == LEARNT else "",
            real=renders == ALONE,
            order=(place, -count),  # a worker keeps the streets of a seed
        )
        for count in counts_of(config, target)
        for place, renders in enumerate((ALONE, *config.rendered))
        if count or renders != ALONE
    ]


def _source(count: int, renders: str, run: Session[LabelsConfig], made: Made, seed: int) -> Source:
    """The training set of a seed's net; nets of one seed share their labelled images."""
    if count == 0:
        return attributes(run, made, renders)
    target, images = run.target, run.images(run.config.final, "reward")
    few: Source = images
    if count < len(images.images):  # all images stay in the order of the list
        picked = spread(target.reward_names, target.reward_sequences, count, seed)
        few = LabelledSubset(images, tuple(picked.tolist()))
    if renders == ALONE:
        return few
    share = run.config.few_share
    return TrainingSet((attributes(run, made, renders), few), (1 - share, share))


def report(run: Session[LabelsConfig], _: Made, rows: list[Report]) -> Report:
    """Report the mIoU and its conditions."""
    config = run.config
    return {
        "learnt_from": learnt_from(config) if LEARNT in config.rendered else None,
        "few_share": config.few_share,
        "rendered_images": config.final.images,
        "net": config.final.train.net,
        "rows": rows,
    }


def derive(report: Report) -> Report:
    """Add means, intervals, gains by renders and over random ones, and the labels that they replace."""
    values = {(row["labels"], row["renders"]): miou(row["nets"]) for row in report["rows"]}
    counts = sorted({count for count, renders in values if renders == ALONE})
    known = counts[-1] == report["reward_images"]  # nets on all labels
    best = mean(values[counts[-1], ALONE]) if known else None
    rows = []
    for row in report["rows"]:
        own = values[row["labels"], row["renders"]]
        found = bounded(estimated(own))
        share = None if found["mean"] is None or not best else 100 * found["mean"] / best
        add, over = (_over(values, row, other) for other in (ALONE, "random"))
        rows.append({**row, **found, "renders_add": add, "over_random": over, "of_all": share})
    told = [
        _worth(values, counts, beside, renders)
        for renders in dict.fromkeys(renders for _, renders in values if renders != ALONE)
        for beside in BESIDE
        if (beside, renders) in values
    ]
    return {**report, "rows": rows, "worth": told}


def _over(values: dict[Any, list], row: Report, other: str) -> Report | None:
    """The gain of a row's renders over others beside as many labels; None without both."""
    count, renders = row["labels"], row["renders"]
    if renders in (ALONE, other) or (count, other) not in values:
        return None
    return gain(values[count, renders], values[count, other])


def _worth(values: dict[Any, list], counts: list[int], beside: int, renders: str) -> Report:
    """The number of labels alone for nets as good as some labels beside renders, and its 95 % interval."""
    ours = np.array(values[beside, renders], float)  # NaN where a net failed
    alone = np.array([values[count, ALONE] for count in counts], float)
    known = np.isfinite(ours) & np.isfinite(alone).all(axis=0)
    value, ci95 = worth(counts, alone[:, known], ours[known])
    bound = ""
    if value is not None and not counts[0] < value < counts[-1]:
        bound = "at most" if value <= counts[0] else "at least"
    return {"renders": renders, "beside": beside, "labels": value, "bound": bound, "ci95": ci95}


COLUMNS: list[Column] = [
    ("labelled images", lambda row: str(row["labels"])),
    ("renders", lambda row: RENDERS[row["renders"]]),
    *estimate("mIoU"),
    *estimate("renders add", lambda row: row["renders_add"], "+.1f"),
    *estimate("over random renders", lambda row: row["over_random"], "+.1f"),
    ("of all labels, %", lambda row: number(row["of_all"], ".0f")),
]


def text(report: Report) -> str:
    """The table, in Markdown."""
    lines = [
        introduction(report),
        "",
        f"Nets ({report['net']}) are trained on labelled images of the {report['reward_images']} that there "
        f"are (a choice by seed, spread over sequences and time), alone or beside "
        f"{report['rendered_images']} rendered ones; then they are {100 * report['few_share']:g} % of all "
        "batches. Intervals are over seeds of choice, streets and net.",
        "",
        *table(COLUMNS, report["rows"]),
        "",
        *(said for entry in report["worth"] for said in _said(entry)),
    ]
    if report["learnt_from"]:
        lines += [
            "The search that learnt the attributes may have seen more labels than a row has.",
            "",
        ]
    return "\n".join([*lines[:-1], *failures(report["rows"])])


def _said(entry: Report) -> list[str]:
    """A sentence on the number of labels that renders replace."""
    if entry["labels"] is None:
        return []
    beside, ci95 = entry["beside"], entry["ci95"]
    ours = f"with {beside} labelled images beside them" if beside else "alone"
    bound = f"{entry['bound']} " if entry["bound"] else ""
    sure = "" if ci95 is None else f" (95 % interval {_ends(*ci95)})"
    return [
        f"Renders ({RENDERS[entry['renders']]}) {ours} are worth {bound}{entry['labels']:.0f} labelled "
        f"images{sure}.",
        "",
    ]


def _ends(low: float | None, high: float | None) -> str:
    """An interval in words; an end that is None is open."""
    if low is None:
        return "open at both ends" if high is None else f"at most {high:.0f}"
    return f"at least {low:.0f}" if high is None else f"{low:.0f} to {high:.0f}"


def picture(report: Report) -> bytes:
    """Draw mIoU against the number of labelled images, alone and beside renders, as PNG."""
    counts = sorted({row["labels"] for row in report["rows"]})
    nothing = min(count for count in counts if count) / 2  # place of 0 on the logarithmic axis
    groups = {
        "labelled images alone" if renders == ALONE else f"and renders, {RENDERS[renders]}": [
            row for row in report["rows"] if row["renders"] == renders
        ]
        for renders in dict.fromkeys(row["renders"] for row in report["rows"])
    }
    ticks = {count or nothing: str(count) for count in counts}
    title = f"{target_of(report)}, {report['net']}, 95 % intervals"
    return curves(
        groups, lambda row: row["labels"] or nothing, ticks, "labelled images", title, log=True
    )


FORM = Form("labels", derive, text, {"labels.png": picture})
STUDY = of_rows(FORM, rows, report, check)
RUN = partial(do, STUDY)

if __name__ == "__main__":
    sys.exit(command("labels"))
