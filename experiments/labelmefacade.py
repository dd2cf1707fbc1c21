"""Optimise the streets for LabelMeFacade.

    sdr-jax labelmefacade --data DIR                    # rewards: train; tested on: test
    sdr-jax labelmefacade --data DIR --holdout GROUP    # tested on a group left out
    sdr-jax labelmefacade --data DIR --preset smoke     # a minute or two, tests the set-up

It writes a report, the optimised attributes and a rendered dataset into --out. The same command resumes a
stopped run.
"""

from __future__ import annotations

import sys

if __name__ == "__main__":
    # Imported here, since worker processes load this file, too, without the command line.
    from experiments.config.cli import command

    sys.exit(command("labelmefacade"))
