"""Label images and videos of any size with a trained model.

    sdr-jax predict renders19 photos --out labels --as overlay
    sdr-jax predict runs/fit/model video.mp4 --out frames
    sdr-jax predict runs/fit/model unlabelled --rank --out next

MODEL is a folder from `sdr-jax fit` or `Model.save`, or the name of a model in the package: `renders19` has
the 19 classes of Cityscapes and was trained on renders alone. IMAGES is an image, a video, or a folder of
both. Each image becomes a PNG of the same name and size in the folder --out; frames of a video become
NAME/000000.png and so on. The same command resumes a stopped run.
With --rank, ranking.csv lists the images in the order in which to label them, least certain first. cvat.zip
and label_studio.json have predicted labels of the first ones, to correct in these tools.
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
