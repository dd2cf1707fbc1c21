"""Make Ctrl-C print one line, also while a command loads its libraries or has ended.

During imports, KeyboardInterrupt ends in the traceback of a library, or in an error that a library turns it
into. There is nothing to clean up yet, so the program just ends. Each package sets this before it imports
anything large; `common.command.exit_code` restores the usual handling while it runs a job.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

PROGRAM = "sdr-jax"
"""The first word of all commands."""
INTERRUPTED = 130
"""Exit code after Ctrl-C."""


def while_loading(package: str) -> None:
    """Let Ctrl-C end the program if it is ``sdr-jax``, or ``python -m PACKAGE...`` of this package.

    Programs that import the package, and worker processes, keep their own handling.
    """
    words = sys.orig_argv[1:]
    module = words[words.index("-m") + 1 :][:1] if "-m" in words else []
    installed = bool(words) and os.path.basename(words[0]) == PROGRAM
    is_program = installed or (bool(module) and module[0].split(".")[0] == package)
    if is_program and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        _set(_end)


@contextmanager
def while_working() -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt in the block, so that unfinished work is cleaned up."""
    is_set = signal.getsignal(signal.SIGINT) is _end
    if is_set:
        _set(signal.default_int_handler)
    try:
        yield
    finally:
        if is_set:
            _set(_end)


def _set(handler: object) -> None:
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, handler)  # type: ignore[arg-type]


def _end(number: int, frame: FrameType | None) -> None:
    os.write(sys.stderr.fileno(), b"\nstopped\n")
    os._exit(INTERRUPTED)
