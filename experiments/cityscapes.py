"""Learn to simulate for Cityscapes, or without data for the embedded twin.

    sdr-jax cityscapes                       # the twin: a stand-in, not real data
    sdr-jax cityscapes --data DIR            # real Cityscapes
    sdr-jax cityscapes --preset smoke        # a minute or two

The same command continues a killed run.
"""

from __future__ import annotations

import sys

if __name__ == "__main__":
    # Imported here, since worker processes load this file, too, without the command line.
    from experiments.config.cli import command

    sys.exit(command("cityscapes"))
