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
import json
import re
import sys
import time
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import cv2
import msgspec
import numpy as np

from benchmarks.report import Row, table, target_parser, write
from common import files
from common.command import exit_code
from common.errors import UserError
from common.labels.target_file import WIDEST, TargetFile, find_target
from common.lines import JsonLines
from common.progress import Progress
from common.workers.pool import WorkerError, WorkerPool
from experiments.app.doctor.outlines import RenderedLabels
from experiments.evaluation.in_worker import worker_environment
from experiments.tables.stats import paired_gain
from experiments.targets.few import CHOICE, share_of, spread
from experiments.targets.folder import parts_of
from scene import outline
from scene.assets.catalogue import AssetPool
from scene.attributes import SpaceName
from scene.dataset.formats.png import encode
from scene.dataset.render import render_street
from scene.proposal import NAMES, draw, read_streets
from scene.render import RenderSettings
from scene.version import ENGINE
from seg.boundary import perimeters
from seg.classes import colorize, table_of
from seg.data import DataError, LabelledImages, load
from seg.inference import score
from seg.metrics import iou, mean_iou
from seg.pyramid import features
from seg.recipes import RECIPES, with_steps
from seg.settings import TrainSettings
from seg.train import TrainingError, train
from seg.views import view_images

Variant = TypeVar("Variant")
EXACT = "exact"
DEVELOPMENT, REPORTED = "development", "reported"
NETWORKS = "networks.jsonl"
SHOWN = 6
"""Rows of the sheet."""


class Recipe(NamedTuple):
    """What all networks of a table share; only their labels differ."""

    data: str
    target: str | None = None
    holdout: str | None = None
    attributes: str = "default"  # a name, or a file of attributes
    space: SpaceName = "extended"
    width: int = 240
    height: int = 176
    streets: int = 300
    few: int = 0  # labelled images in every training set
    training: str = "lite0-frozen"
    steps: int = 500

    @property
    def train(self) -> TrainSettings:
        """The training settings of a network."""
        return with_steps(RECIPES[self.training], self.steps)

    @property
    def file(self) -> TargetFile:
        """The file of the target."""
        return find_target(self.target, Path(self.data))

    @property
    def rendered(self) -> dict[str, Any]:
        """Everything that renders depend on, but their seed."""
        names = ("space", "width", "height", "streets")
        path = Path(self.attributes)
        source = self.attributes if self.attributes in NAMES else files.file_digest(path)
        return {"engine": ENGINE, "attributes": source, **{n: getattr(self, n) for n in names}}

    @property
    def real(self) -> dict[str, Any]:
        """Everything that the labelled images depend on."""
        return {
            "target": self.file.name,
            "holdout": self.holdout,
            "few": self.few,
            "data": _digest(self),
        }

    def key(self, rule: str, seed: int) -> dict[str, Any]:
        """Everything that a network depends on, with the source code of outlines."""
        names = ("training", "steps")
        source = None if rule == EXACT else files.file_digest(Path(outline.__file__))[:16]
        return {
            **self.real,
            **self.rendered,
            **{name: getattr(self, name) for name in names},
            "rule": rule,
            "outline": source,
            "seed": seed,
        }


@lru_cache(maxsize=2)
def _digest(recipe: Recipe) -> str:
    """The digest of a target's file, and of the labelled images and their labels."""
    target = recipe.file
    parts = parts_of(target, Path(recipe.data), recipe.holdout)
    entries = [
        (entry.name, *(files.file_digest(path) for path in (entry.image_path, entry.label_path)))
        for entry in (*parts.entries, *parts.held_out)
    ]
    return files.digest([msgspec.to_builtins(target), entries])[:16]


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


# ---- images


class Renders(NamedTuple):
    """Rendered images, and what their labels are made from."""

    images: np.ndarray  # u8[n, h, w, 3]
    labels: np.ndarray  # u8[n, h, w] train ids
    depths: np.ndarray  # f32[n, h, w]


def renders(recipe: Recipe, seed: int, folder: Path) -> Renders:
    """Load the renders of a seed from their file, or render and store them."""
    key = files.digest({**recipe.rendered, "seed": seed})[:16]
    path = folder / f"renders-{key}.npz"
    if not path.exists():
        settings, pool = RenderSettings(recipe.width, recipe.height, 1), AssetPool()
        streets = read_streets(recipe.attributes, recipe.space)
        frames = [
            render_street(unit, seed, k, 1, settings, "embree", pool)[0]
            for k, unit in enumerate(draw(streets, seed, recipe.streets))
        ]
        part = path.with_name(f"{path.stem}.part.npz")
        np.savez(
            part,
            images=np.stack([frame.image for frame in frames]),
            labels=np.stack([frame.label for frame in frames]),
            depths=np.stack([frame.depth for frame in frames]),
        )
        part.replace(path)
    with np.load(path) as arrays:
        return Renders(*(arrays[name] for name in Renders._fields))


class Real(NamedTuple):
    """A target's labelled images by their use."""

    few: LabelledImages | None
    development: LabelledImages
    reported: LabelledImages | None


@lru_cache(maxsize=2)
def real_images(recipe: Recipe, with_features: bool) -> Real:
    """Read the labelled images, on request with the features of a frozen backbone; the few with all views."""
    target, size, settings = recipe.file, (recipe.height, recipe.width), recipe.train
    parts = parts_of(target, Path(recipe.data), recipe.holdout)
    entries = parts.entries
    names, sequences = zip(*((e.name, e.sequence) for e in entries), strict=True)
    chosen = {*spread(names, sequences, recipe.few, CHOICE).tolist()} if recipe.few else set()

    def read(entries: Sequence[Any], training: bool = False) -> LabelledImages | None:
        if not entries:
            return None
        images = load(entries, target, size)
        if not (with_features and settings.frozen):
            return images
        shown = view_images(images.images, settings) if training else images.images
        return images._replace(features=features(shown, settings))

    few = read([entry for k, entry in enumerate(entries) if k in chosen], training=True)
    development = read([entry for k, entry in enumerate(entries) if k not in chosen])
    assert development is not None
    return Real(few, development, read(parts.held_out))


# ---- networks


def networks(recipe: Recipe, seed: int, rules: Sequence[str], folder: Path) -> list[dict[str, Any]]:
    """Train and test a network per rule on the renders of a seed, which share their features.

    Each line is written at once; runs in a worker.
    """
    settings, table = recipe.train, table_of(recipe.file)
    real, rendered = real_images(recipe, True), renders(recipe, seed, folder)
    images = rendered.images
    maps = features(view_images(images, settings), settings) if settings.frozen else None
    log, lines, classes = JsonLines(folder / NETWORKS), [], len(table.classes)
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
        line = {"key": recipe.key(rule, seed), "ms": spent, "scores": confusions}
        with log.shared():
            log.append(line)
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
        row |= {"gain by seed": "", "gain": "", "95 %": "", "classes": ""}
        if rule != EXACT:
            gain, ci95 = paired_gain(mious, exact_mious)
            one, other = (np.mean([iou(c[s]) for s in seeds], axis=0) for c in (by_seed, exact))
            changes = dict(zip(classes, (100 * (one - other)).tolist(), strict=True))
            largest = sorted(changes.items(), key=lambda item: -abs(np.nan_to_num(item[1])))
            row |= {
                "gain by seed": " ".join(
                    f"{a - b:+.2f}" for a, b in zip(mious, exact_mious, strict=True)
                ),
                "gain": f"{gain:+.2f}",
                "95 %": ci95 and "{:+.2f} to {:+.2f}".format(*ci95),
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
    options = _options(arguments)
    users = (UserError, DataError, TrainingError)
    return exit_code(lambda: _run(options), (WorkerError,), users=users)


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
    lines = finished(networks, recipe, rules, recipe.key, options)
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


def prepare(recipe: Recipe, out: Path) -> None:
    """Make the folder of finished networks; UserError if ``--few`` leaves no image to test on."""
    labelled = len(parts_of(recipe.file, Path(recipe.data), recipe.holdout).entries)
    if recipe.few >= labelled:
        raise UserError(f"--few {recipe.few} leaves none of {labelled} labelled images to test on")
    with files.naming(out):
        out.mkdir(parents=True, exist_ok=True)


def finished(
    train_all: Callable[..., list[dict[str, Any]]],
    recipe: Recipe,
    variants: Sequence[Variant],
    key: Callable[[Variant, int], dict[str, Any]],
    options: argparse.Namespace,
    *more: Any,
) -> dict[tuple[Variant, int], dict[str, Any]]:
    """Collect the lines of all networks by variant and seed, trained now or stored.

    Args:
        train_all: called in a worker with the recipe, a seed, its missing variants, ``more`` and the folder;
            returns their lines, which it has written.
        recipe: the same for every network.
        variants: the alternatives to compare.
        key: everything that the network of a variant and a seed depends on.
        options: with ``seeds``, ``workers`` and ``out``.
        more: further arguments of ``train_all``.
    """

    def name(line_key: dict[str, Any]) -> str:
        return json.dumps(line_key, sort_keys=True)

    done = {name(line["key"]): line for line in JsonLines(options.out / NETWORKS).lines}
    tasks = []
    for seed in range(options.seeds):
        missing = [variant for variant in variants if name(key(variant, seed)) not in done]
        if missing:
            tasks.append((recipe, seed, missing, *more, options.out))
    total = len(variants) * options.seeds
    progress = Progress(total)
    progress.advance(total - sum(len(task[2]) for task in tasks), replayed=True)
    with WorkerPool(options.workers, worker_environment()) as workers:
        for index, lines in workers.map(train_all, tasks):
            done |= {name(line["key"]): line for line in lines}
            progress.advance(len(lines))
            progress.update(f"seed {tasks[index][1]}")
    progress.close()
    return {
        (variant, seed): done[name(key(variant, seed))]
        for variant in variants
        for seed in range(options.seeds)
    }


if __name__ == "__main__":
    sys.exit(main())
