"""How far the run is, how long it will take, and its answer, in lines of text."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from typing import Any


class Progress:
    """Counts evaluations.

    Args:
        total: evaluations of the whole run.
        done: how many earlier sessions made.
    """

    def __init__(self, total: int, done: int) -> None:
        self._total, self._before, self._done = total, done, done
        self._started = time.monotonic()
        self._open_line = False

    def advance(self) -> None:
        """Counts one evaluation as done."""
        self._done += 1

    def say(self, text: str) -> None:
        """Prints a line that stays."""
        if self._open_line:
            sys.stdout.write("\n")
            self._open_line = False
        print(text, flush=True)

    def show(self, text: str, *, whole_update: bool) -> None:
        """Prints where the run is; on a terminal for every evaluation, elsewhere for every update."""
        line = f"[{100 * self._done / self._total:3.0f} %] {text}{self._left()}"
        if sys.stdout.isatty():
            sys.stdout.write(f"\r\x1b[2K{line}")
            sys.stdout.flush()
            self._open_line = True
        elif whole_update:
            print(line, flush=True)

    def _left(self) -> str:
        new = self._done - self._before
        if new == 0 or self._done >= self._total:
            return ""
        pace = (time.monotonic() - self._started) / new
        return f" | {_duration((self._total - self._done) * pace)} left"


def table(answer: Mapping[str, Any]) -> str:
    """The answer, one line per attribute.

    Args:
        answer: as in `answer.json`.

    Returns:
        Name, centre and ends of the solution's interval, and the ends of the spread's.
    """
    rows = [("attribute", "value", "from", "to", "perhaps from", "to")]
    for name, found in answer["solution"].items():
        wide = answer["spread"][name]
        numbers = (found["centre"], found["low"], found["high"], wide["low"], wide["high"])
        rows.append((name, *(f"{number:.4g}" for number in numbers)))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if column else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    )


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    if seconds < 100 * 60:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
