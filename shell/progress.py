"""How far a job is and how long it will take: a live bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from typing import TextIO

from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar
from rich.text import Text


def duration(seconds: float) -> str:
    """``75 s``, ``12 min`` or ``3.4 h``."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    if seconds < 100 * 60:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


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
        self._total, self._label, self._before = total, label, elapsed
        self._done = self._worked = 0.0
        self._started = time.perf_counter()
        self._stream = stream or sys.stdout
        self._console = Console(file=self._stream)
        # Rich draws nothing on terminals without a cursor, and would draw into files if told to force it.
        terminal = self._console.is_terminal and not self._console.is_dumb_terminal
        self._live = terminal and self._stream.isatty()
        self._bar: Bar | None = None

    @property
    def elapsed(self) -> float:
        """Seconds spent on the job, earlier sessions included."""
        return self._before + time.perf_counter() - self._started

    @property
    def left(self) -> float | None:
        """Seconds left at the pace of this session, None before anything was done."""
        if self._worked <= 0:
            return None
        pace = (time.perf_counter() - self._started) / self._worked
        return max(self._total - self._done, 0.0) * pace

    def advance(self, units: float = 1.0, *, replayed: bool = False) -> None:
        """Count work as done; replayed work took no time and does not enter the estimate."""
        self._done += units
        if not replayed:
            self._worked += units

    def say(self, text: str) -> None:
        """Print a line that stays."""
        if self._bar is not None:
            self._console.print(Text(text), soft_wrap=True)
        else:
            print(text, file=self._stream, flush=True)

    def update(self, text: str) -> None:
        """Tell where the job is."""
        share = min(self._done / self._total, 1) if self._total > 0 else 1.0
        left = [] if self.left is None else [f"{duration(self.left)} left"]
        if not self._live:
            line = self._label + " | ".join([text, *left])
            print(f"[{100 * share:3.0f} %] {line}", file=self._stream, flush=True)
            return
        if self._bar is None:
            line_of = TextColumn("{task.percentage:3.0f} % {task.description}", markup=False)
            self._bar = Bar(BarColumn(20), line_of, console=self._console)
            self._bar.add_task("", total=1.0)
            self._bar.start()
        line = self._label + " | ".join([*left, text])  # narrow terminals cut the end off
        self._bar.update(self._bar.task_ids[0], completed=share, description=line)

    def close(self) -> None:
        """Leave the last line as it is; what is printed next begins on a line of its own."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
