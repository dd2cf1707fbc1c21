"""What is the gain of outlines as annotators draw them over labels that are exact to the pixel?

    python -m benchmarks.outlines --target camvid --data DIR --holdout 0006R0 --seeds 5
    python -m benchmarks.outlines --target camvid --data DIR --holdout 0006R0 --few 14 --attributes random
    python -m benchmarks.outlines --data DIR --rules tree=3% tree=3%,fence=2%

Networks are trained on the same renders with exact labels and with those of each rule, alone or mixed with
``--few`` labelled images of the target. They are tested on its development images, without those few, and on
its reported images: a split, or the group of ``--holdout``. Gains are paired by seed.

A rule such as ``tree=3%,fence=2%`` outlines classes as `outlines` in target.yaml does.

``--out`` stores renders and finished networks: the same command resumes, also with more rules or seeds.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np

from benchmarks.networks import (
    DEVELOPMENT,
    NETWORKS,
    REPORTED,
    Recipe,
    Renders,
    finished,
    prepare,
    real_images,
    renders,
    run_benchmark,
    store,
)
from benchmarks.report import Row, gain_text, table, target_parser, write
from common import files
from common.errors import UserError
from common.labels.target_file import WIDEST, TargetFile
from experiments.app.doctor.outlines import RenderedLabels
from experiments.targets.few import share_of
from scene import outline
from scene.dataset.formats.png import encode
from scene.proposal import NAMES, read_streets
from seg.boundary import perimeters
from seg.classes import colorize, table_of
from seg.inference import score
from seg.metrics import iou, mean_iou
from seg.pyramid import training_features
from seg.recipes import RECIPES
from seg.train import train

EXACT = "exact"
SHOWN = 6
"""Rows of the sheet."""


# ---- rules


def with_outlines(rule: str, target: TargetFile) -> TargetFile:
    """Give a target the outlines of a rule.

    Raises:
        UserError: the text is not a rule, or names a class that is not rendered.
    """
    rendered = [name for name, has in zip(target.classes, target.rendered, strict=True) if has]
    shares = {}
    for item in [] if rule == EXACT else rule.split(","):
        match = re.fullmatch(r"(.+)=(\d+(?:\.\d+)?)%", item)
        share = float(match[2]) / 100 if match else 0.0
        if not match or not 0 < share <= WIDEST:
            raise UserError(
                f"--rules {item}: expected such as tree=3%, up to {100 * WIDEST:g} % of the width"
            )
        if match[1] not in rendered:
            raise UserError(f"--rules {item}: no such class; choose from {', '.join(rendered)}")
        shares[match[1]] = share
    return msgspec.structs.replace(target, outlines=shares)


def labels_of(rule: str, dataset: Renders, target: TargetFile) -> np.ndarray:
    """Draw the labels u8[n, h, w] of a target by a rule."""
    outlines = with_outlines(rule, target).engine_outlines
    return RenderedLabels(dataset.labels, dataset.depths).classes(target, outlines)


# ---- networks


def key(recipe: Recipe, rule: str, seed: int) -> dict[str, Any]:
    """Everything that a network depends on, with the source code of outlines."""
    names = ("training", "steps")
    source = None if rule == EXACT else files.file_digest(Path(outline.__file__))[:16]
    return {
        **recipe.real,
        **recipe.rendered,
        **{name: getattr(recipe, name) for name in names},
        "rule": rule,
        "outline": source,
        "seed": seed,
    }


def networks(recipe: Recipe, seed: int, rules: Sequence[str], folder: Path) -> list[dict[str, Any]]:
    """Train and test a network per rule on the renders of a seed, which share their features.

    Each line is written at once; runs in a worker.
    """
    settings, table = recipe.train, table_of(recipe.file)
    real, rendered = real_images(recipe, True), renders(recipe, seed, folder)
    images = rendered.images
    maps = training_features(images, settings) if settings.frozen else None
    lines, classes = [], len(table.classes)
    mixed: dict[str, Any] = {}
    if real.few is not None:
        mixed = {"extra": real.few, "share": share_of(recipe.few)}
    for rule in rules:
        started = time.process_time()
        labels = labels_of(rule, rendered, recipe.file)
        spent = 1000 * (time.process_time() - started) / len(labels)
        params = train(seed, images, labels, settings, classes, features=maps, **mixed)
        confusions = {}
        for side, tested in ((DEVELOPMENT, real.development), (REPORTED, real.reported)):
            if tested is not None:
                pair, maps_of = (tested.images, tested.labels), tested.features
                confusion = score(params, *pair, settings, classes, features=maps_of)
                confusions[side] = confusion.tolist()
        line = {"key": key(recipe, rule, seed), "ms": spent, "scores": confusions}
        store(folder / NETWORKS, line)
        lines.append(line)
    return lines


# ---- tables


def gain_rows(scores: dict[str, dict[int, np.ndarray]], classes: Sequence[str]) -> list[Row]:
    """Tabulate the gain of each rule over exact labels: by seed, its mean with a 95 % interval, by class."""
    exact, rows = scores[EXACT], []
    for rule, by_seed in scores.items():
        seeds = sorted(by_seed)
        mious, exact_mious = ([100 * mean_iou(c[s]) for s in seeds] for c in (by_seed, exact))
        row: Row = {"labels": rule, "mIoU": float(np.mean(mious))}
        row |= {"gain by seed": "", "gain": "", "classes": ""}
        if rule != EXACT:
            one, other = (np.mean([iou(c[s]) for s in seeds], axis=0) for c in (by_seed, exact))
            changes = dict(zip(classes, (100 * (one - other)).tolist(), strict=True))
            largest = sorted(changes.items(), key=lambda item: -abs(np.nan_to_num(item[1])))
            row |= {
                "gain by seed": " ".join(
                    f"{a - b:+.2f}" for a, b in zip(mious, exact_mious, strict=True)
                ),
                "gain": gain_text(mious, exact_mious),
                "classes": ", ".join(f"{name} {change:+.1f}" for name, change in largest),
            }
        rows.append(row)
    return rows


def shape_rows(sets: dict[str, np.ndarray], classes: Sequence[str]) -> list[Row]:
    """Tabulate boundary per area of each class, and connected parts per image, in sets of labels."""
    rows: list[Row] = [{"class": name} for name in classes]
    for title, labels in sets.items():
        sides, areas = perimeters(labels, len(classes))
        for k, row in enumerate(rows):
            masks = (labels == k).astype(np.uint8)
            parts = sum(cv2.connectedComponents(mask)[0] - 1 for mask in masks) / len(masks)
            row[title] = f"{sides[k] / areas[k]:.2f}; {parts:.0f}" if areas[k] else "-"
    return rows


def sheet(recipe: Recipe, rules: Sequence[str], folder: Path) -> np.ndarray:
    """Arrange rows of a rendered image, its labels by each rule, a real label and its image."""
    table, real = table_of(recipe.file), real_images(recipe, False).development
    shown = Renders(*(array[:SHOWN] for array in renders(recipe, 0, folder)))
    chosen = np.linspace(0, len(real.images) - 1, len(shown.images)).round().astype(int)
    labels = [labels_of(rule, shown, recipe.file) for rule in rules]
    columns = [colorize(column, table.colors) for column in (*labels, real.labels[chosen])]
    return np.vstack(list(np.concatenate([shown.images, *columns, real.images[chosen]], axis=2)))


# ---- command line


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    return run_benchmark(_run, _options(arguments))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    few = ("few", 0, "labelled images in every training set")
    defaults = Recipe._field_defaults
    command = target_parser(
        __doc__, "outlines", defaults, holdout="reported on", seeds=5, counts=[few]
    )
    add = command.add_argument
    add(
        "--rules",
        nargs="+",
        default=["tree=3%"],
        help="rules to compare with exact labels (tree=3%%)",
    )
    add("--attributes", default="default", help=f"{', '.join(NAMES)}, or a file (default)")
    add("--training", choices=tuple(RECIPES), default="lite0-frozen", help="(lite0-frozen)")
    return command.parse_args(arguments)


def _run(options: argparse.Namespace) -> None:
    values = vars(options)
    recipe = Recipe(**{name: values[name] for name in Recipe._fields if name in values})
    rules = [EXACT, *(rule for rule in dict.fromkeys(options.rules) if rule != EXACT)]
    for rule in rules:
        with_outlines(rule, recipe.file)
    read_streets(recipe.attributes, recipe.space)
    prepare(recipe, options.out)
    lines = finished(networks, recipe, rules, partial(key, recipe), options)
    real, classes = real_images(recipe, False), recipe.file.class_names
    tables: dict[str, list[Row]] = {}
    for side in (DEVELOPMENT, REPORTED):
        scores = {
            rule: {
                seed: np.array(lines[rule, seed]["scores"][side]) for seed in range(options.seeds)
            }
            for rule in rules
            if side in lines[rule, 0]["scores"]
        }
        if scores:
            tables[f"tested on {side} images"] = gain_rows(scores, classes)
    first = renders(recipe, 0, options.out)
    sets = {"real": real.development.labels}
    sets |= {rule: labels_of(rule, first, recipe.file) for rule in rules}
    tables["boundary per area; parts per image"] = shape_rows(sets, classes)
    spent = {rule: [lines[rule, seed]["ms"] for seed in range(options.seeds)] for rule in rules}
    tables["labels, milliseconds per image"] = [
        {"labels": rule, "ms": float(np.median(times))} for rule, times in spent.items()
    ]
    for title, rows in tables.items():
        print(f"\n{title}\n{table(rows)}")
    files.write(options.out / "sheet.png", encode(sheet(recipe, rules, options.out)))
    print(
        f"\n{options.out / 'sheet.png'}: image, labels {', '.join(rules)}, real label, real image"
    )
    write(options.json, recipe=recipe._asdict(), seeds=options.seeds, **tables)


if __name__ == "__main__":
    sys.exit(main())
