"""Long-lived worker processes behind ``concurrent.futures.Executor``, which are restarted once if they die.

They render, and evaluate whole rewards for the experiments. Results come as they are ready, with the index of
their task, so that progress can be shown and answers do not depend on the order. `WorkerPool` has processes
of this machine, ``cluster.Cluster`` those of a Dask cluster.

One kind of worker does everything, or there are two: renderers, and *trainers* with a device (`pipeline`).
"""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import chain, islice, takewhile
from pathlib import Path
from typing import Any, Literal, TypeVar
from weakref import WeakSet

from common.memory import refuse_larger
from common.workers import under_way
from common.workers.pipeline import Pipeline, Split

ExecutorName = Literal["processes", "dask"]
Self = TypeVar("Self", bound="Workers")
LESS_URGENT = 10
"""Niceness of processes for work of low priority, if the system has it. With the greatest, 19, a network
would wait for hours while other programs run."""
TICK = 2.0
"""Seconds between two looks at tasks under way."""
AHEAD = 2
"""Tasks per worker that are started before their results are taken."""
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
    """Number of tasks at once; where trainers are apart, of renderers."""
    trainers: int | None = None
    """Number of trainers; None where workers render and train."""
    share_disk = True
    """Whether they read and write the files of this process."""
    dashboard: str | None = None
    """A page that shows the work, if there is one."""
    watch: Callable[[float], None] | None = None
    """Called while results are awaited with the units of work that unfinished tasks have reported."""
    _patience: float | None = None
    """Seconds after which a wait checks that the workers still exist."""
    _pipeline: Pipeline | None = None
    """Tasks of trainers that are apart, since the first one."""

    def __enter__(self: Self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop at once; unfinished work is dropped."""

    @property
    def processes(self) -> int:
        """The number of processes that work at once, this one if there are no others."""
        return max(self.workers, 1) + (self.trainers or 0)

    def cpu_share(self) -> float | None:
        """Stop; returns the share of their cores that was used since they opened, or None if unknown."""
        return None

    def under_way(self) -> float:
        """The units of work that unfinished tasks have reported (`common.workers.under_way`)."""
        return 0.0

    def share(self, path: str) -> str:
        """The name for tasks of a file or folder of this machine, whose content must not change."""
        return str(Path(path).absolute()) if path else path

    def begin(
        self,
        function: Callable[..., Any],
        *task: Any,
        split: Split | None = None,
        behind: bool = True,
    ) -> Future | None:
        """Begin a network, by default behind all urgent work, for a later ``map``; None with 0 workers."""
        return self._begin_nets(function, [task], split, behind)[0] if self.workers else None

    def map(
        self,
        function: Callable[..., Any],
        tasks: Sequence[tuple],
        *,
        net: bool = False,
        split: Split | None = None,
        started: Mapping[int, Future] | None = None,
    ) -> Iterator[tuple[int, Any]]:
        """Yield (index, ``function(*tasks[index])``) as results come.

        Args:
            function: a function of a module.
            tasks: its arguments.
            net: whether it trains or applies a network, and uses a GPU if there is one.
            split: how a network is divided between renderers and trainers; by default a trainer does it all.
            started: futures from `begin` by the index of their task; those that still wait become urgent,
                and those that were dropped, since a worker died, begin again.

        Raises:
            WorkerError: a process died, and died again when the work was repeated.
            Exception: any error of ``function``.
        """
        if self.workers == 0:
            for index, task in enumerate(tasks):
                yield index, function(*task)
            return
        done: set[int] = set()
        futures = {
            index: future
            for index, future in (started or {}).items()
            if not _was_dropped(future) and not self._taken_back(future)
        }
        try:
            for attempt in range(2):
                try:
                    new = [k for k in range(len(tasks)) if k not in done and k not in futures]
                    new_tasks = [tasks[k] for k in new]
                    # No other name may hold the futures, since each keeps its result.
                    futures.update(zip(
                        new,
                        self._begin_nets(function, new_tasks, split, False) if net
                        else [self._submit(function, t, behind=False) for t in new_tasks],
                        strict=True,
                    ))  # fmt: skip
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
        """Yield ``function(*task)`` in the order of tasks, which may be endless; a few are started ahead.

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
                    ahead.append((task, self._submit(function, task, behind=False)))
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
            patience = self._patience if self.watch is None else TICK
            ready, _ = wait(left, timeout=patience, return_when=FIRST_COMPLETED)
            if self.watch is not None:
                self.watch(self.under_way())
            if not ready:
                self._refuse_lost()
            while ready:
                future = ready.pop()
                index = left.pop(future)
                del futures[index]
                yield index, self.result(future)

    def _begin_nets(
        self,
        function: Callable[..., Any],
        tasks: Sequence[tuple],
        split: Split | None,
        behind: bool,
    ) -> list[Future]:
        """Begin networks, on trainers if they are apart."""
        if self.trainers is None:
            return [self._submit(function, task, trains=True, behind=behind) for task in tasks]
        if self._pipeline is None:
            self._pipeline = Pipeline(self)
        return self._pipeline.submit(function, tasks, split, behind)

    def trainers_now(self) -> int:
        """The number of trainers, which may change."""
        return self.trainers or 0

    def begin_part(self, function: Callable[..., Any], task: tuple, behind: bool) -> Any:
        """Begin a part of a network on a renderer; returns its future."""
        return self._submit(function, task, behind=behind)

    def begin_training(self, function: Callable[..., Any], task: tuple, behind: bool) -> Future:
        """Begin work on a trainer."""
        return self._submit(function, task, trains=True, behind=behind)

    def part_result(self, part: Any) -> Any:
        """The result of a part, as a trainer gets it."""
        return part.result()

    def _submit(
        self, function: Callable[..., Any], task: tuple, *, trains: bool = False, behind: bool
    ) -> Future:
        raise NotImplementedError

    def result(self, future: Future) -> Any:
        """The result of finished work."""
        return future.result()

    def _taken_back(self, future: Future) -> bool:
        """Take back work of low priority that still waits; returns whether it did.

        In a pipeline it becomes urgent where it is.
        """
        if self._pipeline is not None:
            self._pipeline.hurry(future)
        return False

    def _drop(self, futures: Iterable[Future]) -> None:
        """Drop unfinished work."""
        self.close()

    def _close_pipeline(self) -> None:
        if self._pipeline is not None:
            self._pipeline.close()
            self._pipeline = None

    def _refuse_lost(self) -> None:
        """Raise an error if no answer can come."""


def _was_dropped(future: Future) -> bool:
    """Whether a pipeline that closed has dropped this work, as when a worker dies."""
    return future.done() and (future.cancelled() or isinstance(future.exception(), CancelledError))


Kind = Literal["workers", "behind", "trainers"]
"""Processes that render, and train unless there are trainers; those of low priority; trainers."""


class WorkerPool(Workers):
    """``workers`` processes of this machine with one thread each, and as many of low priority when needed.

    The system chooses their cores, since other jobs may run, too. Processes of low priority run mostly on
    idle cores. If there are GPUs, each process sees one.

    Args:
        workers: number of processes; 0 works in this one.
        environment: variables that they get before they import anything.
        trainers: number of separate processes for networks, each of which sees one GPU if there are any; the
            others then see none. By default workers do both.
    """

    def __init__(
        self,
        workers: int,
        environment: dict[str, str] | None = None,
        trainers: int | None = None,
    ) -> None:
        if workers < 0:
            raise ValueError(f"workers must be 0 or more, not {workers}")
        self.workers, self.trainers = workers, trainers if workers else None
        # Threads of OpenBLAS spin, which makes XLA's Cholesky 300 times slower on shared cores.
        self._environment = {"OPENBLAS_NUM_THREADS": "1", **(environment or {})}
        self._executors: dict[Kind, ProcessPoolExecutor] = {}
        self._reported: dict[Kind, Any] = {}  # units of each process
        self._behind: WeakSet[Future] = WeakSet()  # work of low priority
        self._lock = threading.RLock()  # the pipeline's thread starts processes, too
        self._opened = time.perf_counter(), _cpu_seconds()

    def under_way(self) -> float:
        """The units of work that unfinished tasks have reported."""
        return float(sum(map(sum, list(self._reported.values()))))

    def cpu_share(self) -> float:
        """Stop; returns the share of their cores, with this process, that was used since they opened."""
        self.close()  # the time of children is known when they have ended
        opened, used_before = self._opened
        core_seconds = (time.perf_counter() - opened) * self.processes
        return (_cpu_seconds() - used_before) / core_seconds

    def close(self) -> None:
        """Stop the processes at once; unfinished work is dropped."""
        self._close_pipeline()
        for kind in list(self._executors):
            self._stop(kind)

    def _stop(self, kind: Kind) -> None:
        with self._lock:
            executor = self._executors.pop(kind)
            self._reported.pop(kind)
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
        self, function: Callable[..., Any], task: tuple, *, trains: bool = False, behind: bool
    ) -> Future:
        apart = trains and self.trainers is not None
        kind: Kind = "trainers" if apart else "behind" if behind else "workers"
        with self._lock, _inherited(self._environment):  # processes start with a task
            try:
                future = self._executor(kind).submit(function, *task)
            except BrokenProcessPool:  # one has died since; unfinished tasks report it
                self._stop(kind)
                future = self._executor(kind).submit(function, *task)
        if kind == "behind":
            self._behind.add(future)
        return future

    def _taken_back(self, future: Future) -> bool:
        if self._pipeline is not None:
            return super()._taken_back(future)
        return future in self._behind and future.cancel()

    def _executor(self, kind: Kind) -> Executor:
        if kind not in self._executors:
            if getattr(multiprocessing.current_process(), "_inheriting", False):
                os._exit(
                    UNGUARDED
                )  # ``_stop`` explains it; an exception would print a traceback each
            context = multiprocessing.get_context("spawn")
            count = (self.trainers or 0) if kind == "trainers" else self.workers
            sees_gpu = kind == "trainers" or self.trainers is None
            nice = LESS_URGENT if kind == "behind" else 0
            reported = self._reported[kind] = context.Array("d", count, lock=False)
            self._executors[kind] = ProcessPoolExecutor(
                count,
                mp_context=context,
                initializer=_start,
                initargs=(context.Value("i", 0), nice, sees_gpu, reported),
            )
        return self._executors[kind]


def _cpu_seconds() -> float:
    """CPU time of this process and of its children that have ended."""
    return sum(os.times()[:4])


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


def _start(counter: Any, nice: int, sees_gpu: bool, reported: Any) -> None:
    """Set up a worker: one thread, one GPU or none, no Ctrl-C, and an end with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with counter.get_lock():
        number = counter.value
        counter.value += 1
    under_way.connect(reported, number)
    import cv2  # the main process may not need it

    cv2.setNumThreads(1)
    if nice and hasattr(os, "nice"):
        os.nice(nice)
    names = gpus()
    if names:
        os.environ["CUDA_VISIBLE_DEVICES"] = names[number % len(names)] if sees_gpu else ""


def cores() -> int:
    """Count the cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def gpus() -> list[str]:
    """NVIDIA GPUs for this process, as CUDA_VISIBLE_DEVICES names them.

    As for CUDA, the first name of no GPU ends the list: -1, or NoDevFiles of Slurm.
    """
    named = os.environ.get("CUDA_VISIBLE_DEVICES")
    if named is not None:
        names = (name.strip() for name in named.split(","))
        return list(takewhile(re.compile(r"\d|GPU-|MIG-").match, names))
    return [str(k) for k, _ in enumerate(Path("/proc/driver/nvidia/gpus").glob("*"))]


def _end_with_parent() -> None:
    """End this worker with its parent, since a killed parent could not stop it."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
