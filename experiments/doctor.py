"""Says what this machine has, and what a folder of labelled images holds.

    sdr-jax doctor                              # versions, GPU, renderers, extras
    sdr-jax doctor DATA                         # the folder, too: a page in runs/doctor
    sdr-jax doctor DATA --write target.yaml     # writes the file that it proposes
    sdr-jax doctor DATA --target camvid         # looks at the folder with a file that exists

A folder is described by its own target.yaml, by that of a known data set with its layout and values, or by a
proposed file, which says what it does not know, such as names of classes.
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
