"""Makes Ctrl-C print one line, also while a command loads its libraries or has ended.

During imports a KeyboardInterrupt gives a traceback of a library, or an error that a library makes from it.
There is nothing to clean up yet, so the program just ends. Each package sets this before it imports anything
large; `common.command.exit_code` restores the usual handling while it works.
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
    ours = installed or (bool(module) and module[0].split(".")[0] == package)
    if ours and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        _set(_end)


@contextmanager
def while_working() -> Iterator[None]:
    """Inside, Ctrl-C raises KeyboardInterrupt, so that unfinished work is cleaned up."""
    ours = signal.getsignal(signal.SIGINT) is _end
    if ours:
        _set(signal.default_int_handler)
    try:
        yield
    finally:
        if ours:
            _set(_end)


def _set(handler: object) -> None:
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, handler)  # type: ignore[arg-type]


def _end(number: int, frame: FrameType | None) -> None:
    os.write(sys.stderr.fileno(), b"\nstopped\n")
    os._exit(INTERRUPTED)
