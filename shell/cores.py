"""How busy the cores were: CPU time of this process and of its children, against what there was."""

from __future__ import annotations

import os
import time


class Cores:
    """A measure that begins now."""

    def __init__(self) -> None:
        self._wall, self._cpu = time.perf_counter(), _cpu()

    def share(self, cores: int) -> float:
        """What share of so many cores was used; of children, those that have ended count."""
        wall = time.perf_counter() - self._wall
        return (_cpu() - self._cpu) / (wall * max(cores, 1))


def _cpu() -> float:
    return sum(os.times()[:4])
