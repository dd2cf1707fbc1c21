"""Use of the cores: CPU time of this process and its children, as a share of the time of all cores."""

from __future__ import annotations

import os
import time


class Cores:
    """A measurement that starts now."""

    def __init__(self) -> None:
        self._wall, self._cpu = time.perf_counter(), _cpu()

    def share(self, cores: int) -> float:
        """The share of so many cores in use since then; only children that have ended count."""
        wall = time.perf_counter() - self._wall
        return (_cpu() - self._cpu) / (wall * max(cores, 1))


def _cpu() -> float:
    return sum(os.times()[:4])
