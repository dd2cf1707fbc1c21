"""Make every recorded result and their page from one commit: `make results`.

    python -m scripts.results --data CAMVID --facades LABELMEFACADE --docs docs
    python -m scripts.results --data CAMVID --only fit-camvid-0006R0 --docs docs
    python -m scripts.results --data CAMVID --preset smoke      # tiny: a trial run

Each part is a command with its own folder; those on which most claims rest come first. All share a store, so
that nothing is evaluated twice. Parts without their data are left out. The core time that is planned comes
first. The same command resumes a killed run, and `--only` makes some parts now and others later. The store is
committed with the reports, so that any checkout makes the page from it, or resumes. A folder from another
commit is refused, unless only documentation has changed.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from common.bounds import check_bounds
from common.command import Parser, exit_code
from common.errors import UserError, refuse_repeats
from common.flags import command_line
from experiments.config.presets import data_of
from scripts.results.parts import Data, Size, parts


@dataclass(frozen=True, kw_only=True)
class ResultsConfig:
    """The parts to make, and their folders."""

    data: Path | None = None
    """CamVid in the SegNet distribution; by default the variable CAMVID_DIR."""
    facades: Path | None = None
    """LabelMeFacade; by default the variable LABELMEFACADE_DIR."""
    out: Path = Path("runs/results")
    """Folder of all runs."""
    store: Path | None = None
    """File of evaluations, none of which is repeated; by default DOCS/results/store.jsonl, or
    OUT/store.jsonl without --docs."""
    docs: Path | None = None
    """Folder of the pages: reports and plots go into results/, and results.md is written from them."""
    only: tuple[str, ...] = ()
    """The parts to make; by default all of them."""
    preset: Size = "quick"
    """Size of all runs."""


def parser() -> Parser:
    """Make the command line of `python -m scripts.results`."""
    options = command_line("results", ResultsConfig, "scripts.results")
    options.prog = "python -m scripts.results"
    return options


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    flags = vars(parser().parse_args(arguments))
    debug, config = flags.pop("debug"), ResultsConfig(**flags)
    from scripts.results.making import make  # the help needs no job

    def work() -> None:
        check_bounds(config, "--")
        refuse_repeats("--only", config.only)
        data = Data(config.data or data_of("camvid"), config.facades or data_of("labelmefacade"))
        every = parts(data, config.out, config.preset)
        names = [part.name for part in every]
        for name in config.only:
            if name not in names:
                raise UserError(
                    f"--only {name}: no such part with this data; choose from {', '.join(names)}"
                )
        make(every, config.out, config.docs, config.store, config.only)

    return exit_code(work, debug=debug)


if __name__ == "__main__":
    sys.exit(main())
