"""Checks a machine with a GPU in one command: tests, rendering, nets, and the paper's search.

    python -m benchmarks.gpu --data CAMVID --weights vgg16.npz --tests --json gpu.json
    python -m benchmarks.gpu --small                                    # a minute on a CPU: does it run?

It measures the seconds of a rendered image by both renderers (`opengl` through EGL uses the card), of the
first updates, most of which XLA compiles (minutes on a GPU), of an update and a prediction in float32 and
bfloat16, of lite0's features, and of one whole reward of `--preset paper` on CamVid. From these it computes
the time of the paper's search: 300 rewards of 180 images and 1000 updates, which took the authors 52 hours on
one RTX 2080 Ti. Only the JSON stays on the disk.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np

from benchmarks.report import Row, machine, parser, table, timed, write
from benchmarks.train import random_truth
from common.errors import UserError
from experiments.config import Fidelity, MainConfig
from experiments.config.presets import defaults
from experiments.evaluation.in_worker import evaluate_miou, render
from experiments.evaluation.job import Recipe
from scene.assets.catalogue import AssetPool
from scene.proposal import default_proposal
from scene.render import RendererError
from seg.classes import class_table
from seg.data import LabelledImages, read_split
from seg.pyramid import features
from seg.recipes import with_net
from seg.settings import TrainSettings
from seg.train import predict, train

PAPER_HOURS = 52
"""Hours of the whole search on one RTX 2080 Ti. Source: the paper, section 4."""
TABLE = "camvid"
NETS = ("fcn8s", "deeplabv2", "lite0", "compact")
SMALL = ("compact", "lite0")
CHUNK = 50
"""Updates between two readings of the clock; `seg.train` checks the loss as often."""


def rendering(fidelity: Fidelity, names: list[str]) -> list[Row]:
    """Seconds of an image in one process by every renderer of this machine."""
    rows = []
    for name in names:
        recipe = Recipe(fidelity, TABLE, name, AssetPool())
        brief = recipe._replace(fidelity=replace(fidelity, streets=1))
        try:
            render(brief, default_proposal(), 1)  # compiles programs and builds assets
            seconds, _ = timed(partial(render, recipe, default_proposal(), 0))
        except RendererError as error:
            print(f"{name}: {error}", file=sys.stderr)
            continue
        rows.append(_row("image", name, "", fidelity, seconds / fidelity.images))
    return rows


def nets(fidelity: Fidelity, names: Sequence[str], updates: int) -> list[Row]:
    """Seconds of first updates, with compilation, of an update, and of an image's prediction and features."""
    classes = len(class_table(TABLE).classes)
    images, labels, *_ = random_truth(fidelity, 16, classes)
    rows = []
    for name in names:
        for dtype in ("float32", "bfloat16"):
            own = with_net(fidelity.train, net=name)
            settings = replace(own, dtype=dtype, steps=updates + CHUNK)
            first, seconds, params = _update(settings, images, labels, classes)
            rows.append(_row(f"first {CHUNK}", name, dtype, fidelity, first, settings.batch))
            rows.append(_row("update", name, dtype, fidelity, seconds, settings.batch))
            passes: dict[str, Callable[[], Any]] = {
                "prediction": partial(predict, params, images, settings, classes)
            }
            if settings.frozen:
                passes["features"] = partial(features, images, settings)
            for what, run in passes.items():
                run()  # compiles
                rows.append(_row(what, name, dtype, fidelity, timed(run)[0] / len(images)))
    return rows


def _update(
    settings: TrainSettings, images: np.ndarray, labels: np.ndarray, classes: int
) -> tuple[float, float, Any]:
    """Seconds of the first `CHUNK` updates, with compilation, and of one afterwards; and the parameters."""
    started = time.perf_counter()
    looks: list[tuple[int, float]] = []
    params = train(
        0, images, labels, settings, classes,
        lambda step, _: looks.append((step, time.perf_counter())),
    )  # fmt: skip
    (first, began), (last, ended) = looks[0], looks[-1]
    return began - started, (ended - began) / (last - first), params


def _row(
    what: str, of: str, dtype: str, fidelity: Fidelity, seconds: float, batch: int | None = None
) -> Row:
    print(f"{what} {of} {dtype} {1000 * seconds:.3g} ms", file=sys.stderr, flush=True)
    return {
        "what": what, "of": of, "dtype": dtype, "size": fidelity.size, "batch": batch,
        "ms": 1000 * seconds,
    }  # fmt: skip


def reward(fidelity: Fidelity, truth: LabelledImages, renderer: str) -> Row:
    """One evaluation as in a search, the second one of its process."""
    recipe = Recipe(fidelity, TABLE, renderer, AssetPool())
    for seed in (0, 1):
        outcome = evaluate_miou(recipe, default_proposal(), seed, truth)
    return {
        "renderer": renderer, "net": fidelity.train.net, "size": fidelity.size,
        "images": fidelity.images, "updates": fidelity.train.steps, "scored": len(truth.images),
        "render_s": outcome.render_seconds, "train_s": outcome.train_seconds,
        "miou": 100 * outcome.reward,
    }  # fmt: skip


def projected(rewards: int, own: Row, cores: int) -> Row:
    """Hours of a search of so many rewards: one after the other, and with rendering beside training."""
    serial = own["render_s"] + own["train_s"]
    beside = max(own["render_s"] / max(cores - 1, 1), own["train_s"])
    return {
        "rewards": rewards,
        "hours_one_by_one": rewards * serial / 3600,
        "hours_rendering_beside": rewards * beside / 3600,
        "first_to_saturate": "rendering" if beside > own["train_s"] else "training",
        "the_paper": PAPER_HOURS,
    }


def tests(words: list[str]) -> Row:
    """Run the tests in a new process; their last line."""
    command = [sys.executable, "-m", "pytest", "-q", *words]
    run = partial(subprocess.run, command, capture_output=True, text=True, check=False)
    seconds, found = timed(run)
    lines = found.stdout.strip().splitlines() or found.stderr.strip().splitlines() or [""]
    return {
        "tests": " ".join(words), "exit_code": found.returncode, "said": lines[-1],
        "seconds": seconds,
    }  # fmt: skip


def _real_images(data: Path, fidelity: Fidelity) -> LabelledImages:
    return read_split(TABLE, data, "train", (fidelity.height, fidelity.width))


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    command = parser(__doc__)
    command.add_argument("--data", type=Path, help="folder of CamVid; by default noise")
    command.add_argument("--weights", help="of VGG16, from `sdr-jax weights`; by default none")
    command.add_argument("--nets", nargs="+", choices=NETS, help="nets to time")
    command.add_argument("--renderers", nargs="+", default=["opengl", "embree"])
    command.add_argument("--tests", action="store_true", help="also run the tests, with slow ones")
    command.add_argument("--small", action="store_true", help="everything tiny: does it run?")
    options = command.parse_args(arguments)
    config = defaults(MainConfig, "camvid", "smoke" if options.small else "paper")
    fidelity, updates, tested = config.reward, 300, 266
    if options.small:
        updates, tested = CHUNK, 4
    timed = options.nets or (SMALL if options.small else NETS)
    if options.weights:
        own = with_net(fidelity.train, net=fidelity.train.net, weights=options.weights)
        fidelity = replace(fidelity, train=own)
    devices = [str(device) for device in jax.devices()]
    print(f"{jax.default_backend()}: {', '.join(devices)}", flush=True)
    try:
        truth = random_truth(fidelity, tested)
        if options.data is not None:
            truth = _real_images(options.data, fidelity)
        rows = rendering(fidelity, options.renderers)
        rows += nets(fidelity, timed, updates)
        print(table(rows), flush=True)
        usable = [row["of"] for row in rows if row["what"] == "image"]
        rewards = [reward(fidelity, truth, name) for name in usable]
    except (UserError, ValueError) as error:
        command.error(str(error))
    count = config.search.updates_per_group * len(config.groups) * config.search.datasets_per_update
    cores = machine()["cores"]
    plans = [{"renderer": own["renderer"], **projected(count, own, cores)} for own in rewards]
    print(f"\n{table(rewards)}\n\n{table(plans)}", flush=True)
    chosen = ["tests/test_imports.py"] if options.small else ["tests"]
    done = [tests(chosen)] if options.tests else []
    for row in done:
        print(f"\n{row['tests']}: {row['said']}", flush=True)
    write(
        options.json, backend=jax.default_backend(), devices=devices,
        rows=rows, rewards=rewards, plans=plans, tests=done,
    )  # fmt: skip
    return max((abs(row["exit_code"]) for row in done), default=0)


if __name__ == "__main__":
    sys.exit(main())
