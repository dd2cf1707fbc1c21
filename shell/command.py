"""What command lines share: errors in one line, and how a program ends."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
import traceback
from collections.abc import Callable
from typing import NoReturn

from shell.errors import UserError
from shell.interrupt import INTERRUPTED, while_working

USAGE, MISTAKE, UNREAD = 2, 70, 141
"""Exit codes: something the user can put right; a mistake of ours; nobody reads the output (``| head``)."""
DEBUG = "--debug"
"""Flag of every command: show where an error comes from."""


_SHORT: dict[str, str] = {}  # modules, to the names that they were called by


def call(module: str, name: str) -> None:
    """Let help and errors of a module's command name it as it was called."""
    _SHORT[module] = name


def called(module: str) -> str:
    """A module's command as one would type it: ``sdr-jax camvid`` if so called, else ``python -m ...``."""
    return _SHORT.get(module, f"python -m {module}")


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, with exit code 2; ``--help`` says the rest.

    Args:
        module: the command is ``python -m module``, see ``called``.
        description: the help's first part, kept as it is laid out.
    """

    def __init__(self, module: str, description: str | None) -> None:
        super().__init__(
            prog=called(module),
            description=description,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        self.add_argument(DEBUG, action="store_true", help="show where an error comes from")

    def error(self, message: str) -> NoReturn:
        """Print one line and end with exit code 2."""
        self.exit(USAGE, f"{self.prog}: error: {' '.join(message.split())}\n")


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


def exit_code(
    work: Callable[[], int | None],
    also: tuple[type[Exception], ...] = (),
    *,
    users: tuple[type[Exception], ...] = (UserError,),
    debug: bool = False,
    goes_on: bool = True,
) -> int:
    """Work, and turn what went wrong into one line on standard error and an exit code.

    Args:
        work: the job; may return an exit code of its own.
        also: errors that end with code 1: nobody's fault, such as workers that died.
        users: errors that end with code 2: what the user can put right.
        debug: print where the error comes from before the line.
        goes_on: whether the same command continues what was stopped.
    """
    cure = "once that is put right, the same command goes on"
    try:
        with while_working():
            code = work()
            sys.stdout.flush()  # not at exit, where an error has another code
            return code or 0
    except users as error:
        return _fail(error, str(error), USAGE, debug)
    except BrokenPipeError:  # as of ``| head``; nor can what is still unwritten be written at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREAD
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _fail(error, f"{where}{error.strerror or error}; {cure}", USAGE, debug)
    except also as error:
        return _fail(error, str(error), 1, debug)
    except MemoryError as error:
        said = str(error) or "too little is free"
        return _fail(error, f"out of memory: {said}; smaller sizes need less", USAGE, debug)
    except KeyboardInterrupt:
        on = "; the same command goes on where it was" if goes_on else ""
        print(f"\nstopped{on}", file=sys.stderr, flush=True)
        return INTERRUPTED
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{os.path.basename(last.filename)}, line {last.lineno}"
        said = f"a mistake of this program: {type(error).__name__}: {error} ({where})"
        return _fail(error, f"{said}; {DEBUG} shows all of it", MISTAKE, debug)


def _fail(error: Exception, message: str, code: int, debug: bool) -> int:
    if debug:
        traceback.print_exception(error)
    print(f"error: {' '.join(message.split())}", file=sys.stderr, flush=True)
    return code
