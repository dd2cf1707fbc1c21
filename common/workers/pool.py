"""Long-lived worker processes behind ``concurrent.futures.Executor``, which are restarted once if they die.

They render, and evaluate whole rewards for the experiments. Results come as they are ready, with the index of
their task, so that progress can be shown and answers do not depend on the order. `WorkerPool` has processes
of this machine, ``cluster.Cluster`` those of a Dask cluster.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import chain, islice
from pathlib import Path
from typing import Any, Literal, TypeVar

from common.cores import Cores
from common.memory import refuse_larger

ExecutorName = Literal["processes", "dask"]
Self = TypeVar("Self", bound="Workers")
LESS_URGENT = 10
"""Niceness of processes for work of low priority, if the system has it. With the greatest, 19, a net that was
begun would wait for hours beside programs of others."""
AHEAD = 2
"""Tasks per worker that are begun before their results are taken."""
UNGUARDED = 78
"""The exit code of a process that would start processes of its own while it starts."""
PROCESS = 100_000_000
"""The least bytes of an idle worker."""


class WorkerError(RuntimeError):
    """Workers died twice over the same work."""


class Workers:
    """Tasks for an executor. With 0 workers they run in this process, for tests and debuggers.

    Work is urgent, or *behind* all urgent work, where it fills the time of idle cores.
    """

    workers: int
    """Number of tasks at once."""
    dashboard: str | None = None
    """A page that shows the work, if there is one."""
    _patience: float | None = None
    """Seconds after which a wait checks that the workers still exist."""

    def __enter__(self: Self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop at once; unfinished work is dropped."""

    def cpu_share(self) -> float | None:
        """Stop; returns the share of their cores that was used since they opened, or None if unknown."""
        return None

    def share(self, path: str) -> str:
        """The name for tasks of a file or folder of this machine, whose content must not change."""
        return str(Path(path).absolute()) if path else path

    def begin(
        self, function: Callable[..., Any], *task: Any, first: Any = None, behind: bool = True
    ) -> Future | None:
        """Begin a net, by default behind all urgent work, for a later ``map``; None with 0 workers."""
        return self._submit(function, task, True, first, behind) if self.workers else None

    def map(
        self,
        function: Callable[..., Any],
        tasks: Sequence[tuple],
        *,
        net: bool = False,
        first: Callable[..., Any] | None = None,
        begun: Mapping[int, Future] | None = None,
    ) -> Iterator[tuple[int, Any]]:
        """Yield (index, ``function(*tasks[index])``) as results come.

        Args:
            function: a function of a module, like ``first``.
            tasks: its arguments.
            net: whether it trains or applies a net, and uses a GPU if there is one.
            first: the part without a GPU. On a cluster with GPUs it is a separate task, for
                ``function(*task, ready=first(*task))``.
            begun: tasks by index that were given to `begin`; those that still wait are urgent now.

        Raises:
            WorkerError: a process died, and died again when the work was repeated.
            Exception: any error of ``function``.
        """
        if self.workers == 0:
            for index, task in enumerate(tasks):
                yield index, function(*task)
            return
        done: set[int] = set()
        given = (begun or {}).items()
        futures = {index: future for index, future in given if not self._taken_back(future)}
        try:
            for attempt in range(2):
                try:
                    for index, task in enumerate(tasks):
                        if index not in done and index not in futures:
                            futures[index] = self._submit(function, task, net, first, False)
                    for index, result in self._results(futures):
                        done.add(index)
                        yield index, result
                    return
                except BrokenProcessPool as error:
                    self._drop(futures.values())
                    futures = {}
                    if attempt:
                        raise WorkerError(
                            f"a worker process died twice with {len(tasks) - len(done)} tasks left "
                            "(out of memory, or killed?); try fewer --workers"
                        ) from error
        except BaseException:
            self._drop(futures.values())
            raise

    def in_order(self, function: Callable[..., Any], tasks: Iterable[tuple]) -> Iterator[Any]:
        """Yield ``function(*task)`` in the order of tasks, which may be endless; a few are begun ahead.

        Raises:
            WorkerError: a process died, and died again when the work was repeated.
            Exception: any error of ``function``.
        """
        if self.workers == 0:
            yield from (function(*task) for task in tasks)
            return
        left, died = iter(tasks), False
        ahead: deque[tuple[tuple, Future]] = deque()
        try:
            while True:
                for task in islice(left, AHEAD * self.workers - len(ahead)):
                    ahead.append((task, self._submit(function, task, False, None, False)))
                if not ahead:
                    return
                try:
                    [(_, result)] = self._results({0: ahead[0][1]})
                except BrokenProcessPool as error:
                    if died:
                        raise WorkerError(
                            "a worker process died twice over one task (out of memory, or killed?); "
                            "try fewer workers"
                        ) from error
                    died = True
                    self._drop(future for _, future in ahead)
                    left = chain([task for task, _ in ahead], left)
                    ahead.clear()
                    continue
                ahead.popleft()
                died = False
                yield result
        finally:
            if ahead:
                self._drop(future for _, future in ahead)

    def _results(self, futures: dict[int, Future]) -> Iterator[tuple[int, Any]]:
        """Yield results and empty the dictionary."""
        left = {future: index for index, future in futures.items()}
        while left:
            ready, _ = wait(left, timeout=self._patience, return_when=FIRST_COMPLETED)
            if not ready:
                self._refuse_lost()
            while ready:
                future = ready.pop()
                index = left.pop(future)
                del futures[index]
                yield index, self.result(future)

    def _submit(
        self, function: Callable[..., Any], task: tuple, net: bool, first: Any, behind: bool
    ) -> Future:
        raise NotImplementedError

    def result(self, future: Future) -> Any:
        """The result of finished work."""
        return future.result()

    def _taken_back(self, future: Future) -> bool:
        """Take back work of low priority that still waits; returns whether it did."""
        return False

    def _drop(self, futures: Iterable[Future]) -> None:
        """Drop unfinished work."""
        self.close()

    def _refuse_lost(self) -> None:
        """Raise an error if no answer can come."""


class WorkerPool(Workers):
    """``workers`` processes of this machine with one thread each, and as many of low priority when needed.

    The system chooses their cores, since other jobs may run, too. Processes of low priority run mostly on
    idle cores. If there are GPUs, each process sees one.
    """

    def __init__(self, workers: int, environment: dict[str, str] | None = None) -> None:
        if workers < 0:
            raise ValueError(f"workers must be 0 or more, not {workers}")
        self.workers = workers
        # Threads of OpenBLAS spin, which makes XLA's Cholesky 300 times slower on shared cores.
        self._environment = {"OPENBLAS_NUM_THREADS": "1", **(environment or {})}
        self._executors: dict[bool, ProcessPoolExecutor] = {}
        self._cores = Cores()

    def cpu_share(self) -> float:
        """Stop; returns the share of their cores, with this process, that was used since they opened."""
        self.close()  # the time of children is known when they have ended
        return self._cores.share(self.workers)

    def close(self) -> None:
        """Stop the processes at once; unfinished work is dropped."""
        for behind in list(self._executors):
            self._stop(behind)

    def _stop(self, behind: bool) -> None:
        executor = self._executors.pop(behind)
        processes = list((executor._processes or {}).values())
        for process in processes:
            process.terminate()
        executor.shutdown(wait=True, cancel_futures=True)
        if any(process.exitcode == UNGUARDED for process in processes):
            raise WorkerError(
                "each worker process runs the main script again, which then starts workers again; "
                'put its code under: if __name__ == "__main__":'
            ) from None

    def _submit(
        self, function: Callable[..., Any], task: tuple, net: bool, first: Any, behind: bool
    ) -> Future:
        with _inherited(self._environment):  # processes start with a task
            try:
                return self._executor(behind).submit(function, *task)
            except BrokenProcessPool:  # one has died since; unfinished tasks report it
                self._stop(behind)
                return self._executor(behind).submit(function, *task)

    def _taken_back(self, future: Future) -> bool:
        return future.cancel()

    def _executor(self, behind: bool) -> Executor:
        if behind not in self._executors:
            if getattr(multiprocessing.current_process(), "_inheriting", False):
                os._exit(
                    UNGUARDED
                )  # ``_stop`` explains it; an exception would print a traceback each
            context = multiprocessing.get_context("spawn")
            self._executors[behind] = ProcessPoolExecutor(
                self.workers,
                mp_context=context,
                initializer=_start,
                initargs=(context.Value("i", 0), LESS_URGENT if behind else 0),
            )
        return self._executors[behind]


def refuse_many_workers(flag: str, workers: int) -> None:
    """Raise UserError with the flag if so many processes need more memory than there is."""
    refuse_larger(flag, workers, lambda count: count * PROCESS, "processes")


@contextmanager
def opened(workers: int | Workers) -> Iterator[Workers]:
    """Open a new pool of processes, which is closed at the end; or pass on workers, which stay open."""
    if isinstance(workers, Workers):
        yield workers
        return
    with WorkerPool(workers) as pool:
        yield pool


@contextmanager
def _inherited(environment: dict[str, str]) -> Iterator[None]:
    """Prepare processes that start meanwhile, before they import anything.

    They get the variables of ``environment``, and a blocked SIGINT, since the parent handles Ctrl-C.
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


def _start(counter: Any, nice: int) -> None:
    """Set up a worker: one thread, one GPU, no Ctrl-C, and an end with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with counter.get_lock():
        number = counter.value
        counter.value += 1
    import cv2  # the main process may not need it

    cv2.setNumThreads(1)
    if nice and hasattr(os, "nice"):
        os.nice(nice)
    gpus = _gpus()
    if gpus:
        os.environ["CUDA_VISIBLE_DEVICES"] = gpus[number % len(gpus)]


def _gpus() -> list[str]:
    """NVIDIA GPUs for this process, as CUDA_VISIBLE_DEVICES names them."""
    named = os.environ.get("CUDA_VISIBLE_DEVICES")
    if named is not None:
        return [name for name in named.split(",") if name]
    return [str(k) for k, _ in enumerate(Path("/proc/driver/nvidia/gpus").glob("*"))]


def _end_with_parent() -> None:
    """End this worker with its parent, since a killed parent could not stop it."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
