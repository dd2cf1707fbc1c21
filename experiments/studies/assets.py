"""The paper's study of assets and images: how much mIoU half the assets, or fewer images, cost.

    sdr-jax study assets --target camvid --data DIR --holdout 0006R0
    sdr-jax study assets --target camvid --data DIR --attributes learnt --learnt a.json
    sdr-jax study assets --target twin --preset smoke                  # a minute or two
    sdr-jax study assets --rederive runs/a/assets.json --out runs/b    # no training

Networks are trained on 90 to 1350 images with all assets or with the first half of each class, and tested in
pairs on the test images. The same command resumes a killed run.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import product

from common.errors import UserError
from experiments.config.cli import command
from experiments.config.jobs import AssetsConfig
from experiments.session.session import Session
from experiments.studies.figure import curves
from experiments.tables.form import (
    Column,
    Form,
    Report,
    estimate,
    failures,
    miou,
    starts,
    table,
    target_of,
)
from experiments.tables.row_names import TRAINED_ON
from experiments.tables.skeleton import LEARNT, Answers, Row, attributes, learnt_from, of_rows
from experiments.tables.stats import bounded, estimated, gain
from experiments.targets.base import Target


def check(config: AssetsConfig) -> None:
    """Raise UserError with the flag for a field out of range."""
    shots = config.final.shots
    for count in config.images:
        if count % shots:
            raise UserError(
                f"--images must be multiples of --final.shots {shots}, the images of a street, "
                f"not {count}"
            )
    if config.learnt is not None and config.attributes != LEARNT:
        raise UserError(f"--learnt has no effect with --attributes {config.attributes}")


def rows(config: AssetsConfig, _: Target) -> list[Row]:
    """Make a row for every number of images and share of the assets; more images means more streets."""
    return [
        Row(
            {"images": images, "streets": images // config.final.shots, "fraction": fraction},
            lambda run, answers, seed: attributes(run, answers, config.attributes),
            replace(config.final, streets=images // config.final.shots),
            what=f"{images} images, {100 * fraction:g} % of the assets",
            name="nets",
            after=LEARNT if config.attributes == LEARNT else "",
            pool={"fraction": fraction},
        )
        for images, fraction in product(config.images, config.fractions)
    ]


def report(run: Session[AssetsConfig], _: Answers, rows: list[Report]) -> Report:
    """Report the mIoU and its conditions."""
    config = run.config
    return {
        "learnt_from": learnt_from(config),
        "attributes": config.attributes,
        "steps": config.final.train.steps,
        "rows": rows,
    }


def derive(report: Report) -> Report:
    """Add means, intervals, and the gain of more assets at each number of images to the report."""
    most = max(row["fraction"] for row in report["rows"])
    full = {row["images"]: miou(row["nets"]) for row in report["rows"] if row["fraction"] == most}
    rows = []
    for row in report["rows"]:
        values = miou(row["nets"])
        more = gain(full[row["images"]], values) if row["fraction"] != most else None
        rows.append({**row, **bounded(estimated(values)), "more_assets": more})
    return {**report, "rows": rows}


COLUMNS: list[Column] = [
    ("images", lambda row: str(row["images"])),
    ("streets", lambda row: str(row["streets"])),
    ("share of the assets", lambda row: f"{100 * row['fraction']:g} %"),
    *estimate("mIoU"),
    *estimate("gain of the most assets", lambda row: row["more_assets"], "+.1f"),
]


def text(report: Report) -> str:
    """Write the table in Markdown."""
    origin = report["learnt_from"] if report["attributes"] == LEARNT else ""
    lines = [
        f"Target: {report['note']}. Training images: {TRAINED_ON[report['attributes']]}"
        f"{origin and f' from {origin}'}, {report['steps']} steps for any number of images; mIoU in percent "
        f"at {report['scored_at']} on {report['test_images']} test images, {report['seeds']} paired seeds, "
        f"95 % intervals by Student's t.{starts(report)}",
        "",
        *table(COLUMNS, report["rows"]),
        "",
        "In the paper's own plot (NOT of this run) full assets are better than half assets at every number "
        "of images, at about 19 % mIoU throughout.",
        *failures(report["rows"]),
    ]
    return "\n".join(lines)


def picture(report: Report) -> bytes:
    """Plot mIoU against the number of images for each share of the assets, as PNG."""
    groups = {
        f"{100 * fraction:g} % of the assets": [
            row for row in report["rows"] if row["fraction"] == fraction
        ]
        for fraction in sorted({row["fraction"] for row in report["rows"]}, reverse=True)
    }
    ticks = {count: str(count) for count in sorted({row["images"] for row in report["rows"]})}
    title = f"{target_of(report)}, {TRAINED_ON[report['attributes']]}, 95 % intervals"
    across = "images of the training set"
    return curves(groups, lambda row: row["images"], ticks, across, title, log=True)


FORM = Form("assets", derive, text, {"assets.png": picture})
STUDY = of_rows(FORM, rows, report, check)

if __name__ == "__main__":
    sys.exit(command("assets"))
