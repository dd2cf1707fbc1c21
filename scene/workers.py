"""A pool of long-lived worker processes whose death is survived once.

Used for rendering, and by the experiments for whole rewards. Results come back as they are ready, with
the index of their task, so that progress can be shown and answers do not depend on the order.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

import cv2

from shell.memory import refuse_larger

PROCESS = 100_000_000
"""Bytes of a worker that has done nothing yet, at least."""


class WorkerError(RuntimeError):
    """Workers died twice over the same work."""


class WorkerPool:
    """``workers`` processes, one core each, started when first needed.

    With 0 workers the tasks run in this process, which tests and debuggers like.
    """

    def __init__(self, workers: int, environment: dict[str, str] | None = None) -> None:
        if workers < 0:
            raise ValueError(f"workers must be 0 or more, not {workers}")
        self.workers = workers
        self._environment = environment or {}
        self._executor: ProcessPoolExecutor | None = None

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop the processes at once; work under way is dropped."""
        if self._executor is not None:
            for process in list((self._executor._processes or {}).values()):
                process.terminate()
            self._executor.shutdown(wait=True, cancel_futures=True)
            self._executor = None

    def map(
        self, function: Callable[..., Any], tasks: Sequence[tuple]
    ) -> Iterator[tuple[int, Any]]:
        """Yield (index, ``function(*tasks[index])``) as results come in.

        Raises:
            WorkerError: a process died, and died again when the work was repeated.
            Exception: whatever ``function`` raised.
        """
        if self.workers == 0:
            for index, task in enumerate(tasks):
                yield index, function(*task)
            return
        done: set[int] = set()
        try:
            for attempt in range(2):
                try:
                    for index, result in self._attempt(function, tasks, done):
                        done.add(index)
                        yield index, result
                    return
                except BrokenProcessPool as error:
                    self.close()
                    if attempt:
                        raise WorkerError(
                            f"a worker process died twice with {len(tasks) - len(done)} tasks left "
                            "(out of memory, or killed?); try fewer --workers"
                        ) from error
        except BaseException:
            self.close()
            raise

    def _attempt(
        self, function: Callable[..., Any], tasks: Sequence[tuple], done: set[int]
    ) -> Iterator[tuple[int, Any]]:
        if self._executor is None:
            context = multiprocessing.get_context("spawn")
            self._executor = ProcessPoolExecutor(
                self.workers,
                mp_context=context,
                initializer=_start,
                initargs=(context.Value("i", 0),),
            )
        with _inherited(self._environment):
            left: dict[Future, int] = {
                self._executor.submit(function, *task): index
                for index, task in enumerate(tasks)
                if index not in done
            }
        while left:
            ready, _ = wait(left, return_when=FIRST_COMPLETED)
            for future in ready:
                yield left.pop(future), future.result()


def refuse_many_workers(flag: str, workers: int) -> None:
    """Raise UserError if so many processes need more memory than there is; names the flag."""
    refuse_larger(flag, workers, lambda count: count * PROCESS, "processes")


@contextmanager
def opened(workers: int | WorkerPool) -> Iterator[WorkerPool]:
    """A new pool of so many processes, closed in the end; or the pool itself, which is left open."""
    if isinstance(workers, WorkerPool):
        yield workers
        return
    with WorkerPool(workers) as pool:
        yield pool


@contextmanager
def _inherited(environment: dict[str, str]) -> Iterator[None]:
    """What processes started meanwhile find from their first moment on, before they import anything.

    The variables of ``environment``, and a blocked SIGINT: Ctrl-C is the parent's business.
    """
    before = {name: os.environ.get(name) for name in environment}
    os.environ.update(environment)
    if hasattr(signal, "pthread_sigmask"):
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _start(counter: Any) -> None:
    """Give each worker one core of its own, leave Ctrl-C to the parent, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with counter.get_lock():
        number = counter.value
        counter.value += 1
    cv2.setNumThreads(1)
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {cores[number % len(cores)]})


def _end_with_parent() -> None:
    """A parent that was killed cannot stop its workers, who would wait for work for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
