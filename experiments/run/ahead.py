"""Nets that train before anybody waits for them, behind all that is urgent.

A search waits for the last dataset of an update, then for its method. Final nets that do not depend on what
it finds fill the cores meanwhile; whoever asks for them later finds them known, or well under way.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import CancelledError, Future
from concurrent.futures.process import BrokenProcessPool
from typing import NamedTuple

from experiments.reward.evaluator import Asked, Evaluator, Job, Memory
from experiments.reward.miou import Outcome, attempt, prepared
from scene.workers import Workers

LEAST = 60.0
"""CPU seconds of nets that are worth workers of their own: one takes ten to start."""


class _Net(NamedTuple):
    evaluator: Evaluator
    job: Job
    future: Future


class Ahead:
    """The nets of a run that have begun.

    Args:
        workers: who train.
        memory: what is known, and where their outcomes are kept.
    """

    def __init__(self, workers: Workers, memory: Memory) -> None:
        self._workers, self._memory = workers, memory
        self._nets: dict[str, _Net] = {}
        self.counted: set[str] = set()

    def begin(self, asked: Asked) -> None:
        """Begin all that is not known yet, if it is worth it."""
        self._memory.refresh()
        new = {}
        for evaluator, job in asked:
            key = evaluator.key(job.source, job.seed)
            if key not in self._nets and not self._memory.knows(key):
                new[key] = evaluator, job
        if not self._nets and sum(job.cost for _, job in new.values()) < LEAST:
            return
        for key, (evaluator, job) in new.items():
            future = self._workers.begin(attempt, *evaluator.task(job), first=prepared)
            if future is not None:
                self._nets[key] = _Net(evaluator, job, future)

    def ended(self) -> Iterator[tuple[Job, Outcome]]:
        """Keep the outcomes that have come in, and yield each once."""
        for key, net in list(self._nets.items()):
            if net.future.done():
                del self._nets[key]
                try:
                    outcome = self._workers.result(net.future)
                except (BrokenProcessPool, CancelledError):
                    continue  # its worker died; who asks for it has it made
                self.counted.add(key)
                yield net.job, net.evaluator.keep(key, net.job, outcome, self._memory)

    def take(self, asked: Asked) -> dict[str, Future]:
        """Hand over the nets under way to who asks for them."""
        if not self._nets:
            return {}
        keys = {evaluator.key(job.source, job.seed) for evaluator, job in asked}
        return {key: self._nets.pop(key).future for key in keys & set(self._nets)}
