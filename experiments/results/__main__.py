"""Makes every recorded result from one commit, and the page that tells them: `make results`.

    sdr-jax results --data CAMVID                    # all; hours on two cores
    sdr-jax results --data CAMVID --only labels-0006R0 --docs docs
    sdr-jax results --data CAMVID --preset smoke     # all of it, tiny: worth nothing

Each part is a command of its own in a folder of its own, in the order of the page; all share a store, so
nothing is scored twice. Kill it at any moment; the same command goes on where it was. A folder that was
begun at another commit is refused.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from experiments.results.parts import NAMES, parts
from shell.command import Parser, docstring, exit_code
from shell.errors import UserError, refuse_repeats
from shell.flags import add_flag, filled, flags_of


@dataclass(frozen=True, kw_only=True)
class ResultsConfig:
    """What is made, and where."""

    data: Path | None = None
    """CamVid in the SegNet distribution."""
    out: Path = Path("runs/results")
    """Folder of all runs."""
    store: Path | None = None
    """File of evaluations that runs share, in place of OUT/store.jsonl: what it knows is not scored again."""
    docs: Path | None = None
    """Also write results.md, with pictures and reports in results/, into this folder."""
    only: tuple[str, ...] = NAMES
    """The parts."""
    preset: Literal["smoke", "quick"] = "quick"
    """How much is spent."""
    weights: Path | None = None
    """VGG16's, from `sdr-jax weights convert`: FCN8s and DeepLabv2 join the table, two hours more."""
    searches: int = 5
    """Searches of each method, and twins."""


def parser() -> Parser:
    """The command line of `sdr-jax results`."""
    options = Parser("results", docstring("experiments.results"))
    for field in flags_of(ResultsConfig()):
        add_flag(options.add_argument, field)
    return options


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    default, options = ResultsConfig(), parser()
    given = vars(options.parse_args(arguments))
    if "data" not in given:
        options.error("--data needs the folder of CamVid")
    from experiments.results.making import make  # the help needs no job

    def work() -> None:
        config = filled(default, given)
        refuse_repeats("--only", config.only)
        for name in config.only:
            if name not in NAMES:
                raise UserError(f"--only {name} is none of the parts: {', '.join(NAMES)}")
        if config.searches < 1:
            raise UserError(f"--searches must be 1 or more, not {config.searches}")
        assert config.data is not None
        wanted = parts(config.data, config.out, config.preset, config.searches, config.weights)
        make(
            [part for part in wanted if part.name in config.only],
            config.out,
            config.docs,
            config.store,
        )

    return exit_code(work, debug=given["debug"])


if __name__ == "__main__":
    sys.exit(main())
