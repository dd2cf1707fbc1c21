"""Learn to simulate for CamVid.

    sdr-jax camvid --data DIR                     # reward: train, reported: test
    sdr-jax camvid --data DIR --holdout 0006R0    # reported on a sequence left out
    sdr-jax camvid --data DIR --preset smoke      # a minute or two

The same command continues a killed run.
"""

from __future__ import annotations

import sys

if __name__ == "__main__":
    # Imported here, since worker processes load this file, too, without the command line.
    from experiments.config.cli import command

    sys.exit(command("camvid"))
