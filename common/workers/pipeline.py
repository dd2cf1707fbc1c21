"""Work that two kinds of workers share: renderers prepare tasks, trainers with a device finish them.

`Workers` have a pipeline if their trainers are apart. It renders ahead of the trainers, and gives a trainer
all tasks at once that are ready and alike.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterable, Sequence
from concurrent.futures import CancelledError, Future, InvalidStateError
from contextlib import suppress
from functools import partial
from queue import SimpleQueue
from typing import Any, NamedTuple, Protocol

AHEAD = 2
"""Tasks per renderer that are being prepared or wait for a trainer."""
MOST = 32
"""The most tasks that a trainer gets at once."""


class Split(NamedTuple):
    """How a task is divided between renderers and trainers.

    The trainer calls ``function(*task, ready=results)`` with the results of the parts in order, or
    ``function(*task)`` if the task has no parts.
    """

    parts: Callable[[int, tuple], Sequence[tuple]]
    """Gives at most so many parts of a task: arguments of `render`. It is called in this process."""
    render: Callable[..., Any]
    """Prepares a part, on a renderer."""
    alike: Callable[[tuple], Hashable] | None = None
    """Tasks with the same value may go to a trainer together; by default each goes alone."""
    many: Callable[[Sequence[tuple], Sequence[Sequence[Any]]], Sequence[Any]] | None = None
    """The results of several tasks that are alike, from the tasks and the results of their parts; by default
    the trainer calls ``function`` for one after the other."""


class Stages(Protocol):
    """The workers behind a pipeline."""

    workers: int

    def trainers_now(self) -> int:
        """The number of trainers, which may change."""

    def begin_part(self, function: Callable[..., Any], task: tuple, behind: bool) -> Any:
        """Begin a part on a renderer; returns its future."""

    def begin_training(self, function: Callable[..., Any], task: tuple, behind: bool) -> Future:
        """Begin work on a trainer."""

    def part_result(self, part: Any) -> Any:
        """The result of a part's future, as a trainer gets it."""


class _Part(NamedTuple):
    arguments: tuple
    future: Any


class _Item:
    """A task on its way."""

    def __init__(
        self, function: Callable[..., Any], task: tuple, split: Split | None, behind: bool
    ) -> None:
        self.function, self.task, self.split, self.behind = function, task, split, behind
        self.future: Future = Future()
        self.parts: list[_Part] = []
        self.unprepared = 0  # number of parts that are not done
        alike = None if split is None else split.alike
        self.alike: Hashable = id(self) if alike is None else alike(task)


class Pipeline:
    """Tasks that wait, are prepared, are ready or are with a trainer; one thread moves them along.

    Urgent tasks overtake those *behind* them at each step.
    """

    def __init__(self, stages: Stages) -> None:
        self._stages = stages
        self._waiting: list[_Item] = []
        self._preparing: list[_Item] = []
        self._ready: list[_Item] = []
        self._training: dict[Future, list[_Item]] = {}
        self._events: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def submit(
        self,
        function: Callable[..., Any],
        tasks: Iterable[tuple],
        split: Split | None,
        behind: bool,
    ) -> list[Future]:
        """Accept tasks; returns the futures of their results."""
        items = [_Item(function, task, split, behind) for task in tasks]
        self._events.put(lambda: self._waiting.extend(items))
        return [item.future for item in items]

    def hurry(self, future: Future) -> None:
        """Make a task urgent."""
        self._events.put(partial(self._hurry, future))

    def drop(self, futures: Iterable[Future]) -> None:
        """Drop tasks that are not finished."""
        self._events.put(partial(self._drop, set(futures)))

    def close(self) -> None:
        """Drop all tasks that are not finished, and end the thread; the workers stay as they are."""
        self._events.put(None)
        self._thread.join()

    def _work(self) -> None:
        while (event := self._events.get()) is not None:
            try:
                event()
                self._prepare_next()
                self._train_next()
            except BaseException as error:
                # No worker can be started, or a task cannot be divided.
                self._fail(self._unfinished(), error)
        self._fail(self._unfinished(), CancelledError())

    def _unfinished(self) -> list[_Item]:
        training = [item for items in self._training.values() for item in items]
        return [*self._waiting, *self._preparing, *self._ready, *training]

    def _prepare_next(self) -> None:
        """Begin waiting tasks, urgent ones first, as far ahead of the trainers as is allowed."""
        for item in sorted(self._waiting, key=lambda item: item.behind):
            ahead = [n for n in (*self._preparing, *self._ready) if n.behind <= item.behind]
            if len(ahead) >= AHEAD * self._stages.workers:
                return
            if item.split is not None:
                rivals = sum(n.behind <= item.behind for n in (*self._waiting, *self._preparing))
                most = -(-self._stages.workers // rivals)  # with fewer, renderers would be idle
                item.parts = [self._begin(item, part) for part in item.split.parts(most, item.task)]
            item.unprepared = len(item.parts)
            self._waiting.remove(item)
            (self._preparing if item.parts else self._ready).append(item)

    def _begin(self, item: _Item, arguments: tuple) -> _Part:
        assert item.split is not None
        future = self._stages.begin_part(item.split.render, arguments, item.behind)
        future.add_done_callback(lambda done: self._events.put(partial(self._prepared, item, done)))
        return _Part(arguments, future)

    def _prepared(self, item: _Item, done: Any) -> None:
        """Note that a part is done."""
        if item not in self._preparing or all(part.future is not done for part in item.parts):
            return  # the task was dropped, or another renderer has the part
        if error := _error(done):
            self._fail([item], error)
            return
        item.unprepared -= 1
        if not item.unprepared:
            self._preparing.remove(item)
            self._ready.append(item)

    def _train_next(self) -> None:
        """Give idle trainers the first task that is ready, and all that are like it, in equal shares."""
        idle = self._stages.trainers_now() - len(self._training) if self._ready else 0
        if idle <= 0:
            return
        in_order = sorted(self._ready, key=lambda item: item.behind)
        alike = [item for item in in_order if item.alike == in_order[0].alike]
        items = alike[: min(MOST, -(-len(alike) // idle))]
        results = [[self._stages.part_result(part.future) for part in item.parts] for item in items]
        first, tasks = items[0], [item.task for item in items]
        many = None if first.split is None else first.split.many
        future = self._stages.begin_training(
            trained, (first.function, many, tasks, results), first.behind
        )
        self._training[future] = items
        self._ready = [item for item in self._ready if item not in items]
        future.add_done_callback(lambda done: self._events.put(partial(self._trained, done)))
        self._train_next()

    def _trained(self, done: Future) -> None:
        """Pass on the results of a trainer."""
        items = self._training[done]
        if error := _error(done):
            self._fail(items, error)
        else:
            for item, result in zip(items, done.result(), strict=True):
                with suppress(InvalidStateError):  # it was dropped
                    item.future.set_result(result)
        del self._training[done]

    def _hurry(self, future: Future) -> None:
        for item in self._unfinished():
            if item.future is future and item.behind:
                item.behind = False
                for number, part in enumerate(item.parts):
                    if item in self._preparing and part.future.cancel():
                        item.parts[number] = self._begin(item, part.arguments)

    def _drop(self, futures: set[Future]) -> None:
        dropped = [item for item in self._unfinished() if item.future in futures]
        self._fail(dropped, CancelledError())
        for future, items in self._training.items():
            if all(item in dropped for item in items):
                future.cancel()

    def _fail(self, items: Iterable[_Item], error: BaseException) -> None:
        """Finish tasks with an error."""
        for item in items:
            for stage in (self._waiting, self._preparing, self._ready):
                if item in stage:
                    stage.remove(item)
            for part in item.parts:
                part.future.cancel()
            with suppress(InvalidStateError):
                item.future.set_exception(error)


def _error(done: Any) -> BaseException | None:
    """The error with which work ended, if it did."""
    error: BaseException | None = CancelledError() if done.cancelled() else done.exception()
    return error


def trained(
    function: Callable[..., Any],
    many: Callable[..., Sequence[Any]] | None,
    tasks: Sequence[tuple],
    results: Sequence[Sequence[Any]],
) -> Sequence[Any]:
    """Finish tasks with the results of their parts; runs on a trainer."""
    if many is not None:
        return many(tasks, results)
    return [
        function(*task, ready=parts) if parts else function(*task)
        for task, parts in zip(tasks, results, strict=True)
    ]
