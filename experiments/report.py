"""Writes or serves the report of a run, a page that needs no network.

    sdr-jax report runs/a             # writes runs/a/report.html anew
    sdr-jax report runs/a --serve     # shows it, also while the run goes on

A run is the folder (--out) of `sdr-jax fit`, `camvid`, `cityscapes` or `labelmefacade`. While it goes on, it
writes the page every 15 seconds; this command writes the page of a finished run. Studies have reports in a
form of their own, which --rederive writes anew.
"""

from __future__ import annotations

import sys

from common.command import Arguments


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    from experiments.app.report.command import (
        main as work,  # help and worker processes load this file without it
    )

    return work(arguments)


if __name__ == "__main__":
    sys.exit(main())
