"""Measure how many labels renders replace: labelled images alone and plus renders.

    sdr-jax study labels --target camvid --data DIR --holdout 0006R0
    sdr-jax study labels --target camvid --data DIR --learnt a.json --counts 0 14 266
    sdr-jax study labels --target twin --preset smoke                  # a minute or two
    sdr-jax study labels --rederive runs/a/labels.json --out runs/b    # no training

Networks are trained on 0, 7, 14, ... labelled images (a random choice, spread over sequences and time), alone
and plus renders, and tested on the test images. The same command resumes a killed run.
"""

from __future__ import annotations

import math
import sys
from functools import partial
from typing import Any

import numpy as np

from common.errors import UserError
from experiments.config import refuse_share
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
    open_interval,
    table,
    target_of,
)
from experiments.tables.row_names import TRAINED_ON
from experiments.tables.skeleton import LEARNT, Answers, Row, attributes, learnt_from, of_rows
from experiments.tables.stats import bounded, equivalent_labels, estimated, gain, mean
from experiments.targets.base import Target
from experiments.targets.few import share_of, spread
from seg.mixing import TrainingSet

ALONE = "none"
"""The name of labelled images alone, without renders."""
RENDERS = {ALONE: "none", **TRAINED_ON}
FIRST, SHARES = (0, 7, 14), (0.1, 0.25, 0.5, 1.0)
"""Default numbers of labelled images: these, then shares of all."""
MIXED_WITH = (0, 14)
"""Numbers of labelled images for which the report says how many more labels renders replace."""


def check(config: LabelsConfig) -> None:
    """Raise UserError with the flag for a field out of range."""
    if config.learnt is not None and LEARNT not in config.rendered:
        raise UserError(f"--learnt has no effect with --renders {' '.join(config.rendered)}")
    if config.counts is not None and sum(count > 0 for count in config.counts) < 2:
        raise UserError("--counts needs two or more numbers above 0, for a curve of labels alone")
    for count in FIRST:
        refuse_share(config, _share(config, count))


def _share(config: LabelsConfig, count: int) -> float:
    """Return the share of so many labelled images in batches with renders."""
    return share_of(count) if config.few_share is None else config.few_share


def counts_of(config: LabelsConfig, target: Target) -> tuple[int, ...]:
    """Return the numbers of labelled images in ascending order.

    Raises:
        UserError: there are fewer.
    """
    images = len(target.reward_names)
    if config.counts is None:
        shares = [math.floor(share * images + 0.5) for share in SHARES]
        return tuple(sorted({count for count in (*FIRST, *shares) if count <= images}))
    if max(config.counts) > images:
        raise UserError(
            f"--counts {max(config.counts)} is more than the {images} labelled images of {target.name}"
        )
    return tuple(sorted(config.counts))


def rows(config: LabelsConfig, target: Target) -> list[Row]:
    """Make rows for every number of labelled images, alone and plus each set of renders."""
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


def _source(
    count: int, renders: str, run: Session[LabelsConfig], answers: Answers, seed: int
) -> Source:
    """Make the training set of a seed's network; networks of one seed share their labelled images."""
    if count == 0:
        return attributes(run, answers, renders)
    target, images = run.target, run.images(run.config.final, "reward")
    labelled: Source = images
    if count < len(images.images):  # all images keep the order of their list
        indices = spread(target.reward_names, target.reward_sequences, count, seed)
        labelled = LabelledSubset(images, tuple(indices.tolist()))
    if renders == ALONE:
        return labelled
    share = _share(run.config, count)
    return TrainingSet((attributes(run, answers, renders), labelled), (1 - share, share))


def report(run: Session[LabelsConfig], _: Answers, rows: list[Report]) -> Report:
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
    """Add means, intervals, gains by renders and over random ones, and the labels that renders replace."""
    values = {(row["labels"], row["renders"]): miou(row["nets"]) for row in report["rows"]}
    counts = sorted({count for count, renders in values if renders == ALONE})
    has_all = counts[-1] == report["reward_images"]  # networks on all labels
    all_labels = mean(values[counts[-1], ALONE]) if has_all else None
    rows = []
    for row in report["rows"]:
        scores = bounded(estimated(values[row["labels"], row["renders"]]))
        average = scores["mean"]
        share = None if average is None or not all_labels else 100 * average / all_labels
        add, over = (_over(values, row, other) for other in (ALONE, "random"))
        rows.append({**row, **scores, "renders_add": add, "over_random": over, "of_all": share})
    replaced = [
        _replaced(values, counts, labels, renders)
        for renders in dict.fromkeys(renders for _, renders in values if renders != ALONE)
        for labels in MIXED_WITH
        if (labels, renders) in values
    ]
    return {**report, "rows": rows, "worth": replaced}


def _over(values: dict[Any, list], row: Report, other: str) -> Report | None:
    """Compute the gain of a row's renders over others with as many labels; None without both."""
    count, renders = row["labels"], row["renders"]
    if renders in (ALONE, other) or (count, other) not in values:
        return None
    return gain(values[count, renders], values[count, other])


def _replaced(values: dict[Any, list], counts: list[int], labels: int, renders: str) -> Report:
    """Compute how many labels alone are as good as some labels plus renders, with the 95 % interval."""
    mixed = np.array(values[labels, renders], float)  # NaN where a network failed
    alone = np.array([values[count, ALONE] for count in counts], float)
    valid = np.isfinite(mixed) & np.isfinite(alone).all(axis=0)
    value, ci95 = equivalent_labels(counts, alone[:, valid], mixed[valid])
    bound = ""
    if value is not None and not counts[0] < value < counts[-1]:
        bound = "at most" if value <= counts[0] else "at least"
    return {"renders": renders, "beside": labels, "labels": value, "bound": bound, "ci95": ci95}


COLUMNS: list[Column] = [
    ("labelled images", lambda row: str(row["labels"])),
    ("renders", lambda row: RENDERS[row["renders"]]),
    *estimate("mIoU"),
    *estimate("renders add", lambda row: row["renders_add"], "+.1f"),
    *estimate("over random renders", lambda row: row["over_random"], "+.1f"),
    ("of all labels, %", lambda row: number(row["of_all"], ".0f")),
]


def text(report: Report) -> str:
    """Write the table in Markdown."""
    share = report["few_share"]
    shares = "a quarter (20 or more: half)" if share is None else f"{100 * share:g} %"
    lines = [
        introduction(report),
        "",
        f"Networks ({report['net']}) are trained on some of the {report['reward_images']} labelled images (a "
        "choice for each seed, spread over sequences and time), alone or plus "
        f"{report['rendered_images']} rendered ones; labelled images then fill at least "
        f"{shares} of each batch. Intervals are over seeds, which change the choice, the streets and the "
        "network.",
        "",
        *table(COLUMNS, report["rows"]),
        "",
        *(line for entry in report["worth"] for line in _sentence(entry)),
    ]
    if report["learnt_from"]:
        lines += ["The search for optimised streets may have used more labels than a row has.", ""]
    return "\n".join([*lines[:-1], *failures(report["rows"])])


def _sentence(entry: Report) -> list[str]:
    """Write a sentence on the number of labels that renders replace."""
    if entry["labels"] is None:
        return []
    labels, ci95 = entry["beside"], entry["ci95"]
    mixed = f"{labels} labelled images plus renders" if labels else "Renders alone"
    bound = f"{entry['bound']} " if entry["bound"] else ""
    range_ = "" if ci95 is None else f" (95 % interval {open_interval(*ci95)})"
    return [
        f"{mixed} ({RENDERS[entry['renders']]}) are as good as {bound}{entry['labels']:.0f} labelled "
        f"images alone{range_}.",
        "",
    ]


def picture(report: Report) -> bytes:
    """Plot mIoU against the number of labelled images, alone and plus renders, as PNG."""
    counts = sorted({row["labels"] for row in report["rows"]})
    zero = min(count for count in counts if count) / 2  # place of 0 on the logarithmic axis
    groups = {
        "labelled images alone" if renders == ALONE else f"plus renders: {RENDERS[renders]}": [
            row for row in report["rows"] if row["renders"] == renders
        ]
        for renders in dict.fromkeys(row["renders"] for row in report["rows"])
    }
    ticks = {count or zero: str(count) for count in counts}
    title = f"{target_of(report)}, {report['net']}, 95 % intervals"
    return curves(
        groups, lambda row: row["labels"] or zero, ticks, "labelled images", title, log=True
    )


FORM = Form("labels", derive, text, {"labels.png": picture})
STUDY = of_rows(FORM, rows, report, check)

if __name__ == "__main__":
    sys.exit(command("labels"))
