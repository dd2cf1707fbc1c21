"""Estimates the cost of commands for a folder."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from experiments.config import Fidelity, MainConfig, Preset, TargetName
from experiments.config.presets import defaults
from experiments.evaluation.cost import Cost, cost_of, prepare_cost, training_cost
from experiments.fit import configured, planned
from experiments.main.job import plan
from experiments.run.context import total_of
from experiments.target.folder import parts_of
from seg.recipes import RECIPES
from shell.errors import UserError
from shell.interrupt import PROGRAM
from shell.target_file import TargetFile


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
    found = {f"{PROGRAM} render {words} --out DIR": Cost(cost_of(streets) - training)}
    with suppress(UserError):  # errors of the images are reported elsewhere
        parts, fit = parts_of(target, data), configured(size)
        work = total_of(planned(fit, len(parts.folds)))
        features = prepare_cost(fit.final, len(parts.every))
        command = f"{shlex.join([PROGRAM, 'fit', str(data)])} --out DIR"
        found[command] = work._replace(train=work.train + features.train)
    if target.name in known:
        presets: tuple[Preset, ...] = ("smoke", "quick")
        for preset in presets:
            config = defaults(MainConfig, known[target.name], preset)
            words = shlex.join([PROGRAM, target.name, "--data", str(data), "--preset", preset])
            found[words] = total_of(plan(config))
    return found
