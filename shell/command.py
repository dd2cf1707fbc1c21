"""What command lines share: errors in one line, and how a program ends."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Callable
from typing import NoReturn

from shell.errors import UserError

USAGE, INTERRUPTED, UNREAD = 2, 130, 141
"""Exit codes: something the user can put right; Ctrl-C; nobody reads the output any more (``| head``)."""


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, with exit code 2; ``--help`` says the rest.

    Args:
        module: the command is ``python -m module``.
        description: the help's first part, kept as it is laid out.
    """

    def __init__(self, module: str, description: str | None) -> None:
        super().__init__(
            prog=f"python -m {module}",
            description=description,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )

    def error(self, message: str) -> NoReturn:
        """Print one line and end with exit code 2."""
        self.exit(USAGE, f"{self.prog}: error: {' '.join(message.split())}\n")

    def fail(self, error: Exception) -> NoReturn:
        """Report ``error``; what the system says of a file begins with its name."""
        if isinstance(error, OSError) and error.filename and error.strerror:
            self.error(f"{error.filename}: {error.strerror}")
        self.error(str(error))


def given() -> str:
    """The command that this process was started with, as one would type it."""
    return shlex.join(["python", *sys.orig_argv[1:]])


def size(text: str) -> tuple[int, int]:
    """Width and height in pixels from ``640x320``, for ``argparse``."""
    width, cross, height = text.partition("x")
    try:
        if not cross:
            raise ValueError
        return int(width), int(height)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must look like 640x320, not {text!r}") from None


def exit_code(work: Callable[[], None], also: tuple[type[Exception], ...] = ()) -> int:
    """Work, and turn what went wrong into one line on standard error and an exit code.

    Args:
        work: the job.
        also: errors that end with code 1: nobody's fault, such as workers that died.
    """
    try:
        work()
        sys.stdout.flush()  # not at exit, where an error has another code
    except UserError as error:
        return _fail(str(error), USAGE)
    except BrokenPipeError:  # as of ``| head``; nor can what is still unwritten be written at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREAD
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        cure = "once that is put right, the same command goes on"
        return _fail(f"{where}{error.strerror or error}; {cure}", USAGE)
    except also as error:
        return _fail(str(error), 1)
    except KeyboardInterrupt:
        print("\nstopped; the same command goes on where it was", file=sys.stderr, flush=True)
        return INTERRUPTED
    return 0


def _fail(message: str, code: int) -> int:
    print(f"error: {' '.join(message.split())}", file=sys.stderr, flush=True)
    return code
