"""Trains a net on rendered streets alone, such as `renders19`, which comes with the package.

    sdr-jax renders19 runs/streets/* --out seg/models/renders19

It tells the engine's 19 classes apart: a head on lite0's frozen trunk, trained on datasets of
`sdr-jax render`. No photograph is seen, so the net can be scored on any. Of which streets renders19 has
seen one shot each, docs/models.md says.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.config import parsers
from experiments.config.parsers import STEPS
from scene.dataset.export import read_dataset
from scene.dataset.read import DESCRIPTION
from seg.model import Model, classes_of
from seg.recipes import RECIPES
from seg.train import CHUNK, TrainingError, train
from shell.command import exit_code
from shell.errors import UserError
from shell.files import file_digest, read_json
from shell.progress import Progress
from shell.target_file import shipped

RECIPE = replace(RECIPES["lite0-frozen"], steps=STEPS, batch=8, head_width=128)
"""Ten times as many images as the nets of a run train on: ten times the steps, and a head twice as wide."""


def make(datasets: Sequence[Path], steps: int = RECIPE.steps, seed: int = 0) -> Model:
    """Train on datasets of renders; prints how far it is.

    Args:
        datasets: folders of exports with images of one size.
        steps: of training.
        seed: of the net.

    Raises:
        UserError: no dataset, a damaged one, sizes that differ, or settings that no net can be trained with.
        TrainingError: the loss is not finite.
    """
    try:
        renders = [read_dataset(path) for path in datasets]
        about = [read_json(path / DESCRIPTION) for path in datasets]
        sizes = [own.labels.shape[1:] for own in renders]
        for path, own in zip(datasets, sizes, strict=True):
            if own != sizes[0]:
                raise UserError(
                    f"{path}: {own[1]}x{own[0]} pixels where {datasets[0]} has "
                    f"{sizes[0][1]}x{sizes[0][0]}; one size is right"
                )
        progress = Progress(steps)

        def told(done: int, loss: float) -> None:
            progress.advance(min(CHUNK, steps))
            progress.update(f"step {done} of {steps}, loss {loss:.3f}")

        settings, classes = replace(RECIPE, steps=steps), classes_of(shipped("cityscapes"))
        images, labels = (np.concatenate(column) for column in zip(*renders, strict=True))
        variables = train(seed, images, labels, settings, len(classes), progress=told)
        progress.close()
    except ValueError as error:
        raise UserError(str(error)) from None
    notes = {
        "trained_on": f"{len(images)} renders of engine {about[0]['engine']}, no photograph",
        "datasets": [file_digest(path / DESCRIPTION) for path in datasets],
        "seed": seed,
    }
    return Model(settings, variables, sizes[0], classes, notes=notes)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    options = parsers.renders19().parse_args(arguments)
    os.environ["NPROC"] = "1"  # of XLA's threads: sums are the same on machines with more cores

    def work() -> None:
        make(options.datasets, options.steps, options.seed).save(options.out)
        print(options.out)

    return exit_code(work, also=(TrainingError,), debug=options.debug, goes_on=False)


if __name__ == "__main__":
    sys.exit(main())
