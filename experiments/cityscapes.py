"""Learn to simulate for Cityscapes, or for the embedded twin where there is no data.

    sdr-jax cityscapes                       # the twin: a stand-in, not real data
    sdr-jax cityscapes --data DIR            # real Cityscapes
    sdr-jax cityscapes --preset smoke        # under a minute

Kill it at any moment; the same command goes on where it was.
"""

from __future__ import annotations

import sys

if __name__ == "__main__":
    # Not at the top: worker processes load this file, too, and need nothing of the command line.
    from experiments.config.cli import command

    sys.exit(command("cityscapes"))
