"""Do networks trained on renders work on real images, and do those trained on real images recognise renders?

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
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import get_args

import numpy as np

from benchmarks.networks import finished, name_of, run_benchmark, stored
from benchmarks.report import Row, table, target_parser, write
from benchmarks.transfer import tables
from benchmarks.transfer.recipe import (
    ATTRIBUTES,
    NETS,
    REAL,
    Recipe,
    Scores,
    engine,
    key,
    networks,
    real_images,
    rendered,
)
from common import files
from common.errors import UserError
from scene.attributes import SpaceName
from seg.recipes import RECIPES

PARTS = ("transfer", "recognition", "tones")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    return run_benchmark(_run, _options(arguments))


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
    names = [REAL] if "recognition" in options.only else []
    names += ATTRIBUTES if "transfer" in options.only else ()
    sources = engine()
    key_of = partial(key, recipe, sources)
    lines = finished(networks, recipe, names, key_of, options, sources, file=NETS, at_once=False)
    scores = {name: [lines[name, seed]["scores"] for seed in seeds] for name in names}
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
    done = stored(options.against)
    sources = next((line["key"]["engine"] for line in reversed(done.values())), "")
    try:
        return {
            name: [
                np.array(done[name_of(key(recipe, sources, name, seed))]["scores"]["real"])
                for seed in range(options.seeds)
            ]
            for name in ATTRIBUTES
        }
    except KeyError as error:
        raise UserError(f"--against {options.against}: it lacks the net {error.args[0]}") from None


def summary(
    scores: Mapping[str, Sequence[Scores]],
    classes: Sequence[str],
    before: Mapping[str, tables.Confusions] | None,
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
