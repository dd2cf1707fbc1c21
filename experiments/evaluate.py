"""Test a model on labelled images: mIoU, classes, groups, boundaries, the worst images.

    sdr-jax evaluate runs/fit/model DIR --json scores.json
    sdr-jax evaluate runs/fit/model DIR --target camvid --split train val --json scores.json

DATA is a folder with a `target.yaml`; otherwise pass --target. The model has the classes of the data, in any
order, or the engine's 19 classes of Cityscapes, which are then mapped to those of the data. Classes without a
counterpart in the data are not predicted, and a class of the data without a counterpart scores 0. Scores are
percent, at each image's own size. Boundary IoU (Cheng et al., 2021) counts only pixels near outlines, within
2 % of the diagonal.
"""

from __future__ import annotations

import sys

from common.command import Arguments


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    from experiments.app.evaluate import (
        main as work,  # help and worker processes load this file without it
    )

    return work(arguments)


if __name__ == "__main__":
    sys.exit(main())
