"""Measures the speed with 1 and 2 workers, and estimates it for 1, 8 and 64.

    python -m benchmarks.scale [--json FILE]                              # some minutes
    python -m benchmarks.scale --scheduler tcp://10.0.0.1:8786            # also an existing Dask cluster

It measures exports of labelled streets, and rewards (render, train, test) as in the demo. The estimate is for
10,000 images of that size and for a search of 1,000 rewards at the paper's size, whose training costs as much
as ``experiments.evaluation.cost`` says. Some work is serial: the main process writes the files of an export,
which come over a network of 1 Gbit/s; updates of a search follow each other, and each needs some rewards at
once. ``busy`` is the share of the workers' time that is work, ``first`` the bottleneck.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

import sdr_jax
from benchmarks.report import Row, count, parser, table, timed, write
from benchmarks.train import random_truth
from common.errors import UserError
from common.workers.executors import workers_of
from common.workers.pool import WorkerPool, Workers
from experiments.config import Fidelity, MainConfig
from experiments.config.presets import defaults
from experiments.evaluation.cost import cost_of, training_cost
from experiments.evaluation.in_worker import attempt, evaluate_miou, worker_environment
from experiments.evaluation.job import Recipe
from scene.assets.catalogue import AssetPool
from scene.attributes import NAMES
from scene.dataset.export import export_dataset
from scene.proposal import default_proposal, draw, random_proposal
from scene.render import RenderSettings
from scene.versions import picture_versions

NETWORK = 125e6
"""Bytes per second between machines, 1 Gbit/s; not measured."""
PLANNED = (1, 8, 64)
IMAGES, REWARDS = 10_000, 1_000
SHOTS = 6


class Export(NamedTuple):
    """The costs of an image of an export."""

    seconds: float  # of a worker's core
    main: float  # seconds of the main process, which writes it
    size: float  # bytes on the disk


def export(workers: Workers, streets: int, width: int, height: int) -> tuple[float, Export]:
    """Wall seconds per image, and its costs; from the second of two exports, since assets exist then."""
    settings = RenderSettings(width, height)
    with tempfile.TemporaryDirectory() as folder:
        for name in ("first", "second"):
            cpu = time.process_time()
            wall, _ = timed(
                partial(
                    export_dataset, draw(default_proposal(), 0, streets), 0, Path(folder) / name,
                    shots=SHOTS, settings=settings, workers=workers,
                )
            )  # fmt: skip
            main = time.process_time() - cpu
        size = sum(p.stat().st_size for p in (Path(folder) / name).rglob("*") if p.is_file())
    images = streets * SHOTS
    return wall / images, Export(wall * workers.workers / images, main / images, size / images)


def rewards(workers: Workers, number: int, fidelity: Fidelity) -> tuple[float, float]:
    """Wall seconds per reward, and the seconds of a worker, without compilation and loading."""
    truth = random_truth(fidelity, 8, 19)
    recipe = Recipe(fidelity, "cityscapes", "embree", AssetPool())
    spent = 0.0
    for first in (0, 1000):  # seeds; the first round is not counted
        tasks = [
            (evaluate_miou, recipe, random_proposal(), first + k, truth) for k in range(number)
        ]
        started = time.perf_counter()
        outcomes = list(workers.map(attempt, tasks, net=True))
        wall = time.perf_counter() - started
        spent = sum(outcome.seconds for _, outcome in outcomes)
    return wall / number, spent / number


def update_seconds(datasets: int, updates: int = 12) -> float:
    """Seconds of the paper's method itself for an update."""
    space = sdr_jax.space(NAMES, 10, [NAMES])
    method = sdr_jax.registry.make("sdr", space, None, updates_per_group=updates + 1)
    reward = sdr_jax.host_reward(lambda asked: np.zeros(len(asked.seeds), np.float32))
    steps = sdr_jax.drive(jax.random.key(0), method, reward, updates + 1, datasets)
    next(steps)  # compiles
    seconds, _ = timed(lambda: jax.block_until_ready([record.rewards for _, record in steps]))
    return seconds / updates


def measured(kind: str, seconds: dict[str, tuple[int, float]]) -> list[Row]:
    """Rows of one kind of work: seconds per item, and the efficiency of more workers."""
    alone = next(iter(seconds.values()))
    return [
        {
            "work": kind,
            "workers": who,
            "s_per_item": each,
            "efficiency": alone[1] * alone[0] / (each * number),
        }
        for who, (number, each) in seconds.items()
    ]


def dataset_plan(images: int, costs: Export, workers: int) -> Row:
    """Hours of a dataset, and the bottleneck: the slowest of three parts that work side by side."""
    parts = {
        "workers": images * costs.seconds / workers,
        "main process (files)": images * costs.main,
        "network": images * costs.size / NETWORK,
    }
    return _planned(f"{images:,} images", workers, parts)


class Reward(NamedTuple):
    """The costs of a reward, and of an update of the method."""

    render: float  # seconds of a worker
    train: float
    update: float  # of the main process


def search_plan(number: int, datasets: int, costs: Reward, workers: int) -> Row:
    """Hours of a search whose updates each evaluate some data sets and then wait for the method."""

    def update(asked: int) -> float:
        if asked < workers:  # all of them render each
            return asked * costs.render / workers + costs.train + costs.update
        return math.ceil(asked / workers) * (costs.render + costs.train) + costs.update

    full, rest = divmod(number, datasets)
    parts = {
        "workers": number * (costs.render + costs.train) / workers,
        "updates, one after the other": full * update(datasets) + (update(rest) if rest else 0.0),
    }
    what = f"{number:,} rewards, {datasets} an update"
    return _planned(what, workers, parts)


def _planned(what: str, workers: int, parts: dict[str, float]) -> Row:
    first = max(parts, key=lambda name: parts[name])
    busy = parts["workers"] / parts[first]
    return {
        "what": what,
        "workers": workers,
        "hours": parts[first] / 3600,
        "busy": busy,
        "first": "workers" if busy > 0.99 else first,
    }


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    command = parser(__doc__)
    positive = partial(count, 1)
    command.add_argument("--streets", type=positive, default=8, help="streets of the export")
    command.add_argument("--size", type=int, nargs=2, default=(640, 320), help="size of its images")
    command.add_argument("--rewards", type=positive, default=8)
    command.add_argument("--preset", choices=("smoke", "quick"), default="quick", help="of rewards")
    command.add_argument("--workers", type=positive, nargs="+", default=(1, 2))
    command.add_argument("--scheduler", metavar="ADDRESS", help="measure a Dask cluster, too")
    options = command.parse_args(arguments)
    if options.workers[0] != 1:
        command.error("--workers must begin with 1, with which the others are compared")
    alone, own = Export(0.0, 0.0, 0.0), 0.0  # of the first worker, which works alone
    images: dict[str, tuple[int, float]] = {}
    nets: dict[str, tuple[int, float]] = {}
    fidelity = defaults(MainConfig, "twin", options.preset).reward
    everyone: list[tuple[str, Workers]] = [
        (str(number), WorkerPool(number, worker_environment())) for number in options.workers
    ]
    try:
        if options.scheduler is not None:
            cluster = workers_of(
                "dask", 0, options.scheduler, worker_environment(), picture_versions
            )
            everyone.append((f"{cluster.workers} (dask)", cluster))
        for who, workers in everyone:
            with workers:
                each, costs = export(workers, options.streets, *options.size)
                images[who] = workers.workers, each
                alone = costs if who == "1" else alone
                each, core = rewards(workers, options.rewards, fidelity)
                nets[who] = workers.workers, each
                own = core if who == "1" else own
    except (UserError, OSError) as error:
        command.error(str(error))
    paper = defaults(MainConfig, "cityscapes", "paper").reward
    update = update_seconds(8)
    train = training_cost(paper)
    reward = Reward(cost_of(paper) - train, train, update)
    rows = measured(f"images of {options.size[0]}x{options.size[1]}", images)
    rows += measured(f"rewards of --preset {options.preset}", nets)
    plan = [dataset_plan(IMAGES, alone, workers) for workers in PLANNED]
    plan += [
        search_plan(REWARDS, datasets, reward, workers)
        for datasets in (1, 8, 64)
        for workers in PLANNED
    ]
    costs_of = {
        "image, worker s": alone.seconds,
        "image, main process s": alone.main,
        "image, bytes": alone.size,
        "reward here, worker s": own,
        "reward here by cost_of, s": cost_of(fidelity),
        "paper's reward by cost_of, rendering, s": reward.render,
        "paper's reward by cost_of, training, s": reward.train,
        "paper's update of 8, s": update,
    }
    units: list[Row] = [{"cost": name, "value": value} for name, value in costs_of.items()]
    print("\n\n".join(map(table, (rows, units, plan))))
    write(options.json, rows=rows, costs=units, plan=plan)
    return 0


if __name__ == "__main__":
    sys.exit(main())
