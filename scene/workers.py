"""Long-lived worker processes, started again once if they die, behind ``concurrent.futures.Executor``.

Used for rendering, and by the experiments for whole rewards. Results come back as they are ready, with
the index of their task, so that progress can be shown and answers do not depend on the order. `WorkerPool`
has processes of this machine, ``scene.cluster.Cluster`` those of a Dask cluster.
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
from itertools import islice
from pathlib import Path
from typing import Any, Literal, TypeVar

from shell.cores import Cores
from shell.memory import refuse_larger

ExecutorName = Literal["processes", "dask"]
Self = TypeVar("Self", bound="Workers")
LEAST_URGENT = 19
"""How nice processes are that work behind the others, where the system knows such a thing."""
AHEAD = 2
"""Tasks that are worked at ahead of what is taken, per worker."""
PROCESS = 100_000_000
"""Bytes of a worker that has done nothing yet, at least."""


class WorkerError(RuntimeError):
    """Workers died twice over the same work."""


class Workers:
    """Tasks for an executor. With 0 workers they run in this process, which tests and debuggers like.

    Work is urgent, or *behind* all that is urgent: it fills the time for which others leave a core idle.
    """

    workers: int
    """How many work at once."""
    dashboard: str | None = None
    """A page that shows them at work, if there is one."""
    _patience: float | None = None
    """Seconds after which a wait looks whether the workers are still there."""

    def __enter__(self: Self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop at once; work under way is dropped."""

    def cpu_share(self) -> float | None:
        """Stop, and say what share of their cores was used since they opened; None where nobody knows."""
        return None

    def share(self, path: str) -> str:
        """What tasks call a file or folder of this machine; its content is not to change any more."""
        return str(Path(path).absolute()) if path else path

    def begin(
        self, function: Callable[..., Any], *task: Any, first: Any = None, behind: bool = True
    ) -> Future | None:
        """A net, by default behind all that is urgent, for ``map`` to wait for; None with 0 workers."""
        return self._submit(function, task, True, first, behind) if self.workers else None

    def map(
        self,
        function: Callable[..., Any],
        tasks: Sequence[tuple],
        *,
        net: bool = False,
        first: Callable[..., Any] | None = None,
        behind: bool = False,
        begun: Mapping[int, Future] | None = None,
    ) -> Iterator[tuple[int, Any]]:
        """Yield (index, ``function(*tasks[index])``) as results come in.

        Args:
            function: of a module; so is ``first``.
            tasks: its arguments.
            net: whether it trains or applies one, and wants a GPU where there are some.
            first: what of it wants none. On a cluster with GPUs it is a task of its own, for
                ``function(*task, ready=first(*task))``.
            behind: whether all that is urgent comes before.
            begun: tasks by index that `begin` was given.

        Raises:
            WorkerError: a process died, and died again when the work was repeated.
            Exception: whatever ``function`` raised.
        """
        if self.workers == 0:
            for index, task in enumerate(tasks):
                yield index, function(*task)
            return
        done: set[int] = set()
        futures = dict(begun or {})
        try:
            for attempt in range(2):
                try:
                    for index, task in enumerate(tasks):
                        if index not in done and index not in futures:
                            futures[index] = self._submit(function, task, net, first, behind)
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
        """Yield ``function(*task)`` of tasks in their order, which need not end; a few are worked at ahead.

        Raises:
            WorkerError: a process died, and died again when the work was repeated.
            Exception: whatever ``function`` raised.
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
                    again = [task for task, _ in ahead]
                    ahead = deque(
                        (task, self._submit(function, task, False, None, False)) for task in again
                    )
                    continue
                ahead.popleft()
                died = False
                yield result
        finally:
            if ahead:
                self._drop(future for _, future in ahead)

    def _results(self, futures: dict[int, Future]) -> Iterator[tuple[int, Any]]:
        """Empties the dictionary: what was taken from here is nowhere else."""
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
        """The result of what has ended."""
        return future.result()

    def _drop(self, futures: Iterable[Future]) -> None:
        """Forget work that is under way."""
        self.close()

    def _refuse_lost(self) -> None:
        """Raise an error if no answer will ever come."""


class WorkerPool(Workers):
    """``workers`` processes of this machine, one thread each, and as many behind them, when needed.

    The system chooses their cores, since other jobs may be there, too. Those behind are the least urgent to
    it: they have a core while nobody else wants it. Where there are GPUs, each process sees one.
    """

    def __init__(self, workers: int, environment: dict[str, str] | None = None) -> None:
        if workers < 0:
            raise ValueError(f"workers must be 0 or more, not {workers}")
        self.workers = workers
        # Threads of OpenBLAS spin: XLA's Cholesky is 300 times slower where cores are shared.
        self._environment = {"OPENBLAS_NUM_THREADS": "1", **(environment or {})}
        self._executors: dict[bool, ProcessPoolExecutor] = {}
        self._cores = Cores()

    def cpu_share(self) -> float:
        """Stop, and say what share of their cores was used since they opened, this process included."""
        self.close()  # what children have used is known when they have ended
        return self._cores.share(self.workers)

    def close(self) -> None:
        """Stop the processes at once; work under way is dropped."""
        for behind in list(self._executors):
            self._stop(behind)

    def _stop(self, behind: bool) -> None:
        executor = self._executors.pop(behind)
        for process in list((executor._processes or {}).values()):
            process.terminate()
        executor.shutdown(wait=True, cancel_futures=True)

    def _submit(
        self, function: Callable[..., Any], task: tuple, net: bool, first: Any, behind: bool
    ) -> Future:
        with _inherited(self._environment):  # processes start with a task
            try:
                return self._executor(behind).submit(function, *task)
            except BrokenProcessPool:  # one has died since; tasks under way say so themselves
                self._stop(behind)
                return self._executor(behind).submit(function, *task)

    def _executor(self, behind: bool) -> Executor:
        if behind not in self._executors:
            context = multiprocessing.get_context("spawn")
            self._executors[behind] = ProcessPoolExecutor(
                self.workers,
                mp_context=context,
                initializer=_start,
                initargs=(context.Value("i", 0), LEAST_URGENT if behind else 0),
            )
        return self._executors[behind]


def refuse_many_workers(flag: str, workers: int) -> None:
    """Raise UserError if so many processes need more memory than there is; names the flag."""
    refuse_larger(flag, workers, lambda count: count * PROCESS, "processes")


@contextmanager
def opened(workers: int | Workers) -> Iterator[Workers]:
    """A new pool of so many processes, closed in the end; or the workers themselves, which are left open."""
    if isinstance(workers, Workers):
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


def _start(counter: Any, nice: int) -> None:
    """Give each worker one thread and one GPU of its own, leave Ctrl-C to the parent, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with counter.get_lock():
        number = counter.value
        counter.value += 1
    import cv2  # the main process may have no use for it

    cv2.setNumThreads(1)
    if nice and hasattr(os, "nice"):
        os.nice(nice)
    gpus = _gpus()
    if gpus:
        os.environ["CUDA_VISIBLE_DEVICES"] = gpus[number % len(gpus)]


def _gpus() -> list[str]:
    """NVIDIA's GPUs that this process may use, as CUDA_VISIBLE_DEVICES names them."""
    named = os.environ.get("CUDA_VISIBLE_DEVICES")
    if named is not None:
        return [name for name in named.split(",") if name]
    return [str(k) for k, _ in enumerate(Path("/proc/driver/nvidia/gpus").glob("*"))]


def _end_with_parent() -> None:
    """A parent that was killed cannot stop its workers, who would wait for work for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
