"""Learn to simulate for LabelMeFacade.

    sdr-jax labelmefacade --data DIR                    # reward: train, reported: test
    sdr-jax labelmefacade --data DIR --holdout ALBUM    # reported on an album left out
    sdr-jax labelmefacade --data DIR --preset smoke     # under a minute

Kill it at any moment; the same command goes on where it was.
"""

from __future__ import annotations

import sys

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from experiments.config.cli import command

    sys.exit(command("labelmefacade"))
