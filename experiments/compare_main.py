"""The command line of the comparison."""

from __future__ import annotations

from collections.abc import Sequence

from experiments import compare_job
from experiments.compare_config import compare_config
from experiments.main import main_on_target


def main(description: str, arguments: Sequence[str] | None = None) -> int:
    """Parse, run, and turn what went wrong into one line. Returns the exit code."""
    return main_on_target("compare", compare_config, compare_job.run, description, arguments)
