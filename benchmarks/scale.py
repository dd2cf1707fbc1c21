"""Measure the speed with 1 and 2 workers, and estimate it for 1, 8 and 64.

    python -m benchmarks.scale [--json FILE]                              # a few minutes
    python -m benchmarks.scale --scheduler tcp://10.0.0.1:8786            # also an existing Dask cluster

It measures exports of labelled streets, and rewards (render, train, test) as in the demo. The estimate is for
10,000 images of that size and for a search of 1,000 rewards at the paper's size, whose training costs as much
as ``experiments.evaluation.cost`` estimates. Some work is serial: the main process writes the files of an
export, which come over a network of 1 Gbit/s; updates of a search follow each other, and each needs all its
rewards. ``busy`` is the share of the workers' time spent on work, ``first`` the bottleneck.
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
from benchmarks.noise import noise
from benchmarks.report import Row, count, parser, table, timed, write
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
    """Measure wall seconds and costs per image in the second of two exports, when assets exist."""
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
    """Measure wall seconds per reward, and worker seconds, without compilation and loading."""
    truth = noise(8, (fidelity.height, fidelity.width), 19)
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
    """Measure the seconds of an update of the paper's method, without rewards."""
    space = sdr_jax.space(NAMES, 10, [NAMES])
    method = sdr_jax.registry.make("sdr", space, None, updates_per_group=updates + 1)
    reward = sdr_jax.host_reward(lambda data_sets: np.zeros(len(data_sets.seeds), np.float32))
    steps = sdr_jax.drive(jax.random.key(0), method, reward, updates + 1, datasets)
    next(steps)  # compiles
    seconds, _ = timed(lambda: jax.block_until_ready([record.rewards for _, record in steps]))
    return seconds / updates


def measured(kind: str, seconds: dict[str, tuple[int, float]]) -> list[Row]:
    """Tabulate one kind of work: seconds per item, and the efficiency of more workers."""
    alone = next(iter(seconds.values()))
    return [
        {
            "work": kind,
            "workers": who,
            "s_per_item": s_per_item,
            "efficiency": alone[1] * alone[0] / (s_per_item * number),
        }
        for who, (number, s_per_item) in seconds.items()
    ]


def dataset_plan(images: int, costs: Export, workers: int) -> Row:
    """Estimate the hours of a dataset, and its bottleneck: the slowest of three concurrent parts."""
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
    """Estimate the hours of a search; each update evaluates data sets, then waits for the method."""

    def update(count: int) -> float:
        if count < workers:  # all workers render for each reward
            return count * costs.render / workers + costs.train + costs.update
        return math.ceil(count / workers) * (costs.render + costs.train) + costs.update

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
    """Run the command line; returns the exit code."""
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
        command.error("--workers must start with 1, with which the others are compared")
    image_costs, reward_seconds = Export(0.0, 0.0, 0.0), 0.0  # with one worker
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
                s_per_item, costs = export(workers, options.streets, *options.size)
                images[who] = workers.workers, s_per_item
                image_costs = costs if who == "1" else image_costs
                s_per_item, core = rewards(workers, options.rewards, fidelity)
                nets[who] = workers.workers, s_per_item
                reward_seconds = core if who == "1" else reward_seconds
    except (UserError, OSError) as error:
        command.error(str(error))
    paper = defaults(MainConfig, "cityscapes", "paper").reward
    update = update_seconds(8)
    train = training_cost(paper)
    reward = Reward(cost_of(paper) - train, train, update)
    rows = measured(f"images of {options.size[0]}x{options.size[1]}", images)
    rows += measured(f"rewards of --preset {options.preset}", nets)
    plan = [dataset_plan(IMAGES, image_costs, workers) for workers in PLANNED]
    plan += [
        search_plan(REWARDS, datasets, reward, workers)
        for datasets in (1, 8, 64)
        for workers in PLANNED
    ]
    costs_of = {
        "image, worker s": image_costs.seconds,
        "image, main process s": image_costs.main,
        "image, bytes": image_costs.size,
        "reward here, worker s": reward_seconds,
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
