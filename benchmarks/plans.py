"""How far is the planned time of a job from the time that it takes?

    python -m benchmarks.plans --data CAMVID --json plans.json
    python -m benchmarks.plans --data CAMVID --few 14 40 --workers 1

Each row is a `sdr-jax fit` into a new folder, from its plan to its report: planned seconds, measured seconds,
and their ratio, which should lie between 1 / 1.5 and 1.5. Other work on the machine slows the job, but does
not change the plan. The first run on a machine also measures its speed, which counts as part of the job.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from unittest import mock

from benchmarks.report import Row, count, parser, report
from common.command import exit_code
from common.labels.target_file import SHIPPED
from common.progress import Progress
from experiments.app.fit.config import config_of
from experiments.app.fit.job import fit


def measured(options: argparse.Namespace, few: int) -> Row:
    """Fit a network with so many labels, and compare the time with the plan."""
    planned: list[tuple[float, float]] = []  # expected seconds, and the time of the estimate
    expect = Progress.expect

    def record(progress: Progress, seconds: float, start: float) -> None:
        planned.append((seconds + start, time.perf_counter()))
        expect(progress, seconds, start)

    with tempfile.TemporaryDirectory() as folder, mock.patch.object(Progress, "expect", record):
        config = config_of(
            options.data, Path(folder) / "run", target=options.target, few=few,
            holdout=options.holdout, seeds=options.seeds, workers=options.workers,
        )  # fmt: skip
        fit(config)
        took = time.perf_counter() - planned[-1][1]
    seconds = planned[-1][0]
    return {
        "labels": few,
        "workers": config.workers,
        "planned": seconds,
        "took": took,
        "ratio": took / seconds,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    command = parser(__doc__)
    command.prog = "python -m benchmarks.plans"
    add = command.add_argument
    add("--data", required=True, type=Path, help="folder of labelled images")
    add("--target", default="camvid", help=f"{', '.join(SHIPPED)}, or a target's file (camvid)")
    add("--holdout", help="group to test on; by default that of fit")
    add("--few", nargs="+", type=partial(count, 1), default=[14], help="labels of each row (14)")
    add("--seeds", type=partial(count, 1), default=3, help="networks per row of fit (3)")
    add("--workers", type=partial(count, 1), help="processes; by default those of fit")
    options = command.parse_args(arguments)
    return exit_code(lambda: report([measured(options, few) for few in options.few], options.json))


if __name__ == "__main__":
    sys.exit(main())
