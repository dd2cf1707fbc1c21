"""Reports of runs: one page that needs no network, also of several runs side by side.

    python -m experiments.report runs/a                          # writes runs/a/report.html anew
    python -m experiments.report runs/a runs/b --out both.html   # side by side
    python -m experiments.report runs/a --tensorboard events     # and the same figures for TensorBoard

A run is the folder (--out) of experiments.camvid, experiments.cityscapes or experiments.labelmefacade at its
end. Studies have reports in a form of their own, which --rederive writes anew.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from experiments.report import events, page, several
from experiments.report.kept import read
from shell.command import Parser, exit_code
from shell.errors import UserError
from shell.files import write

NAME = "report.html"


def make(paths: Sequence[Path], out: Path | None, tensorboard: Path | None) -> list[Path]:
    """Write the page of runs, and their events if asked for; returns what was written.

    Args:
        paths: run folders.
        out: the page; by default in the folder of a single run, else in this one.
        tensorboard: folder of events, one folder for each run in it.

    Raises:
        UserError: a folder that is no finished run, or a place where nothing can be written.
    """
    names = [path.resolve() for path in paths]
    if len(set(names)) < len(names):
        raise UserError(f"{' '.join(map(str, paths))} names one run twice")
    out = out or (paths[0] / NAME if len(paths) == 1 else Path(NAME))
    if out.is_dir():
        raise UserError(f"--out {out} is a folder; name a file, such as {out / NAME}")
    runs = [read(path) for path in paths]
    write_events = None if tensorboard is None else events.writer(runs, tensorboard)
    write(out, page.html(runs[0].summary, paths[0]) if len(runs) == 1 else several.html(runs))
    return [out, *(write_events() if write_events else [])]


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = Parser("experiments.report", __doc__)
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN", help="run folders")
    parser.add_argument(
        "--out", type=Path, help="the page; by default RUN/report.html, of several report.html"
    )
    parser.add_argument(
        "--tensorboard", type=Path, metavar="DIR", help="write TensorBoard events there, too"
    )
    options = parser.parse_args(arguments)

    def work() -> None:
        for path in make(options.runs, options.out, options.tensorboard):
            print(path)

    return exit_code(work)


if __name__ == "__main__":
    sys.exit(main())
