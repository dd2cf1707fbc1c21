"""Optimise the streets for CamVid.

    sdr-jax camvid --data DIR                     # rewards: train; tested on: test
    sdr-jax camvid --data DIR --holdout 0006R0    # tested on a sequence left out
    sdr-jax camvid --data DIR --preset smoke      # a minute or two, tests the set-up

It writes a report, the optimised attributes and a rendered dataset into --out. The same command resumes a
stopped run.
"""

from __future__ import annotations

import sys

if __name__ == "__main__":
    # Imported here, since worker processes load this file, too, without the command line.
    from experiments.config.cli import command

    sys.exit(command("camvid"))
