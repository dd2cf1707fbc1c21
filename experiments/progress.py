"""How far the job is, and how long it will take, in one line at a time."""

from __future__ import annotations

import sys
import time
from typing import TextIO

from scene.command import duration


class Progress:
    """Counts work in units of about equal cost.

    Args:
        total: units of the whole job.
        elapsed: seconds spent by earlier sessions.
        label: what every line of progress says before anything else.
        stream: where to print; by default standard output.
    """

    def __init__(
        self, total: float, elapsed: float = 0.0, label: str = "", stream: TextIO | None = None
    ) -> None:
        self._total = total
        self._label = label
        self._done = 0.0
        self._worked = 0.0
        self._before = elapsed
        self._started = time.perf_counter()
        self._stream = stream or sys.stdout
        self._open_line = False

    @property
    def elapsed(self) -> float:
        """Seconds spent on the run, earlier sessions included."""
        return self._before + time.perf_counter() - self._started

    def advance(self, units: float, *, replayed: bool = False) -> None:
        """Count work as done; replayed work took no time and does not enter the estimate."""
        self._done += units
        if not replayed:
            self._worked += units

    @property
    def left(self) -> float | None:
        """Seconds left at the pace of this session, None before anything was done."""
        if self._worked <= 0:
            return None
        pace = (time.perf_counter() - self._started) / self._worked
        return max(self._total - self._done, 0.0) * pace

    def say(self, text: str) -> None:
        """Print a line that stays."""
        self._end_line()
        print(text, file=self._stream, flush=True)

    def update(self, text: str) -> None:
        """Print where the job is; on a terminal each line replaces the one before."""
        left = "" if self.left is None else f" | {duration(self.left)} left"
        line = f"[{100 * min(self._done / self._total, 1):3.0f} %] {self._label}{text}{left}"
        if self._stream.isatty():
            self._stream.write(f"\r\x1b[2K{line}")
            self._stream.flush()
            self._open_line = True
        else:
            print(line, file=self._stream, flush=True)

    def _end_line(self) -> None:
        if self._open_line:
            self._stream.write("\n")
            self._open_line = False
