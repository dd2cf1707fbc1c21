"""Time the start of commands and libraries against a Python that does nothing.

    python -m benchmarks.startup --json startup.json
    python -m benchmarks.startup --only seg table --repeats 9
    python -m benchmarks.startup --texts                        # help texts only

Each row is a program in its own process: the import of a library, the import of a command's module, or the
help of a command. ``cpu`` and ``seconds`` are medians over several processes after one that does not count:
core seconds, which other work on the machine hardly changes, and wall seconds. ``ratio`` compares ``cpu``
with ``python -c pass``. The programs take turns.
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from benchmarks.report import Row, count, parser, report, timed
from common.command import path_of
from experiments.__main__ import COMMANDS, STUDIES, STUDY

ROOT = Path(__file__).resolve().parents[1]
LIBRARIES = ("seg", "scene", "sdr_jax")
NOTHING = "python -c pass"
ALL = "sdr-jax"
"""The help that lists all commands."""


def programs(names: Sequence[str]) -> dict[str, list[str]]:
    """Make the arguments of Python for some libraries and commands; the first does nothing."""
    arguments = {NOTHING: ["-c", "pass"]}
    for name in names:
        if name in LIBRARIES:
            arguments[f"import {name}"] = ["-c", f"import {name}"]
        elif name == ALL:
            arguments[f"{ALL} --help"] = ["-m", "experiments", "--help"]
        else:
            module, words = COMMANDS[name], [*([STUDY] if name in STUDIES else []), name, "--help"]
            # The file that `python -m` would run, also for a folder.
            program = f"{module}.__main__" if path_of(module).stem == "__main__" else module
            arguments[f"import {module}"] = ["-c", f"import {program}"]
            arguments[" ".join((ALL, *words))] = ["-m", "experiments", *words]
    return arguments


def measured(commands: Mapping[str, Sequence[str]], repeats: int) -> list[Row]:
    """Measure a row per program.

    Raises:
        CalledProcessError: a program ended with an error.
    """
    rounds = [
        {name: timed(partial(_run, arguments)) for name, arguments in commands.items()}
        for _ in range(repeats + 1)
    ]
    seconds, cpu = (
        {name: statistics.median(times[name][k] for times in rounds[1:]) for name in commands}
        for k in (0, 1)
    )
    return [
        {
            "program": name,
            "cpu": cpu[name],
            "seconds": seconds[name],
            "ratio": cpu[name] / cpu[NOTHING],
        }
        for name in commands
    ]


def _run(arguments: Sequence[str]) -> float:
    """Run Python; returns its core seconds."""
    before, command = _core_seconds(), [sys.executable, *arguments]
    subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return _core_seconds() - before


def _core_seconds() -> float:
    """The core seconds of all programs so far."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    command = parser(__doc__)
    choices = (*LIBRARIES, ALL, *COMMANDS)
    command.add_argument(
        "--only", choices=choices, nargs="+", default=choices, metavar="NAME",
        help="these libraries and commands; by default all of them",
    )  # fmt: skip
    command.add_argument("--texts", action="store_true", help="only help texts, no imports")
    command.add_argument("--repeats", type=partial(count, 1), default=5, help="processes of each")
    options = command.parse_args(arguments)
    commands = programs(options.only)
    if options.texts:
        commands = {k: v for k, v in commands.items() if k == NOTHING or k.endswith("--help")}
    try:
        rows = measured(commands, options.repeats)
    except subprocess.CalledProcessError as error:
        last = (error.stderr.strip().splitlines() or ["no message"])[-1]
        command.error(f"{' '.join(error.cmd)} ended with code {error.returncode}: {last}")
    report(rows, options.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
