"""Show the progress of a job and the time left: live bars on a terminal, lines of text elsewhere."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, TextIO

from rich.console import Console, RenderableType
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar
from rich.text import Text

from common.errors import printable, printable_lines


def duration(seconds: float) -> str:
    """Format a time: ``75 s``, ``12 min`` or ``3.4 h``."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    if seconds < 100 * 60:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


LINE = 20.0
"""Seconds without a result after which a plain line tells how far unfinished pieces are."""
TRUST = 0.1
"""The share of the work after which the measured pace counts as much as the expected one."""


class Stage(NamedTuple):
    """Networks or other results of one kind; a job goes through its stages in order."""

    what: str  # such as "rewards of the search"
    number: int
    units: float  # of work in total


class _Board(Bar):
    """Bars with a line below them."""

    below = ""

    def get_renderables(self) -> Iterable[RenderableType]:
        """The bars and the line."""
        yield self.make_tasks_table(self.tasks)
        if self.below:
            yield Text(self.below, no_wrap=True, overflow="ellipsis")


class Progress:
    """Counts work in units of about equal cost.

    Args:
        total: units of the whole job.
        elapsed: seconds spent by earlier sessions.
        label: the start of every line of progress.
        stream: the stream to print to; by default standard output.
        stages: stages of the work in order; on a terminal each has its own bar.
        workers: the number of workers, each on one core.

    Attributes:
        standing: the state of the job, such as its best reward, which a terminal always shows.
    """

    def __init__(
        self,
        total: float,
        elapsed: float = 0.0,
        label: str = "",
        stream: TextIO | None = None,
        *,
        stages: Sequence[Stage] = (),
        workers: int = 1,
    ) -> None:
        self._total, self._label, self._before = total, label, elapsed
        self._stages, self._workers = stages, workers
        self.standing = ""
        self._done = self._worked = self._expected = self._start = 0.0
        self._under_way = self._furthest = 0.0  # units of unfinished pieces; the most units shown
        self._line_time = -math.inf  # of the last plain line about them
        self._networks = 0
        self._started = self._paced = self._latest = time.perf_counter()
        self._stream = stream or sys.stdout
        self._console = Console(file=self._stream)
        # Rich draws nothing on terminals without a cursor; when forced, it would draw into files.
        terminal = self._console.is_terminal and not self._console.is_dumb_terminal
        self._live = terminal and self._stream.isatty()
        self._bar: _Board | None = None
        self._report: Callable[[float, str], None] | None = None
        self._every = self._due = 0.0
        self._shown = ""  # the percentage of the last plain line
        self._text = ""  # of the last update

    def tell(self, every: float, report: Callable[[float, str], None]) -> None:
        """Report the progress to a function, too: at the next update, then at intervals.

        Args:
            every: seconds between two reports.
            report: takes the share of the work that is done, in [0, 1], and a line of text.
        """
        self._every, self._due, self._report = every, 0.0, report

    @property
    def elapsed(self) -> float:
        """The seconds spent on the job, earlier sessions included."""
        return self._before + time.perf_counter() - self._started

    def expect(self, seconds: float, start: float) -> None:
        """Set how long all work is expected to take: ``start`` seconds from now, then ``seconds``."""
        self._expected, self._start = seconds, start
        self._paced = self._latest = time.perf_counter()

    @property
    def left(self) -> float | None:
        """The seconds left: as expected at first, then more and more by the pace of this session.

        Without an expected time it is None until a hundredth is done, since the first pieces compile.
        """
        under_way = self._under_way if self._worked else 0.0  # the first piece also starts workers
        left, spent = (
            max(self._total - self._done - under_way, 0.0),
            time.perf_counter() - self._paced,
        )
        worked = self._worked + under_way
        if self._expected:
            trust = TRUST * self._total
            pace = self._expected / self._total
            if worked <= 0:
                return max(self._start - spent, 0.0) + left * pace
            return left * (spent + trust * pace) / (worked + trust)
        if worked <= 0 or worked < self._total / 100:
            return None
        return left * spent / worked

    def advance(self, units: float = 1.0, *, networks: int = 1, replayed: bool = False) -> None:
        """Count work as done; replayed work and its time do not enter the estimate.

        Args:
            units: the cost of the work.
            networks: how many networks it has trained; 0 for streets alone.
            replayed: whether an earlier session did it.
        """
        now = time.perf_counter()
        self._done += units
        self._under_way = max(self._under_way - units, 0.0)
        if replayed:
            self._paced += now - self._latest
        else:
            if not self._worked:
                self._paced += min(self._start, now - self._paced)
            self._worked += units
            self._networks += networks
        self._latest = now

    def under_way(self, units: float) -> None:
        """Show the work done of unfinished pieces, which `advance` counts once they are finished."""
        self._under_way = max(units, self._furthest - self._done, 0.0)  # shown progress never falls
        self._furthest = max(self._furthest, self._done + self._under_way)
        if self._live and self._text:
            self.update(self._text)
        elif units > 0 and time.perf_counter() >= max(self._line_time, self._latest) + LINE:
            self.update("training", minor=True)
            self._line_time = time.perf_counter()

    def say(self, text: str) -> None:
        """Print one or several lines that stay."""
        text = printable_lines(text)
        if self._bar is not None:
            self._console.print(Text(text), soft_wrap=True)
        else:
            print(text, file=self._stream, flush=True)

    def update(self, text: str, *, minor: bool = False) -> None:
        """Show the state of the job; a minor one has no line of its own until the percentage changes."""
        self._text = text = printable(text)
        done = self._done + self._under_way
        share = min(done / self._total, 1) if self._total > 0 else 1.0
        left = [] if self.left is None else [f"{duration(self.left)} left"]
        if self._report is not None and time.perf_counter() >= self._due:
            self._report(share, " | ".join([text, *left]))
            self._due = time.perf_counter() + self._every
        if not self._live:
            shown = f"[{100 * share:3.0f} %]"
            if not minor or shown != self._shown:
                line = self._label + " | ".join([text, *left])
                print(shown, line, file=self._stream, flush=True)
                self._shown = shown
            return
        if self._bar is None:
            line_of = TextColumn("{task.percentage:3.0f} % {task.description}", markup=False)
            self._bar = _Board(BarColumn(20), line_of, console=self._console)
            self._bar.add_task("", total=1.0)
            for stage in self._stages:
                self._bar.add_task("", total=stage.units)
            self._bar.start()
        line = self._label + " | ".join([*left, text])  # narrow terminals cut off the end
        first, *others = self._bar.task_ids
        self._bar.below = " | ".join(self._facts())
        for task, (stage, done) in zip(others, self._by_stage(), strict=True):
            made = stage.number * done / (stage.units or 1)
            text = f"{stage.what}, {made:.0f} of {stage.number}"
            self._bar.update(task, completed=done, description=text)
        self._bar.update(first, completed=share, description=line)

    def _by_stage(self) -> Iterable[tuple[Stage, float]]:
        """The units done of each stage; work fills the stages in order."""
        left = self._done + self._under_way
        for stage in self._stages:
            done = min(max(left, 0.0), stage.units)
            left -= stage.units
            yield stage, done

    def _facts(self) -> list[str]:
        """The parts of the line below the bars: pace, cost and state of the job."""
        facts = [self.standing] if self.standing else []
        if self._stages and self._worked > 0:
            spent = time.perf_counter() - self._started
            cpu = spent / self._worked * self._total * self._workers
            facts.insert(0, f"about {duration(cpu)} of CPU in total")
            if self._networks:
                pace = 60 * self._networks / max(spent, 1e-9)
                facts.insert(0, f"{pace:.3g} networks a minute")
        return facts

    def close(self) -> None:
        """Keep the last line; the next output starts on a new line."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
