"""How long commands and libraries take to start, beside a Python that does nothing.

    python -m benchmarks.startup --json startup.json
    python -m benchmarks.startup --only seg table --repeats 9

Each row is a program in a process of its own: the import of a library, the import of a command's module, or
the help of a command. ``seconds`` is the median over several processes after one that does not count,
and ``ratio`` compares it with ``python -c pass``. The programs take turns, so that other work on the machine
meets all of them.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from benchmarks.report import Row, count, parser, report, timed
from experiments.__main__ import COMMANDS

ROOT = Path(__file__).resolve().parents[1]
LIBRARIES = ("seg", "scene", "sdr_jax")
NOTHING = "python -c pass"
IMPORT = "import runpy; runpy.run_module('{}', run_name='imported')"
"""This imports the module that ``python -m`` would run, be it a file or a folder."""


def programs(names: Sequence[str]) -> dict[str, list[str]]:
    """The arguments of Python for the programs of some libraries and commands; the first does nothing."""
    found = {NOTHING: ["-c", "pass"]}
    for name in names:
        if name in LIBRARIES:
            found[f"import {name}"] = ["-c", f"import {name}"]
        else:
            module = COMMANDS[name]
            found[f"import {module}"] = ["-c", IMPORT.format(module)]
            found[f"sdr-jax {name} --help"] = ["-m", "experiments", name, "--help"]
    return found


def measured(wanted: Mapping[str, Sequence[str]], repeats: int) -> list[Row]:
    """One row for each program.

    Raises:
        CalledProcessError: a program ended with an error.
    """
    rounds = [
        {name: timed(partial(_run, given))[0] for name, given in wanted.items()}
        for _ in range(repeats + 1)
    ]
    medians = {name: statistics.median(one[name] for one in rounds[1:]) for name in wanted}
    return [
        {"program": name, "seconds": seconds, "ratio": seconds / medians[NOTHING]}
        for name, seconds in medians.items()
    ]


def _run(arguments: Sequence[str]) -> None:
    command = [sys.executable, *arguments]
    subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    command = parser(__doc__)
    known = (*LIBRARIES, *COMMANDS)
    command.add_argument(
        "--only", choices=known, nargs="+", default=known, metavar="NAME",
        help="these libraries and commands; by default all of them",
    )  # fmt: skip
    command.add_argument("--repeats", type=partial(count, 1), default=5, help="processes of each")
    options = command.parse_args(arguments)
    try:
        rows = measured(programs(options.only), options.repeats)
    except subprocess.CalledProcessError as error:
        last = (error.stderr.strip().splitlines() or ["no message"])[-1]
        command.error(f"{' '.join(error.cmd)} ended with code {error.returncode}: {last}")
    report(rows, options.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
