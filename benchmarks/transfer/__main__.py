"""Measures how renders transfer to real images, and how real they look to a net that knows real ones.

    python -m benchmarks.transfer --data CAMVID --json transfer.json

On CamVid's sequences 0016E5 and 0001TP (0006R0 is never read) it makes four tables: nets trained on renders
with random and with default attributes, tested on real images; the same on default streets without one
ingredient, paired by seed; nets trained on real images, tested on renders and on close-ups of single assets,
shown in ``close-ups-*.png`` in ``--out``; and the lightness of each class in both. ``--out`` keeps finished
nets: the same command continues, and begins anew if the engine has changed. These nets are compact.

    python -m benchmarks.transfer --data CAMVID --only content --width 480 --height 360 --streets 66

These nets are lite0, trained on hand-set streets and on the same with more content; the table has each class.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.report import Row, count, parser, table, write
from benchmarks.transfer import tables
from benchmarks.transfer.content import CONTENTS, content_net
from benchmarks.transfer.ingredients import render_world
from benchmarks.transfer.nets import (
    ATTRIBUTES,
    PARTS,
    REAL,
    SEQUENCES,
    WITHOUT,
    Net,
    engine,
    nets,
    steering_set,
)
from benchmarks.transfer.recipe import TABLE, Recipe, call, units, world
from experiments.evaluation.evaluate import worker_environment
from scene.workers import WorkerError, WorkerPool
from seg.classes import class_table
from seg.data import DataError
from seg.train import TrainingError
from shell import files
from shell.command import exit_code
from shell.errors import UserError
from shell.lines import CURE, JsonLines
from shell.progress import Progress

WITH = "with "

Scores = dict[str, list[dict[str, Any]]]
"""Row -> results of its nets in the order of their seeds."""


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    options = _options(arguments)

    def work() -> None:
        try:
            _run(options)
        except (DataError, TrainingError) as error:
            raise UserError(str(error)) from error

    return exit_code(work, also=(WorkerError,))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    command = parser(__doc__)
    command.prog = "python -m benchmarks.transfer"
    found, default = os.environ.get("CAMVID_DIR"), Recipe()
    command.add_argument(
        "--data", type=Path, default=found and Path(found), help="CamVid; by default CAMVID_DIR"
    )
    command.add_argument(
        "--out", type=Path, default=Path("runs/transfer"), help="folder of finished nets"
    )
    command.add_argument(
        "--only", choices=PARTS, nargs="+", default=PARTS[:4], help="these tables; all but content"
    )
    for flag, value, least, meaning in (
        ("--seeds", 3, 1, "nets of each row"),
        ("--width", default.width, 8, "pixels across, of renders and real images alike"),
        ("--height", default.height, 8, "pixels down"),
        ("--streets", default.streets, 1, f"of each dataset, {default.shots} images each"),
        ("--steps", default.steps, 1, "of a net trained on renders"),
        ("--real-steps", default.real_steps, 1, "of a net trained on real images"),
        ("--close-ups", default.close_ups, 1, "of each asset family, for each net"),
        ("--workers", 2, 0, "processes, one core each; 0 works in this one"),
    ):
        command.add_argument(
            flag, type=partial(count, least), default=value, help=f"{meaning} ({value})"
        )
    options = command.parse_args(arguments)
    if options.data is None:
        command.error("CamVid needs its folder: --data DIR (or the variable CAMVID_DIR)")
    return options


def _run(options: argparse.Namespace) -> None:
    recipe = Recipe(
        width=options.width,
        height=options.height,
        streets=options.streets,
        steps=options.steps,
        real_steps=options.real_steps,
        close_ups=options.close_ups,
    )
    real = steering_set(options.data, recipe)
    wanted = nets(recipe, real, options.only, range(options.seeds))
    if "content" in options.only:
        wanted += content_nets(options.data, recipe, range(options.seeds))
    with files.naming(options.out):
        options.out.mkdir(parents=True, exist_ok=True)
    scores = _train(wanted, JsonLines(options.out / "nets.jsonl"), options)
    classes = class_table(TABLE).classes
    found = summary(scores, classes)
    if "tones" in options.only:
        renders = render_world(world(recipe), units(recipe, "default", 0), 0, recipe.shots, TABLE)
        chosen = {s: np.asarray(real.sequences) == s for s in SEQUENCES}
        sets = {s: (real.images[c], real.labels[c]) for s, c in chosen.items()}
        found["tones"] = tables.tone_rows({**sets, "renders": renders}, classes)
    for title, rows in found.items():
        print(f"\n{title}\n{table(rows)}")
    write(options.json, recipe=recipe._asdict(), seeds=options.seeds, **found)


def content_nets(data: Path, recipe: Recipe, seeds: Sequence[int]) -> list[Net]:
    """Nets on streets with more content, seed after seed; all are lite0."""
    same = {"engine": engine(), "recipe": recipe._asdict()}
    return [
        Net(
            {**same, "net": WITH + name, "seed": seed},
            1.0,
            (content_net, data, recipe, name, seed),
        )
        for seed in seeds
        for name in CONTENTS
    ]


def _train(wanted: Sequence[Net], log: JsonLines, options: argparse.Namespace) -> Scores:
    """Train or read the results of every net; confusion matrices are lists."""
    done: dict[str, dict[str, Any]] = {}
    for k, line in enumerate(log.lines):
        if not isinstance(line.get("key"), dict) or not isinstance(line.get("scores"), dict):
            raise UserError(f"{log.where(k)} has no key and scores; {CURE}")
        done[_name(line["key"])] = line["scores"]
    missing = [net for net in wanted if _name(net.key) not in done]
    progress = Progress(sum(net.cost for net in wanted))
    progress.advance(sum(n.cost for n in wanted) - sum(n.cost for n in missing), replayed=True)
    with WorkerPool(options.workers, worker_environment()) as workers:
        for index, (scores, sheet) in workers.map(call, [net.task for net in missing]):
            key = missing[index].key
            if sheet is not None:
                _, data = cv2.imencode(".png", sheet[..., ::-1])
                files.write(options.out / f"close-ups-{key['seed']}.png", data.tobytes())
            log.append({"key": key, "scores": scores})
            done[_name(key)] = scores
            progress.advance(missing[index].cost)
            progress.update(f"{key['net']}, seed {key['seed']}")
    progress.close()
    found: Scores = {}
    for net in wanted:
        found.setdefault(net.key["net"], []).append(done[_name(net.key)])
    return found


def _name(key: dict[str, Any]) -> str:
    return json.dumps(key, sort_keys=True)


def summary(scores: Scores, classes: Sequence[str]) -> dict[str, list[Row]]:
    """The tables whose nets exist."""
    real = {name: [np.array(one["real"]) for one in every] for name, every in scores.items()}
    found = {}
    if ATTRIBUTES[0] in real:
        found["transfer"] = tables.transfer_rows({n: real[n] for n in ATTRIBUTES}, classes)
    without = {
        name.removeprefix(WITHOUT): c for name, c in real.items() if name.startswith(WITHOUT)
    }
    if without:
        found["ingredients"] = tables.ingredient_rows(real["default"], without, classes)
    contents = {name: real[WITH + name] for name in CONTENTS if WITH + name in real}
    if contents:
        found["content"] = tables.content_rows(contents, classes)
    if REAL in real:
        renders = [np.array(one["renders"]) for one in scores[REAL]]
        families = {
            family: np.sum([one["close-ups"][family] for one in scores[REAL]], axis=0)
            for family in scores[REAL][0]["close-ups"]
        }
        found["recognition"] = tables.recognition_rows(real[REAL], renders, classes)
        found["close-ups"] = tables.close_up_rows(families, real[REAL], classes)
    return found


if __name__ == "__main__":
    sys.exit(main())
