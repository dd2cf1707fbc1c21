"""Learn to simulate for LabelMeFacade.

    sdr-jax labelmefacade --data DIR                    # reward: train, reported: test
    sdr-jax labelmefacade --data DIR --holdout ALBUM    # reported on an album left out
    sdr-jax labelmefacade --data DIR --preset smoke     # a minute or two

The same command continues a killed run.
"""

from __future__ import annotations

import sys

if __name__ == "__main__":
    # Imported here, since worker processes load this file, too, without the command line.
    from experiments.config.cli import command

    sys.exit(command("labelmefacade"))
