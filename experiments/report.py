"""Write or serve the report of a run, a page that works offline.

    sdr-jax report runs/a             # rewrites runs/a/report.html
    sdr-jax report runs/a --serve     # shows it in a browser, also during the run

RUN is the folder (--out) of `sdr-jax fit`, `camvid`, `cityscapes` or `labelmefacade`. During a run, the run
itself updates the page every 15 seconds; this command rewrites the page of a finished run. Studies write
other reports; their flag --rederive rewrites them.
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
