"""Learn to simulate for CamVid.

    sdr-jax camvid --data DIR                     # reward: train, reported: test
    sdr-jax camvid --data DIR --holdout 0006R0    # reported on a sequence left out
    sdr-jax camvid --data DIR --preset smoke      # under a minute

Kill it at any moment; the same command goes on where it was.
"""

from __future__ import annotations

import sys

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from experiments.config.cli import command

    sys.exit(command("camvid"))
