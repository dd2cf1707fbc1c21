"""Train a network on rendered streets only, such as `renders19`, which comes with the package.

    python -m scripts.renders19 runs/streets/* --out seg/models/renders19

The network has Cityscapes' 19 classes: three heads on lite0's frozen backbone, trained on datasets of
`sdr-jax render`, whose labels are drawn as annotators of Cityscapes draw them. It is trained on no photograph
and can be tested on any. docs/models.md describes the streets of renders19, one shot of each.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np

from common.command import Parser, docstring, exit_code
from common.errors import UserError
from common.files import file_digest, read_json
from common.labels.target_file import shipped
from common.progress import Progress
from scene.dataset.export import read_dataset
from scene.dataset.read import DESCRIPTION
from seg.model import Model, classes_of
from seg.recipes import RECIPES, with_steps
from seg.train import CHUNK, TrainingError, train

RECIPE = replace(RECIPES["lite0-heads"], steps=3000)
"""Three times the steps of a run's networks, for several times their images."""


def make(datasets: Sequence[Path], steps: int = RECIPE.steps, seed: int = 0) -> Model:
    """Train on datasets of renders, and print progress.

    Args:
        datasets: folders of exports with images of one size.
        steps: number of training steps.
        seed: seed of the network.

    Raises:
        UserError: there is no dataset, one is damaged, sizes differ, or settings do not allow training.
        TrainingError: the loss is not finite.
    """
    try:
        target = shipped("cityscapes")
        renders = [read_dataset(path, target.engine_outlines) for path in datasets]
        descriptions = [read_json(path / DESCRIPTION) for path in datasets]
        sizes = [dataset.labels.shape[1:] for dataset in renders]
        for path, size in zip(datasets, sizes, strict=True):
            if size != sizes[0]:
                raise UserError(
                    f"{path}: {size[1]}x{size[0]} pixels, but {datasets[0]} has "
                    f"{sizes[0][1]}x{sizes[0][0]}; all datasets must have one size"
                )
        settings, classes = with_steps(RECIPE, steps), classes_of(target)
        images, labels = (np.concatenate(column) for column in zip(*renders, strict=True))
        total = steps * settings.heads  # heads train one after the other
        with closing(Progress(total)) as progress:

            def report(done: int, loss: float) -> None:
                progress.advance(min(CHUNK, steps))
                progress.update(f"step {done} of {total}, loss {loss:.3f}")

            variables = train(seed, images, labels, settings, len(classes), progress=report)
    except ValueError as error:
        raise UserError(str(error)) from None
    notes = {
        "trained_on": f"{len(images)} renders of engine {descriptions[0]['engine']}, no photograph",
        "datasets": [file_digest(path / DESCRIPTION) for path in datasets],
        "seed": seed,
    }
    return Model(settings, variables, sizes[0], classes, notes=notes)


def parser() -> Parser:
    """Make the command line of `python -m scripts.renders19`."""
    options = Parser("renders19", docstring("scripts.renders19"))
    options.prog = "python -m scripts.renders19"
    add = options.add_argument
    add("datasets", type=Path, nargs="+", metavar="DATASET", help="folder of `sdr-jax render`")
    add("--out", type=Path, required=True, metavar="DIR", help="folder of the model")
    add("--steps", type=int, default=RECIPE.steps, metavar="N", help="training steps")
    add("--seed", type=int, default=0, metavar="N", help="seed of the network")
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    options = parser().parse_args(arguments)
    os.environ["NPROC"] = "1"  # XLA's threads, so that more cores give the same sums

    def work() -> None:
        make(options.datasets, options.steps, options.seed).save(options.out)
        print(options.out)

    return exit_code(work, also=(TrainingError,), debug=options.debug, resumes=False)


if __name__ == "__main__":
    sys.exit(main())
