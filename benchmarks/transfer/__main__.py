"""Do renders transfer to real images, and do they look real to a net that knows real ones?

    python -m benchmarks.transfer --target camvid --data DIR --holdout 0006R0 --json transfer.json
    python -m benchmarks.transfer --target labelmefacade --data DIR --only transfer --seeds 5
    python -m benchmarks.transfer --data DIR --only transfer --seeds 5 --against runs/before/nets.jsonl

Networks trained on renders of random and of default streets, tested on labelled images of a target;
networks trained on real images, tested on others and on renders; and how light each class is in both. The
split that is reported on, and what ``--holdout`` names, are never read.
``--out`` stores finished networks: the same command resumes, and starts again if the engine has changed.
``--against`` is such a memory of another engine's: what has been gained since, class by class.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from benchmarks.report import Row, table, target_parser, write
from benchmarks.transfer import tables
from benchmarks.transfer.nets import ATTRIBUTES, PARTS, REAL, Net, nets
from benchmarks.transfer.recipe import Recipe, call, real_images, rendered
from common import files
from common.command import exit_code
from common.errors import UserError
from common.lines import CURE, JsonLines
from common.progress import Progress
from common.workers.pool import WorkerError, WorkerPool
from experiments.evaluation.in_worker import worker_environment
from scene.attributes import SpaceName
from seg.data import DataError
from seg.recipes import RECIPES
from seg.train import TrainingError

Scores = dict[str, list[dict[str, Any]]]
"""Row -> results of its nets, in the order of their seeds."""


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    options = _options(arguments)
    users = (UserError, DataError, TrainingError)
    return exit_code(lambda: _run(options), (WorkerError,), users=users)


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    command = target_parser(
        __doc__, "transfer", Recipe._field_defaults, holdout="not read", seeds=3
    )
    command.add_argument("--only", choices=PARTS, nargs="+", default=PARTS, help="these tables")
    command.add_argument("--against", type=Path, help="nets.jsonl in the --out of another engine")
    choices = {"space": get_args(SpaceName), "training": tuple(RECIPES)}
    for name, values in choices.items():
        default = Recipe._field_defaults[name]
        command.add_argument(f"--{name}", choices=values, default=default, help=f"({default})")
    return command.parse_args(arguments)


def _run(options: argparse.Namespace) -> None:
    flags = vars(options)
    recipe = Recipe(**{name: flags[name] for name in Recipe._fields if name in flags})
    real, classes, seeds = real_images(recipe), recipe.classes.classes, range(options.seeds)
    before = None if options.against is None else _before(options, recipe)
    with files.naming(options.out):
        options.out.mkdir(parents=True, exist_ok=True)
    scores = _train(
        nets(recipe, options.only, seeds), JsonLines(options.out / "nets.jsonl"), options
    )
    tables_by_title = summary(scores, classes, before)
    if "tones" in options.only:
        sets = {"real": real, **{name: rendered(recipe, name, 0) for name in ATTRIBUTES}}
        pairs = {name: (images.images, images.labels) for name, images in sets.items()}
        tables_by_title["tones"] = tables.tone_rows(pairs, classes)
    for title, rows in tables_by_title.items():
        print(f"\n{title}\n{table(rows)}")
    write(options.json, recipe=recipe._asdict(), seeds=options.seeds, **tables_by_title)


def _before(options: argparse.Namespace, recipe: Recipe) -> dict[str, list[np.ndarray]]:
    """Confusion matrices of the same nets with another engine, the last one in the file, by row."""
    if "transfer" not in options.only:
        raise UserError("--against needs the table transfer")
    if not options.against.is_file():
        raise UserError(f"--against {options.against}: no such file")
    done = _done(JsonLines(options.against))
    engine = next((json.loads(key)["engine"] for key in reversed(done)), "")
    same = {"engine": engine, "recipe": recipe._asdict()}
    try:
        return {
            name: [
                np.array(done[_name({**same, "net": name, "seed": seed})]["real"])
                for seed in range(options.seeds)
            ]
            for name in ATTRIBUTES
        }
    except KeyError as error:
        raise UserError(f"--against {options.against}: it lacks the net {error.args[0]}") from None


def _train(nets: Sequence[Net], log: JsonLines, options: argparse.Namespace) -> Scores:
    """Collect the results of every network, trained now or stored; confusion matrices as lists."""
    done = _done(log)
    missing = [net for net in nets if _name(net.key) not in done]
    progress = Progress(sum(net.cost for net in nets))
    progress.advance(sum(n.cost for n in nets) - sum(n.cost for n in missing), replayed=True)
    with WorkerPool(options.workers, worker_environment()) as workers:
        for index, scores in workers.map(call, [net.task for net in missing]):
            key = missing[index].key
            log.append({"key": key, "scores": scores})
            done[_name(key)] = scores
            progress.advance(missing[index].cost)
            progress.update(f"{key['net']}, seed {key['seed']}")
    progress.close()
    results: Scores = {}
    for net in nets:
        results.setdefault(net.key["net"], []).append(done[_name(net.key)])
    return results


def _done(log: JsonLines) -> dict[str, dict[str, Any]]:
    """Read the scores of every network in a file, by its key."""
    done: dict[str, dict[str, Any]] = {}
    for k, line in enumerate(log.lines):
        if not isinstance(line.get("key"), dict) or not isinstance(line.get("scores"), dict):
            raise UserError(f"{log.where(k)} has no key and scores; {CURE}")
        done[_name(line["key"])] = line["scores"]
    return done


def _name(key: dict[str, Any]) -> str:
    return json.dumps(key, sort_keys=True)


def summary(
    scores: Scores, classes: Sequence[str], before: Mapping[str, tables.Confusions] | None
) -> dict[str, list[Row]]:
    """Make the tables for which there are networks; gains over another engine, if ``before`` has any."""
    real = {
        name: [np.array(result["real"]) for result in results] for name, results in scores.items()
    }
    rows_of = {}
    if ATTRIBUTES[0] in real:
        rows_of["transfer"] = tables.transfer_rows({n: real[n] for n in ATTRIBUTES}, classes)
    if REAL in real:
        renders = [np.array(result["renders"]) for result in scores[REAL]]
        rows_of["recognition"] = tables.recognition_rows(real[REAL], renders, classes)
    if before is not None:
        rows_of["gains"] = tables.gain_rows({n: real[n] for n in ATTRIBUTES}, before, classes)
    return rows_of


if __name__ == "__main__":
    sys.exit(main())
