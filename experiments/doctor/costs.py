"""Estimates the cost of commands on this machine from a measurement of a few seconds."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.config import Fidelity, MainConfig, Preset, TargetName
from experiments.config.presets import defaults
from experiments.evaluation.cost import cost_of, training_cost
from experiments.fit import STREETS, configured, planned
from experiments.main.job import plan
from experiments.run.context import Work
from experiments.target.folder import parts_of
from scene.attributes import default_unit
from scene.dataset.render import render_dataset
from scene.render import RenderSettings
from seg.recipes import RECIPES, with_steps
from seg.train import train
from shell.errors import UserError
from shell.interrupt import PROGRAM
from shell.target_file import TargetFile

SIZE = (240, 176)
"""Width and height of the measured images, as for the rewards of most targets."""
SECONDS = 2.5
"""Seconds of measured rendering, and of measured training."""


class Cost(NamedTuple):
    """Core seconds of a command on the machine of the plans' figures."""

    render: float
    train: float


class Pace(NamedTuple):
    """This machine's seconds for one second of the plans' figures."""

    render: float
    train: float

    def seconds(self, cost: Cost) -> float:
        """Seconds of a command on one core of this machine."""
        return cost.render * self.render + cost.train * self.train


def cost(plan: Sequence[Work]) -> Cost:
    """The cost of the nets of a plan, separately for rendering and training."""
    nets = [own for own in plan if own.what != STREETS]
    training = [own.nets * min(own.seconds, training_cost(own.fidelity)) for own in nets]
    return Cost(sum(own.cost for own in plan) - sum(training), sum(training))


def measure(seconds: float = SECONDS) -> Pace:
    """Render streets and train nets for some seconds each; compilation does not count."""
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


def commands(
    target: TargetFile, data: Path, size: tuple[int, int], known: Mapping[str, TargetName]
) -> dict[str, Cost]:
    """Commands for a folder with the cost of each; a new command is one line here.

    Args:
        target: describes its files.
        data: the folder.
        size: a suitable width and height of images.
        known: targets with their own command.
    """
    streets = Fidelity(*size, streets=400, shots=1, samples=1, train=RECIPES["lite0-frozen"])
    training = training_cost(streets)
    words = f"--images 400 --shots 1 --size {size[0]}x{size[1]}"
    found = {f"{PROGRAM} render {words} --out DIR": Cost(cost_of(streets) - training, 0.0)}
    with suppress(UserError):  # errors of the images are reported elsewhere
        folds = len(parts_of(target, data).folds)
        found[f"{shlex.join([PROGRAM, 'fit', str(data)])} --out DIR"] = cost(
            planned(configured(size), folds)
        )
    if target.name in known:
        presets: tuple[Preset, ...] = ("smoke", "quick")
        for preset in presets:
            config = defaults(MainConfig, known[target.name], preset)
            command = [PROGRAM, target.name, "--data", str(data), "--preset", preset]
            found[shlex.join(command)] = cost(plan(config))
    return found
