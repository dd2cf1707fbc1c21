"""Optimise the streets for Cityscapes, or for the built-in twin.

    sdr-jax cityscapes                       # the twin, a stand-in for real data
    sdr-jax cityscapes --data DIR            # real Cityscapes
    sdr-jax cityscapes --preset smoke        # a minute or two, tests the set-up

It writes a report, the optimised attributes and a rendered dataset into --out. The same command resumes a
stopped run.
"""

from __future__ import annotations

import sys

if __name__ == "__main__":
    # Imported here, since worker processes load this file, too, without the command line.
    from experiments.config.cli import command

    sys.exit(command("cityscapes"))
