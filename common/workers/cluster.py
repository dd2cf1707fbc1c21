"""Workers of a Dask cluster on any number of machines, which may come and go.

A task whose worker dies goes to another one. Files that tasks name are sent to every worker once, also to
those that come later, so that no disk need be shared; see ``docs/cluster.md``.
"""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
from distributed import Client, KilledWorker, WorkerPlugin

from common.errors import UserError
from common.files import files_below, folder_digest
from common.sent import received
from common.workers.pool import WorkerError, Workers

PATIENCE = 10.0
"""Time limit of a scheduler's answer, in seconds."""
PIECE = 64 * 2**20
"""Bytes of a file in one message."""
TRIES = 5
"""Number of attempts to send something while workers die."""
Versions = Callable[[], Mapping[str, int | str]]
"""Gives the versions of libraries in its process, by name."""
_ONE_AT_A_TIME = threading.Lock()


class Cluster(Workers):
    """The workers of a Dask scheduler.

    If any worker announced the resource ``GPU`` when the run began, those with ``GPU=1`` are trainers. Other
    work needs ``CPU=1``, if any worker announced that.

    Args:
        address: address of the scheduler, such as ``tcp://10.0.0.1:8786``.
        environment: variables that workers get before they import JAX.
        versions: gives what must be the same in workers as in this process; by default nothing.

    Raises:
        UserError: nobody answers at the address.
    """

    share_disk = False
    _patience = 1.0

    def __init__(
        self,
        address: str,
        environment: dict[str, str] | None = None,
        versions: Versions = dict,
    ) -> None:
        self._versions = versions
        for name in ("distributed", "distributed.client", "distributed.core", "distributed.comm"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # we report errors in one line
        self._address = address
        self._names: dict[str, str] = {}
        self._plugins: list[str] = []
        try:
            self._client = Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise UserError(
                f"--scheduler {address}: no Dask scheduler answers there ({error}); start one with "
                "'dask scheduler', which prints its address"
            ) from None
        self.dashboard = self._client.dashboard_link
        self._register(_Prepared(environment or {}), "sdr-jax environment")
        if not self._client.nthreads():
            print(
                f"Waiting for workers of {address}: dask worker {address} --nthreads 1", flush=True
            )
            self._client.wait_for_workers(1)
        self.workers = len(self._client.nthreads())
        gpus, cpus = self._announced("GPU"), self._announced("CPU")
        if gpus:
            self.trainers = gpus
            self.workers = cpus or self.workers
        self._renderer_resources = {"CPU": 1} if cpus else None
        self._executor = self._client.get_executor(pure=False)

    def _announced(self, resource: str) -> int:
        """The number of workers that have announced a resource."""
        workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        return sum(resource in worker["resources"] for worker in workers)

    def close(self) -> None:
        """Drop unfinished work, and leave the cluster as it was except for copies of files."""
        self._close_pipeline()
        with suppress(Exception):  # the scheduler may be gone
            while self._plugins and self._client.status == "running":
                self._client.unregister_worker_plugin(self._plugins.pop())
        with suppress(Exception):
            self._client.close(timeout=2)

    def share(self, path: str) -> str:
        """Send a file or folder to all present and later workers; returns its name for tasks.

        Raises:
            UserError: the scheduler is gone.
        """
        root = Path(path).absolute()
        if path and (root.exists() or path not in self._names):
            name = f"{folder_digest(root)[:16]}/{root.name}"
            if name not in self._names.values():
                self._send(root, name)
                received(name, root)  # this process uses the same name
            self._names[path] = name
        return self._names.get(path, path)

    def _send(self, root: Path, name: str) -> None:
        for file in files_below(root) if root.is_dir() else [root]:
            relative_path = "" if file == root else file.relative_to(root).as_posix()
            for start, piece in _pieces(file):
                piece_plugin = _Piece(name, relative_path, start, piece)
                self._register(piece_plugin, f"{self._client.id} {name} {relative_path} {start}")

    def _register(self, plugin: WorkerPlugin, name: str) -> None:
        for attempt in range(TRIES):
            try:
                self._client.register_plugin(plugin, name=name)
                break
            except OSError:  # a worker died, or the scheduler
                if attempt == TRIES - 1 or self._client.status != "running":
                    raise self._lost() from None
        self._plugins.append(name)

    def trainers_now(self) -> int:
        """The number of trainers, which come and go; without one, a task waits for the next."""
        with suppress(OSError):  # the scheduler is gone, which the main thread finds, too
            return max(self._announced("GPU"), 1)
        return 1

    def begin_part(self, function: Callable[..., Any], task: tuple, behind: bool) -> Any:
        """Begin a part of a network on a renderer; its result stays there until a trainer needs it."""
        return self._client.submit(
            *self._called(function, task), **self._options(trains=False, behind=behind), pure=False
        )

    def part_result(self, part: Any) -> Any:
        """The future itself, whose result the trainer gets from the renderer."""
        return part

    def _submit(
        self, function: Callable[..., Any], task: tuple, *, trains: bool = False, behind: bool
    ) -> Future:
        return self._executor.submit(
            *self._called(function, task), **self._options(trains=trains, behind=behind)
        )

    def _called(self, function: Callable[..., Any], task: tuple) -> tuple:
        return (_alone, self._versions, dict(self._versions()), function, *task)

    def _options(self, *, trains: bool, behind: bool) -> dict[str, Any]:
        """Resources and priority of work."""
        gpu = {"GPU": 1} if self.trainers is not None else None
        resources = gpu if trains else self._renderer_resources
        return {"resources": resources, "priority": -1 if behind else 0}

    def result(self, future: Future) -> Any:
        """The result of finished work."""
        try:
            return future.result()
        except KilledWorker as error:
            raise WorkerError(
                f"{error.allowed_failures + 1} workers of --scheduler {self._address} died over one "
                "task (out of memory, or killed?); give each of them more memory"
            ) from error
        except CancelledError:
            raise self._lost() from None

    def _drop(self, futures: Iterable[Future]) -> None:
        futures = list(futures)
        if self._pipeline is not None:
            self._pipeline.drop(futures)
        for future in futures:
            future.cancel()

    def _refuse_lost(self) -> None:
        if self._client.status != "running":
            raise self._lost()

    def _lost(self) -> UserError:
        return UserError(
            f"--scheduler {self._address}: the scheduler is gone; what was finished is saved, and the "
            "same command resumes"
        )


class _Prepared(WorkerPlugin):
    """Sets up a worker like our own processes: one thread per library, compiled functions kept."""

    def __init__(self, environment: dict[str, str]) -> None:
        self._environment = environment

    def setup(self, worker: Any) -> None:
        os.environ.update({"OPENBLAS_NUM_THREADS": "1", **self._environment})
        cv2.setNumThreads(1)


class _Piece(WorkerPlugin):
    """A part of a file, which a worker writes into its own folder."""

    def __init__(self, name: str, relative_path: str, start: int, piece: bytes) -> None:
        self._name, self._relative_path, self._start, self._piece = (
            name,
            relative_path,
            start,
            piece,
        )

    def setup(self, worker: Any) -> None:
        root = Path(worker.local_directory) / "sent" / self._name
        file = root / self._relative_path
        file.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(file, os.O_WRONLY | os.O_CREAT, 0o600)
        try:
            os.pwrite(descriptor, self._piece, self._start)
        finally:
            os.close(descriptor)
        self._piece = b""
        received(self._name, root)


def _alone(
    versions: Versions, expected: Mapping[str, int | str], function: Callable[..., Any], *task: Any
) -> Any:
    """Do the work of a task, one at a time; runs in a worker, which must have the same versions."""
    own_versions = versions()
    for name, value in expected.items():
        if own_versions.get(name) != value:
            raise UserError(
                f"a worker of the cluster has {name} {own_versions.get(name)}, this program {value}: install "
                "the same version on both"
            )
    with _ONE_AT_A_TIME:
        return function(*task)


def _pieces(file: Path) -> Iterator[tuple[int, bytes]]:
    """The pieces of a file with their offsets; an empty file has one empty piece."""
    with file.open("rb") as opened:
        start, piece = 0, opened.read(PIECE)
        yield start, piece
        while len(piece) == PIECE:
            start, piece = start + PIECE, opened.read(PIECE)
            yield start, piece
