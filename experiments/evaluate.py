"""Tests a trained net on labelled images: mIoU, every class, every group, outlines, the worst images.

    sdr-jax evaluate runs/fit/model DIR --json scores.json
    sdr-jax evaluate runs/fit/model DIR --target camvid --split train val --json scores.json

DATA is a folder with a `target.yaml`, or --target names its file.
The model may have the classes of the data, in any order, or the engine's, which are then mapped to those of
the data: only classes with a counterpart there are predicted, and a class of the data without one counts as
0. Figures are percent, at each image's own size; boundary IoU (Cheng et al., 2021) is that of strips along
outlines, 2 % of the diagonal wide.
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
