"""Check the installation and a folder of labelled images.

    sdr-jax doctor                              # versions, GPU, renderers, extras
    sdr-jax doctor DATA                         # and the folder: a page in runs/doctor
    sdr-jax doctor DATA --write target.yaml     # writes the proposed target.yaml
    sdr-jax doctor DATA --target camvid         # reads the folder by an existing target

The folder is read by its own target.yaml or by that of a known data set with the same layout and label
values. Otherwise doctor proposes a target.yaml, in which you fill in what it cannot know, such as the names
of classes.
"""

from __future__ import annotations

import sys

from common.command import Arguments


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    from experiments.app.doctor.command import (
        main as work,  # help and worker processes load this file without it
    )

    return work(arguments)


if __name__ == "__main__":
    sys.exit(main())
