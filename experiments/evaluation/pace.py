"""How fast this machine is beside that of `cost`: measured once, then read by every job.

`sdr-jax doctor` measures it again.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from common.files import digest, write_json
from common.workers.pool import ExecutorName, Workers
from experiments.config import Fidelity
from experiments.evaluation.cost import START_COST, Cost, cost_of, training_cost
from scene.attributes import default_unit
from scene.compiled import kept
from scene.dataset.render import render_dataset
from scene.render import RenderSettings
from seg.recipes import RECIPES, with_steps
from seg.train import train

SIZE = (240, 176)
"""Width and height of the measured images, as for the rewards of most targets."""
SECONDS = 2.5
"""Seconds of measured rendering, and of measured training."""
WORTH = 120.0
"""CPU seconds of a job from which it measures the pace, which takes about ten."""


class Pace(NamedTuple):
    """This machine's seconds for one second of the machine of `cost`."""

    render: float
    train: float

    def seconds(self, cost: Cost) -> float:
        """Seconds of work on one core of this machine."""
        return cost.render * self.render + cost.train * self.train

    def wall(self, cost: Cost, cores: int) -> float:
        """Seconds of work on all cores of this machine, after its start."""
        return self.seconds(cost) / max(cores, 1)

    def seconds_of(self, cost: Cost, cores: int) -> float:
        """Seconds of a whole command with its start, where the renderer has been compiled."""
        return self.start(Cost(), cores) + self.wall(cost, cores)

    def start(self, prepared: Cost, cores: int) -> float:
        """Seconds until the first results: workers start, one compiles the renderer, all prepare images."""
        return (
            START_COST * self.train
            + prepared.render * self.render
            + self.wall(Cost(train=prepared.train), cores)
        )


REFERENCE = Pace(1.0, 1.0)
"""The machine of `cost`."""


def measure(seconds: float = SECONDS) -> Pace:
    """Render streets and train networks for some seconds each; compilation does not count."""
    streets = Fidelity(*SIZE, streets=2, shots=1, samples=1, train=RECIPES["lite0-frozen"])
    settings = RenderSettings(*SIZE, 1)
    units = np.tile(default_unit(), (streets.streets, 1))
    rendered = render_dataset(units, 0, shots=1, settings=settings)  # compiles
    # The same streets each time, so that their assets exist, as in a long job.
    render = _ratio(
        partial(render_dataset, units, 0, shots=1, settings=settings),
        cost_of(streets) - training_cost(streets),
        seconds,
    )
    brief = replace(streets, train=with_steps(streets.train, 20))
    learn = partial(train, 0, rendered.images, rendered.labels, brief.train, 19)
    learn()
    return Pace(render, _ratio(learn, training_cost(brief), seconds))


def _ratio(work: Callable[[], object], expected: float, seconds: float) -> float:
    """CPU time of work divided by the expected time; other programs do not count."""
    ends = time.perf_counter() + seconds
    started, done = time.process_time(), 0
    while not done or time.perf_counter() < ends:
        work()
        done += 1
    return (time.process_time() - started) / done / expected


def measured_by(workers: Workers) -> Pace:
    """Measure the mean pace of all workers at once: they share caches and memory, and may have GPUs.

    On two cores, each of two workers renders half as much again more slowly than one alone.
    """
    count = max(workers.workers, 1)
    paces = [pace for _, pace in workers.map(measure, [(SECONDS,)] * count, net=True)]
    return Pace(*np.mean(paces, axis=0).tolist())


def kind(executor: ExecutorName, backend: str) -> str:
    """The kind of workers that share a pace: where they are, their backend of JAX and its flags."""
    flags = os.environ.get("XLA_FLAGS", "")
    return "-".join([executor, backend, *([digest(flags)[:8]] if flags else [])])


def read(kind: str) -> Pace | None:
    """The pace of a kind of workers that was measured on this machine; None if there is none."""
    with suppress(OSError, ValueError, TypeError):
        pace = Pace(**json.loads(_file(kind).read_text()))
        if all(0 < ratio < np.inf for ratio in pace):
            return pace
    return None


def keep(kind: str, pace: Pace) -> None:
    """Keep a measured pace for later jobs on this machine; without a place for it they measure again."""
    with suppress(OSError):
        write_json(_file(kind), pace._asdict())


def _file(kind: str) -> Path:
    return kept(f"pace-{kind}.json")
