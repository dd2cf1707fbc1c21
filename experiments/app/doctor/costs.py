"""Estimates the run times of commands for a folder."""

from __future__ import annotations

import shlex
from contextlib import suppress
from functools import partial
from pathlib import Path

import msgspec

from common.command import PROGRAM
from common.errors import UserError
from common.labels.target_file import FILE, SHIPPED, TargetFile, shipped
from experiments.app.fit.config import choose_size, configured, cost_of_fit, default_preset
from experiments.app.main_job import plan
from experiments.config import Fidelity, MainConfig, Preset
from experiments.config.presets import TARGETS, defaults
from experiments.evaluation.cost import Cost, cost_of, training_cost
from experiments.evaluation.pace import Pace
from experiments.session.session import total_of
from experiments.targets.folder import parts_of
from experiments.targets.sizes import Choice, Size
from seg.recipes import RECIPES


def choice(target: TargetFile, data: Path, photographs: Size, pace: Pace) -> Choice | None:
    """The size that `fit` takes, with its time; None for images that it refuses."""
    with suppress(UserError):  # errors of the images are reported elsewhere
        at = partial(configured, preset=default_preset())
        return choose_size(at, parts_of(target, data), photographs, pace)
    return None


def commands(target: TargetFile, data: Path, size: Size) -> dict[str, Cost]:
    """Commands for a folder with the cost of each.

    Args:
        target: describes its files.
        data: the folder.
        size: width and height of the images.
    """
    streets = Fidelity(*size, streets=400, shots=1, samples=1, train=RECIPES["lite0-frozen"])
    training = training_cost(streets)
    words = f"--images 400 --shots 1 --size {size[0]}x{size[1]}"
    costs = {f"{PROGRAM} render {words} --out DIR": Cost(cost_of(streets) - training)}
    with suppress(UserError):
        command = [PROGRAM, "fit", str(data)]
        if target.source != str(data / FILE):
            command += ["--target", target.source]
        costs[f"{shlex.join(command)} --out DIR"] = cost_of_fit(
            configured(size, default_preset()), parts_of(target, data)
        )
    same = (name for name in TARGETS if name in SHIPPED and _like(target, name))
    for name in same:  # one at most
        presets: tuple[Preset, ...] = ("smoke", "quick")
        for preset in presets:
            config = defaults(MainConfig, name, preset)
            words = shlex.join([PROGRAM, name, "--data", str(data), "--preset", preset])
            costs[words] = total_of(plan(config))
    return costs


def _like(target: TargetFile, name: str) -> bool:
    """Whether a target is one of the package, or a copy of its file."""
    return msgspec.structs.replace(target, source=name) == shipped(name)
