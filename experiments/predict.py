"""Segments images and videos of any size with a trained net.

    sdr-jax predict runs/fit/model photographs --out labels
    sdr-jax predict renders19 drive.mp4 --out frames --as overlay
    sdr-jax predict runs/fit/model unlabelled --rank --out next

MODEL is a folder from `fit` or `Model.save`, or the name of a net that comes with the package: `renders19`
has the 19 classes of Cityscapes, and was trained on renders alone. IMAGES is an image, a video, or a folder
of both. Each image gives a PNG of its own size and name in the folder of --out, each frame of a video
NAME/000000.png and so on. The same command continues a stopped run, whose results are kept.
With --rank, ranking.csv begins with the images of which the net is least certain: label these next. cvat.zip
and label_studio.json hold their labels for correction.
"""

from __future__ import annotations

import sys

from common.command import Arguments


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    from experiments.app.predict import (
        main as work,  # help and worker processes load this file without it
    )

    return work(arguments)


if __name__ == "__main__":
    sys.exit(main())
