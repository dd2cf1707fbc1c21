"""What the processes of a pool have done of their present tasks, in shared memory.

It lets a job show progress while its tasks take minutes. Units are the caller's, such as seconds of cost.
"""

from __future__ import annotations

from collections.abc import Iterator, MutableSequence
from contextlib import contextmanager

_shared: MutableSequence[float] | None = None
"""One number for each process of the pool, if this process is one of them."""
_process = 0


def connect(shared: MutableSequence[float], process: int) -> None:
    """Let `report` write to the number of this process."""
    global _shared, _process
    _shared, _process = shared, process % len(shared)


def report(units: float) -> None:
    """Say how much of the present task is done; 0 once it ends. In other processes it does nothing."""
    if _shared is not None:
        _shared[_process] = units


@contextmanager
def ending_report() -> Iterator[None]:
    """Report 0 at the end of a task, also of one that fails."""
    try:
        yield
    finally:
        report(0.0)
