"""The command line of the comparison."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import tyro

from experiments import compare_job
from experiments.compare_config import TARGETS, CompareConfig, compare_config
from experiments.main import choice_of, exit_code, preset_of


def main(description: str, arguments: Sequence[str] | None = None) -> int:
    """Parse, run, and turn what went wrong into one line. Returns the exit code."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)

    def work() -> None:
        preset = preset_of(arguments)
        target = choice_of(arguments, "--target", TARGETS, "twin")
        out = Path("runs") / f"compare-{target}-{preset}"
        default = replace(compare_config(target, preset), out=out)
        if target == "camvid" and os.environ.get("CAMVID_DIR"):
            default = replace(default, data=Path(os.environ["CAMVID_DIR"]))
        config = tyro.cli(
            CompareConfig,
            prog="python -m experiments.compare",
            description=description,
            default=default,
            args=arguments,
        )
        compare_job.run(config)

    return exit_code(work)
