"""Optimise a simulator that is a program of its own; the same command resumes a stopped run.

    sdr-jax tune space.toml -- ./my_simulator {attributes.json}
    sdr-jax tune space.toml --workers 4 -- python lamp.py {attributes.json}

{attributes.json} is replaced by the path of a file, which the simulator reads. It prints its score as the
last line: a number, or a JSON object with "score". Higher is better, unless the TOML says minimize = true.
examples/tune is a worked example, and explains space.toml.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn, get_args

from common.command import Parser, docstring, exit_code
from sdr_jax.names import MethodName


def parser() -> Parser:
    """The command line of `sdr-jax tune`, up to the simulator's own."""
    options = Parser("tune", docstring("sdr_jax.tune"))
    options.usage = "%(prog)s SPACE [options] -- simulator ... {attributes.json} ..."
    options.argument_default = argparse.SUPPRESS
    add = options.add_argument
    add("space", type=Path, metavar="SPACE", help="TOML file: attributes, method, sizes")
    add("--out", type=Path, metavar="DIR", help="run folder; default: runs/ and the name of SPACE")
    add("--evaluations", type=int, metavar="N", help="total number of data sets to evaluate")
    add("--workers", type=int, metavar="N", help="simulators to run at once")
    add(
        "--timeout",
        type=float,
        dest="timeout_seconds",
        metavar="SECONDS",
        help="time limit of one run",
    )
    add("--retries", type=int, metavar="N", help="further attempts at a failed run")
    add(
        "--retry-failed",
        action="store_true",
        help="after an outage: repeat the evaluations since the last series of failures began",
    )
    add("--seed", type=int, metavar="N", help="seed of the search")
    add("--method", metavar="NAME", help=f"one of {', '.join(get_args(MethodName))}")
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse the arguments, run, turn errors into one line, and return the exit code."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    # If there is a GPU, the simulators need its memory more than the search.
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    split = arguments.index("--") if "--" in arguments else len(arguments)
    command = arguments[split + 1 :]
    flags = vars(parser().parse_args(arguments[:split]))
    debug, path = flags.pop("debug"), flags.pop("space")
    out = flags.pop("out", Path("runs") / path.stem)
    retry_failed = flags.pop("retry_failed", False)
    from sdr_jax.tune.search import tune  # the help needs no method
    from sdr_jax.tune.settings import read

    def work() -> None:
        answer = tune(read(path, flags), command, out, retry_failed=retry_failed)
        print(table(answer))
        print(
            f"{answer['evaluations']} evaluations by {answer['method']}, {answer['failed']} failed; "
            f"best score {answer['best']['score']:.4g}, mean {answer['mean_score']:.4g}; "
            f"details in {out / 'answer.json'}",
            flush=True,
        )

    return exit_code(work, debug=debug)


def table(answer: Mapping[str, Any]) -> str:
    """Format the answer, one line per attribute.

    A line has the name, the centre and ends of the solution's interval, and the ends of the spread's; for
    values without an order, those of the solution and those of the spread.
    """
    rows = [("attribute", "value", "from", "to", "spread from", "spread to")]
    for name, solution in answer["solution"].items():
        spread = answer["spread"][name]
        if "values" in solution:
            rows.append(
                (name, "|".join(solution["values"]), "", "", "|".join(spread["values"]), "")
            )
            continue
        ends = (
            *(solution[key] for key in ("centre", "low", "high")),
            spread["low"],
            spread["high"],
        )
        rows.append((name, *(f"{number:.4g}" for number in ends)))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if column else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    )


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


if __name__ == "__main__":
    # The signal with which a queue ends a job must not leave simulators running either.
    signal.signal(signal.SIGTERM, _interrupt)
    sys.exit(main())
