"""What each part of a recipe is worth: one change at a time, on three training sets, paired by seed.

    python -m benchmarks.recipes --data CAMVID --net lite0 --out runs/recipes --json recipes.json

On CamVid's sequences 0016E5 and 0001TP (0006R0, which results are reported on, is never read). Nets are
trained on renders with random attributes, on renders with those set by eye, and on the real images of one
sequence; the first two are scored on both sequences, the last on the other one, and both ways count as one.
``worth`` is what a change adds to the mIoU of the net's own recipe, in points, and ``error`` the standard
error of that mean over seeds. What helps random attributes more than others makes the gain of learning
smaller: ``gain`` is that of the default attributes over random ones. ``--out`` remembers finished nets: the
same command goes on.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import Row, count, parser, table, write
from benchmarks.transfer.ingredients import render_world
from benchmarks.transfer.nets import ATTRIBUTES, REAL, SEQUENCES, steering_set
from benchmarks.transfer.recipe import CLASSES, TABLE, Recipe, Truth, units, world
from experiments.reward.miou import worker_environment
from scene.version import ENGINE
from scene.workers import WorkerPool
from seg.data import DataError
from seg.metrics import mean_iou
from seg.nets.lite0 import Pyramid
from seg.pyramid import channel_statistics, features
from seg.recipes import RECIPES
from seg.settings import TrainSettings
from seg.train import score, train
from seg.views import looks, view_images
from shell import files
from shell.command import exit_code, size
from shell.errors import UserError
from shell.lines import JsonLines
from shell.progress import Progress

ROWS = (*ATTRIBUTES, REAL)
Changes = Mapping[str, Any]
RECIPE: dict[str, TrainSettings] = {
    "lite0": RECIPES["lite0-frozen"],
    "lite0-tuned": RECIPES["lite0-tuned"],
    "compact": TrainSettings(steps=600),
}
"""What changes are made to, by the name that ``--net`` takes."""
EFFECTS = ("mirror", "colour", "mix", "blur", "noise", "scale")
AUGMENTATIONS: dict[str, Changes] = {
    name: {effect: effect in chosen for effect in EFFECTS}
    for name, chosen in {
        "no augmentation": (),
        "mirror alone": ("mirror",),
        "mirror and colour": ("mirror", "colour"),
        "mirror and mixed channels": ("mirror", "mix"),
        "mirror and blur": ("mirror", "blur"),
        "mirror and noise": ("mirror", "noise"),
        "mirror and scale": ("mirror", "scale"),
        "everything": EFFECTS,
    }.items()
}
HEADS: dict[str, Changes] = {
    "rate x 1/3": {"lr": 3e-3},
    "rate x 3": {"lr": 3e-2},
    "half the steps": {"steps": 150},
    "twice the steps": {"steps": 600},
    "batches of 8": {"batch": 8},
    "width 32": {"head_width": 32},
    "width 128": {"head_width": 128},
    "no class weights": {"weighted": False},
    "no dropout": {"head_dropout": 0.0},
    "statistics of real images": {"head_statistics": "target"},
    "every pixel in the loss": {"loss_stride": 1},
    "every 4th row and column": {"loss_stride": 4},
    "one view": {"views": 1},
    "four views, everything": {"views": 4, **AUGMENTATIONS["everything"]},
}
VARIANTS: dict[str, dict[str, Changes]] = {
    "lite0": {**HEADS, **AUGMENTATIONS},
    "lite0-tuned": {},
    "compact": AUGMENTATIONS,
}
BASE = "recipe"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    options = _options(arguments)

    def work() -> None:
        try:
            _run(options)
        except DataError as error:
            raise UserError(str(error)) from error

    return exit_code(work)


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    command = parser(__doc__)
    command.prog = "python -m benchmarks.recipes"
    found = os.environ.get("CAMVID_DIR")
    command.add_argument("--data", type=Path, default=found and Path(found), help="CamVid")
    command.add_argument("--out", type=Path, default=Path("runs/recipes"), help="of finished nets")
    command.add_argument("--net", choices=RECIPE, default="lite0", help="and its own recipe")
    command.add_argument("--only", nargs="+", help="these changes; by default all of the net's")
    command.add_argument("--size", type=size, default=(240, 176), help="of all images (240x176)")
    command.add_argument(
        "--streets", type=partial(count, 1), default=50, help="of 8 images each (50)"
    )
    command.add_argument("--seeds", type=partial(count, 1), default=3, help="nets of each row (3)")
    command.add_argument(
        "--workers", type=partial(count, 0), default=2, help="processes, a core each (2)"
    )
    options = command.parse_args(arguments)
    if options.data is None:
        command.error("CamVid needs its folder: --data DIR (or the variable CAMVID_DIR)")
    known = VARIANTS[options.net]
    options.only = options.only or list(known)
    for name in options.only:
        if name not in known:
            command.error(f"--only {name!r}: {options.net} has {', '.join(map(repr, known))}")
    return options


def _run(options: argparse.Namespace) -> None:
    width, height = options.size
    own = Recipe(width=width, height=height, streets=options.streets, shots=8)
    base = RECIPE[options.net]
    wanted = {BASE: base}
    wanted |= {n: replace(base, **VARIANTS[options.net][n]) for n in options.only}
    with files.naming(options.out):
        options.out.mkdir(parents=True, exist_ok=True)
    log = JsonLines(options.out / "recipes.jsonl")
    keys = {
        (name, seed): _key(settings, own, seed)
        for seed in range(options.seeds)
        for name, settings in wanted.items()
    }
    done = {line["key"]: line["miou"] for line in log.lines}
    first: dict[str, tuple[str, int]] = {}  # some changes are the same as the recipe
    for where, key in keys.items():
        first.setdefault(key, where)
    missing = [where for key, where in first.items() if key not in done]
    progress = Progress(len(first))
    progress.advance(len(first) - len(missing), replayed=True)
    tasks = [(options.data, own, wanted[name], seed) for name, seed in missing]
    with WorkerPool(options.workers, worker_environment()) as workers:
        for index, (miou, seconds) in workers.map(score_rows, tasks):
            name, seed = missing[index]
            done[keys[name, seed]] = miou
            log.append({"key": keys[name, seed], "recipe": name, "miou": miou, "seconds": seconds})
            progress.advance(1)
            said = ", ".join(f"{row} {100 * value:.1f}" for row, value in miou.items())
            progress.update(f"{name}, seed {seed}: {said}")
    progress.close()
    scores = {n: [done[keys[n, seed]] for seed in range(options.seeds)] for n in wanted}
    rows = worth(scores)
    print(table(rows))
    write(
        options.json,
        net=options.net,
        recipe=asdict(base),
        size=f"{width}x{height}",
        seeds=options.seeds,
        rows=rows,
    )


def _key(settings: TrainSettings, own: Recipe, seed: int) -> str:
    return files.digest({**asdict(settings), **own._asdict(), "seed": seed, "engine": ENGINE})


def worth(scores: Mapping[str, Sequence[Mapping[str, float]]]) -> list[Row]:
    """One line for each recipe: mIoU by training set, and what its change adds, in points.

    Args:
        scores: by recipe, for each seed the mIoU in [0, 1] by training set.
    """
    values = {
        name: {row: 100 * np.array([one[row] for one in every]) for row in ROWS}
        for name, every in scores.items()
    }
    found = []
    for name, own in values.items():
        line: Row = {"change": name}
        for row in ROWS:
            line[row] = float(own[row].mean())
        line["gain"] = line["default"] - line["random"]
        for row in ROWS:
            difference = own[row] - values[BASE][row]
            line[f"{row}_worth"] = None if name == BASE else float(difference.mean())
            known = name != BASE and len(difference) > 1
            error = difference.std(ddof=1) / np.sqrt(len(difference)) if known else None
            line[f"{row}_error"] = None if error is None else float(error)
        found.append(line)
    return found


def score_rows(
    data: Path, own: Recipe, settings: TrainSettings, seed: int
) -> tuple[dict[str, float], float]:
    """The mIoU of nets trained on each training set, and the seconds that took; in a worker."""
    started = time.perf_counter()

    def confusion(row: str, on: str) -> np.ndarray:
        seen, unseen = (_truth(data, own, name, seed) for name in (row, on))
        given: dict[str, Any] = {}
        known: dict[str, Any] = {}
        if settings.frozen:
            given["features"] = _views(data, own, row, seed, looks(settings))
            known["features"] = _features(data, own, on)
        if settings.head_statistics == "target":
            given["statistics"] = channel_statistics(known["features"])
        params = train(seed, *seen, settings, CLASSES, **given)
        return score(params, *unseen, settings, CLASSES, **known)

    one, other = SEQUENCES
    found = {row: mean_iou(confusion(row, REAL)) for row in ATTRIBUTES}
    found[REAL] = mean_iou(confusion(one, other) + confusion(other, one))
    return found, round(time.perf_counter() - started, 1)


@lru_cache(maxsize=1)
def _real(data: Path, own: Recipe) -> dict[str, Truth]:
    """The images of each sequence, and of both."""
    real = steering_set(data, own)
    chosen = {name: np.asarray(real.sequences) == name for name in SEQUENCES}
    parts = {name: Truth(real.images[c], real.labels[c]) for name, c in chosen.items()}
    return {**parts, REAL: Truth(real.images, real.labels)}


@lru_cache(maxsize=len(ATTRIBUTES))
def _rendered(own: Recipe, attributes: str, seed: int) -> Truth:
    return Truth(*render_world(world(own), units(own, attributes, seed), seed, own.shots, TABLE))


def _truth(data: Path, own: Recipe, name: str, seed: int) -> Truth:
    """Images and labels: of renders with some attributes, or of a sequence."""
    return _rendered(own, name, seed) if name in ATTRIBUTES else _real(data, own)[name]


@lru_cache(maxsize=len(ATTRIBUTES) + len(SEQUENCES))
def _views(data: Path, own: Recipe, name: str, seed: int, shown: TrainSettings) -> Pyramid:
    return features(view_images(_truth(data, own, name, seed).images, shown))


@lru_cache(maxsize=1 + len(SEQUENCES))
def _features(data: Path, own: Recipe, name: str) -> Pyramid:
    return features(_truth(data, own, name, 0).images)


if __name__ == "__main__":
    sys.exit(main())
