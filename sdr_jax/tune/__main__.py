"""Optimises a simulator that is a program of its own; the same command continues a run that was stopped.

python -m sdr_jax.tune space.toml -- ./my_simulator {attributes.json}
python -m sdr_jax.tune space.toml --out runs/lamp --workers 4 -- python lamp.py {attributes.json}

The simulator reads the file whose path stands in place of {attributes.json}, and prints its score as the
last line: a number, or a JSON object with "score". Higher is better, unless the TOML says minimize = true.
examples/tune is a worked example, and says what space.toml may hold.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import NoReturn

from sdr_jax.tune.errors import TuneError
from sdr_jax.tune.methods import METHODS
from sdr_jax.tune.progress import table
from sdr_jax.tune.search import tune
from sdr_jax.tune.settings import read

INTERRUPTED = 130


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise TuneError(message)


def _parser() -> _Parser:
    parser = _Parser(
        prog="python -m sdr_jax.tune",
        usage="%(prog)s space.toml [options] -- simulator ... {attributes.json} ...",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
        argument_default=argparse.SUPPRESS,
    )
    add = parser.add_argument
    add("space", type=Path, help="TOML file: attributes, method, sizes")
    add("--out", type=Path, help="run folder; by default runs/ and the TOML file's name")
    add("--evaluations", type=int, help="data sets to score in all")
    add("--workers", type=int, help="simulators at once; the answer does not depend on it")
    add("--timeout", type=float, dest="timeout_seconds", help="seconds that one run may take")
    add("--retries", type=int, help="how often a failed run is tried again")
    add("--seed", type=int)
    add("--method", help=", ".join(METHODS))
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Parses, runs, and turns what went wrong into one line. Returns the exit code."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    # Should there be a GPU, the simulators need it more than the search.
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    split = arguments.index("--") if "--" in arguments else len(arguments)
    command = arguments[split + 1 :]
    try:
        flags = vars(_parser().parse_args(arguments[:split]))
        path = flags.pop("space")
        out = flags.pop("out", Path("runs") / path.stem)
        answer = tune(read(path, flags), command, out)
    except (TuneError, OSError) as error:
        return _fail(_text(error), 2)
    except KeyboardInterrupt:
        return _fail("stopped; the same command goes on where it was", INTERRUPTED)
    print(table(answer))
    print(
        f"{answer['evaluations']} evaluations by {answer['method']}, {answer['failed']} failed; "
        f"best score {answer['best']['score']:.4g}, mean {answer['mean_score']:.4g}; "
        f"all of it in {out / 'answer.json'}",
        flush=True,
    )
    return 0


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def _text(error: Exception) -> str:
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror or error}; once that is put right, the same command goes on"
    return str(error)


def _fail(message: str, code: int) -> int:
    line = " ".join(message.split())
    print(f"error: {line}" if code != INTERRUPTED else f"\n{line}", file=sys.stderr, flush=True)
    return code


if __name__ == "__main__":
    # What a queue sends at the end of a job leaves no simulator behind either.
    signal.signal(signal.SIGTERM, _interrupt)
    sys.exit(main())
