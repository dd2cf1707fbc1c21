"""The paper's study of assets and images: the loss by half the assets, or by fewer images.

    sdr-jax study assets --target camvid --data DIR --holdout 0006R0
    sdr-jax study assets --target camvid --data DIR --attributes learnt --learnt a.json
    sdr-jax study assets --target twin --preset smoke                  # a minute or two
    sdr-jax study assets --rederive runs/a/assets.json --out runs/b    # no net at all

Nets are trained on 90 to 1350 images with all assets or with the first half of each class, and tested on the
test images, paired. The same command continues a killed run.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial
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
from experiments.tables.skeleton import (
    LEARNT,
    Made,
    Row,
    attributes,
    do,
    learnt_from,
    of_rows,
)
from experiments.tables.stats import bounded, estimated, gain
from experiments.targets.base import Target

ATTRIBUTES = {
    "random": "random attributes",
    "default": "hand-set attributes",
    "learnt": "learnt attributes",
}


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
    """Rows of every number of images and share of the assets; more images means more streets."""
    found = []
    for images, fraction in product(config.images, config.fractions):
        streets = images // config.final.shots
        row = Row(
            {"images": images, "streets": streets, "fraction": fraction},
            lambda run, made, seed: attributes(run, made, config.attributes),
            replace(config.final, streets=streets),
            what=f"{images} images, {100 * fraction:g} % of the assets",
            name="nets",
            after=LEARNT if config.attributes == LEARNT else "",
            pool={"fraction": fraction},
        )
        found.append(row)
    return found


def report(run: Session[AssetsConfig], _: Made, rows: list[Report]) -> Report:
    """Report the mIoU and its conditions."""
    config = run.config
    about = {"attributes": config.attributes, "steps": config.final.train.steps}
    return {"learnt_from": learnt_from(config), **about, "rows": rows}


def derive(report: Report) -> Report:
    """Add means, intervals, and the gain by more assets at each number of images to the report."""
    most = max(row["fraction"] for row in report["rows"])
    best = {row["images"]: miou(row["nets"]) for row in report["rows"] if row["fraction"] == most}
    rows = []
    for row in report["rows"]:
        values = miou(row["nets"])
        more = gain(best[row["images"]], values) if row["fraction"] != most else None
        rows.append({**row, **bounded(estimated(values)), "more_assets": more})
    return {**report, "rows": rows}


COLUMNS: list[Column] = [
    ("images", lambda row: str(row["images"])),
    ("streets", lambda row: str(row["streets"])),
    ("share of the assets", lambda row: f"{100 * row['fraction']:g} %"),
    *estimate("mIoU"),
    *estimate("the most assets less this", lambda row: row["more_assets"], "+.1f"),
]


def text(report: Report) -> str:
    """The table, in Markdown."""
    learnt = report["learnt_from"] if report["attributes"] == LEARNT else ""
    where = f", from {learnt}" if learnt else ""
    lines = [
        f"Target: {report['note']}. Nets on images with {ATTRIBUTES[report['attributes']]}{where}, "
        f"{report['steps']} steps whatever the number of images; mIoU in percent at "
        f"{report['scored_at']} on {report['test_images']} test images, {report['seeds']} paired seeds, "
        f"95 % intervals by Student's t.{starts(report)}",
        "",
        *table(COLUMNS, report["rows"]),
        "",
        "The paper's own figure, NOT of this run, has full assets above half assets at every number of "
        "images, about 19 % throughout.",
        *failures(report["rows"]),
    ]
    return "\n".join(lines)


def picture(report: Report) -> bytes:
    """Draw mIoU against the number of images for each share of the assets, as PNG."""
    groups = {
        f"{100 * fraction:g} % of the assets": [
            row for row in report["rows"] if row["fraction"] == fraction
        ]
        for fraction in sorted({row["fraction"] for row in report["rows"]}, reverse=True)
    }
    ticks = {count: str(count) for count in sorted({row["images"] for row in report["rows"]})}
    title = f"{target_of(report)}, {ATTRIBUTES[report['attributes']]}, 95 % intervals"
    across = "images of the training set"
    return curves(groups, lambda row: row["images"], ticks, across, title, log=True)


FORM = Form("assets", derive, text, {"assets.png": picture})
STUDY = of_rows(FORM, rows, report, check)
RUN = partial(do, STUDY)

if __name__ == "__main__":
    sys.exit(command("assets"))
