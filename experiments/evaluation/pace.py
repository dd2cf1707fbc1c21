"""How fast this machine is, compared with that of `cost`: measured once, then read by every job.

`sdr-jax doctor` measures it again.
"""

from __future__ import annotations

import json
import os
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
from experiments.evaluation.in_worker import core_seconds, parts_of
from experiments.evaluation.job import Recipe
from experiments.evaluation.renders import Part, Rendered, mean_seconds, render_part
from scene.assets.catalogue import AssetPool
from scene.attributes import default_unit
from scene.compiled import cache_file
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


class Crew(NamedTuple):
    """The processes of a job on this machine."""

    pace: Pace  # of each
    workers: int  # each on a core
    trainers: int | None = None  # separate ones, while workers render; None: workers train, too

    def wall(self, cost: Cost) -> float:
        """Seconds of work after its start."""
        workers = max(self.workers, 1)
        if self.trainers is None:
            return self.pace.seconds(cost) / workers
        rendering, training = cost.render * self.pace.render, cost.train * self.pace.train
        return max(rendering / workers, training / self.trainers)

    def start(self, prepared: Cost) -> float:
        """Seconds until the first results: workers start, one compiles the renderer, all prepare images."""
        first = START_COST * self.pace.train + prepared.render * self.pace.render
        return first + self.wall(Cost(train=prepared.train))

    def seconds_of(self, cost: Cost) -> float:
        """Seconds of a whole command with its start, where the renderer has been compiled."""
        return self.start(Cost()) + self.wall(cost)


REFERENCE = Pace(1.0, 1.0)
"""The machine of `cost`."""
_MEASURED = Fidelity(*SIZE, streets=2, shots=1, samples=1, train=RECIPES["lite0-frozen"])


def measured_part() -> Part:
    """The streets whose rendering is measured, always the same: in a long job their assets exist, too."""
    recipe = Recipe(_MEASURED, "cityscapes", "embree", AssetPool())
    ((part,),) = parts_of(recipe, np.tile(default_unit(), (_MEASURED.streets, 1)), 0, 1, None)
    return part


def training_pace(seconds: float = SECONDS) -> float:
    """Train networks for some seconds; this process's seconds for one of the machine of `cost`."""
    rendered = render_part(measured_part())
    assert isinstance(rendered, Rendered)
    brief = replace(_MEASURED, train=with_steps(_MEASURED.train, 20))
    learn = partial(train, 0, rendered.images, rendered.labels, brief.train, 19)
    return mean_seconds(learn, (), seconds, core_seconds) / training_cost(brief)


def measured_by(workers: Workers) -> Pace:
    """Measure the mean pace of all workers at once: they share caches and memory, and may have GPUs.

    On two cores, each of two workers renders half as much again more slowly than one alone.
    """
    renderers = max(workers.workers, 1)
    rendering_tasks = [(render_part, (measured_part(),), SECONDS)] * renderers
    rendering = [seconds for _, seconds in workers.map(mean_seconds, rendering_tasks)]
    expected = cost_of(_MEASURED) - training_cost(_MEASURED)
    training_tasks = [(SECONDS,)] * (workers.trainers or renderers)
    training = [pace for _, pace in workers.map(training_pace, training_tasks, net=True)]
    return Pace(float(np.mean(rendering)) / expected, float(np.mean(training)))


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
    return cache_file(f"pace-{kind}.json")
