"""What the command lines of the engine share: errors in one line, and times in words."""

from __future__ import annotations

import argparse
import sys
from typing import NoReturn


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
        self.exit(2, f"{self.prog}: error: {' '.join(message.split())}\n")

    def fail(self, error: Exception) -> NoReturn:
        """Report ``error``; what the system says of a file begins with its name."""
        if isinstance(error, OSError) and error.filename and error.strerror:
            self.error(f"{error.filename}: {error.strerror}")
        self.error(str(error))


def size(text: str) -> tuple[int, int]:
    """Width and height in pixels from ``640x320``, for ``argparse``."""
    width, cross, height = text.partition("x")
    try:
        if not cross:
            raise ValueError
        return int(width), int(height)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must look like 640x320, not {text!r}") from None


def duration(seconds: float) -> str:
    """``75 s``, ``12 min`` or ``3.4 h``."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    if seconds < 100 * 60:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


def show(line: str) -> None:
    """Write where the work is; on a terminal each line replaces the one before."""
    sys.stdout.write(f"\r\x1b[2K{line}" if sys.stdout.isatty() else f"{line}\n")
    sys.stdout.flush()


def end_line() -> None:
    """What is written next begins on a line of its own."""
    if sys.stdout.isatty():
        sys.stdout.write("\n")
