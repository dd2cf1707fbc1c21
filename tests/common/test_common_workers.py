"""Worker processes: answers by index, errors passed on, one death survived."""

import gc
import os
import signal
import time
import weakref
from concurrent.futures import CancelledError, Future

import pytest

from common.errors import UserError
from common.workers import pool
from common.workers.pipeline import Split
from common.workers.pool import LESS_URGENT, WorkerError, WorkerPool, cores, gpus
from tests.conftest import refused
from tests.tasks import (
    die_until,
    die_with_parts,
    doubled,
    fail,
    gathered,
    gathered_at,
    ready_and,
    reports_and_waits,
    square,
    surroundings,
    wait_for,
)


@pytest.mark.parametrize("workers", [0, 1, 2])
def test_every_task_is_answered_with_its_index_and_errors_are_passed_on(workers):
    with WorkerPool(workers) as pool:
        assert dict(pool.map(square, [(x,) for x in range(5)])) == {x: x * x for x in range(5)}
        assert list(pool.map(square, [])) == []
        refused(UserError, "cannot do 3", list, pool.map(fail, [(3,)]))
        assert list(pool.map(square, [(3,)])) == [(0, 9)]
    refused(ValueError, "0 or more, not -2", WorkerPool, -2)


def test_work_of_a_killed_worker_is_done_again_but_of_one_killed_twice_is_an_error(tmp_path):
    once, always = tmp_path / "once", tmp_path / "always"
    with WorkerPool(1) as pool:
        answers = list(pool.map(die_until, [(str(once), 1, x) for x in range(4)]))
        assert sorted(answers) == [(x, x * x) for x in range(4)] and once.stat().st_size == 2
        with pytest.raises(WorkerError, match=r"died twice with [1-4] tasks left .*--workers"):
            list(pool.map(die_until, [(str(always), 9, x) for x in range(4)]))
        assert always.stat().st_size == 2
        assert list(pool.map(square, [(3,)])) == [(0, 9)]  # and it can be used again


def test_a_worker_that_dies_between_two_tasks_is_replaced():
    with WorkerPool(1) as pool:
        for behind in (False, True):
            pid = pool.begin(os.getpid, behind=behind).result()
            os.kill(pid, signal.SIGKILL)
            executor = pool._executors["behind" if behind else "workers"]
            while not executor._broken:
                time.sleep(0.01)
            started = {0: pool.begin(square, 2)} if behind else {}
            answers = pool.map(square, [(2,), (3,)], started=started)
            assert sorted(answers) == [(0, 4), (1, 9)]


def test_requested_work_that_still_waits_behind_other_work_is_urgent(tmp_path):
    with WorkerPool(1) as pool:
        gate = tmp_path / "gate"
        blocked = [pool.begin(wait_for, str(gate)) for _ in range(3)]  # one waits for its process
        future = pool.begin(os.getpriority, os.PRIO_PROCESS, 0)
        answer = pool.map(os.getpriority, [(os.PRIO_PROCESS, 0)], started={0: future})
        assert list(answer) == [(0, os.getpriority(os.PRIO_PROCESS, 0))]
        assert future.cancelled() and not blocked[0].done()
        gate.touch()
        assert list(pool.map(wait_for, [(str(gate),)], started={0: blocked[0]})) == [(0, None)]


def test_urgent_work_that_was_begun_keeps_its_place(tmp_path):
    with WorkerPool(1) as pool:
        gate = tmp_path / "gate"
        blocked = [pool.begin(wait_for, str(gate), behind=False) for _ in range(3)]
        future = pool.begin(square, 3, behind=False)
        assert not pool._taken_back(future) and not future.cancelled() and not blocked[0].done()
        gate.touch()
        assert list(pool.map(square, [(3,)], started={0: future})) == [(0, 9)]
        assert all(work.done() for work in blocked)


def test_workers_have_one_thread_one_gpu_their_environment_and_leaving_early_drops_the_work():
    with WorkerPool(1, {"SCENE_TEST": "yes", "CUDA_VISIBLE_DEVICES": "5,7"}) as pool:
        [(_, (*settings, pid))] = pool.map(surroundings, [()])
        assert settings[1:] == ["1", 1, "5", "yes"]
        # Two jobs would give their first workers the same one.
        assert settings[0] is None or settings[0] == os.sched_getaffinity(0)
        assert pid != os.getpid()
        assert list(pool.map(surroundings, [()])) == [(0, (*settings, pid))]  # long-lived
        behind = pool.begin(os.getpriority, os.PRIO_PROCESS, 0).result()
        assert behind == min(os.getpriority(os.PRIO_PROCESS, 0) + LESS_URGENT, 19)
        assert 0 < pool.cpu_share() < 2
    assert "SCENE_TEST" not in os.environ
    started = time.monotonic()
    with WorkerPool(1) as pool:
        assert next(iter(pool.map(time.sleep, [(0,), (60,)]))) == (0, None)
    assert time.monotonic() - started < 30


@pytest.mark.parametrize(("visible", "names"), [
    ("0,1", ["0", "1"]), ("", []), ("-1", []), ("2, -1,3", ["2"]), ("NoDevFiles", []),
    ("GPU-8932f937,MIG-GPU-8932f937/1/2", ["GPU-8932f937", "MIG-GPU-8932f937/1/2"]),
])  # fmt: skip
def test_the_first_name_of_no_gpu_ends_the_list(visible, names, monkeypatch):
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", visible)
    assert gpus() == names


def test_all_cores_count_where_a_system_cannot_bind_a_process_to_some(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {3, 5}, raising=False)
    assert cores() == 2
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 12)
    assert cores() == 12


TWICE = Split(lambda most, task: [task[-1:]] * min(most, 2), doubled)
"""Renders a task's last argument in two parts, where two renderers would be idle otherwise."""


def test_renderers_prepare_the_parts_of_a_task_for_a_trainer():
    environment = {"CUDA_VISIBLE_DEVICES": "5,7"}
    with WorkerPool(2, environment, trainers=2) as pool:
        assert dict(pool.map(ready_and, [(3,)], net=True, split=TWICE)) == {0: (3, [6, 6])}
        answers = dict(pool.map(ready_and, [(k,) for k in range(9)], net=True, split=TWICE))
        assert {k: answer[1][0] for k, answer in answers.items()} == {k: 2 * k for k in range(9)}
        assert list(
            pool.map(square, [(3,)], net=True, split=TWICE._replace(parts=lambda *_: []))
        ) == [(0, 9)]
        refused(UserError, "cannot do 3", list, pool.map(fail, [(3,)], net=True))
        failing = TWICE._replace(render=fail)
        refused(UserError, "cannot do 3", list, pool.map(square, [(3,)], net=True, split=failing))
        refused(ZeroDivisionError, "", list, pool.map(
            square, [(3,)], net=True, split=TWICE._replace(parts=lambda *_: 1 // 0)))  # fmt: skip
        kinds = [
            {answer[3:] for _, answer in pool.map(surroundings, [()] * 40, net=net)}
            for net in (False, True)
        ]
        renderers, trainers = ({pid for *_, pid in kind} for kind in kinds)
        assert not renderers & trainers and {gpu for gpu, *_ in kinds[0]} == {""}
        assert {gpu for gpu, *_ in kinds[1]} <= {"5", "7"} and len(trainers) <= 2
    with WorkerPool(1) as pool:  # where one process does both
        assert list(pool.map(ready_and, [(3,)], net=True, split=TWICE)) == [(0, (3, None))]


@pytest.mark.parametrize("kind", ["renderer", "trainer"])
def test_a_killed_renderer_or_trainer_is_replaced_once(kind, tmp_path):
    once, always = tmp_path / "once", tmp_path / "always"

    def made(pool, path, deaths):
        tasks = [(str(path), deaths, x) for x in range(4)]
        if kind == "renderer":
            return pool.map(
                gathered,
                tasks,
                net=True,
                split=Split(lambda _, task: [task], die_until, many=gathered),
            )
        return pool.map(die_with_parts, tasks, net=True, split=TWICE)

    with WorkerPool(1, trainers=1) as pool:
        answers = {index: answer[-3:] for index, answer in made(pool, once, 1)}
        assert sorted(answers) == [0, 1, 2, 3] and once.stat().st_size == 2
        if kind == "trainer":
            assert answers == {x: (x * x, [2 * x]) for x in range(4)}
        else:
            assert answers == {x: (x, [x * x], 1) for x in range(4)}
        with pytest.raises(WorkerError, match=r"died twice with [1-4] tasks left .*--workers"):
            list(made(pool, always, 9))
        assert always.stat().st_size == 2
        assert list(pool.map(square, [(3,)], net=True)) == [(0, 9)]


def test_a_trainer_gets_all_tasks_at_once_that_are_ready_and_alike(tmp_path):
    gates = [str(tmp_path / name) for name in "ab"]
    split = Split(lambda _, task: [task[1:]], doubled, lambda task: task[1] % 2, gathered_at)
    with WorkerPool(2, trainers=1) as pool:
        first = pool.begin(square, gates[0], 1, split=split._replace(alike=None), behind=False)
        while not pool._pipeline._training:  # or the trainer may get another task before it
            time.sleep(0.01)
        others = [pool.begin(square, gates[1], x, split=split) for x in range(2, 6)]
        behind = pool.begin(square, gates[1], 7, split=split)
        for count in (4, 5):  # so many are prepared ahead of urgent work
            while len(pool._pipeline._ready) < count:
                time.sleep(0.01)
            if count == 4:
                pool._taken_back(behind)  # as a request does
        assert not any(future.done() for future in (first, *others, behind))
        for gate in gates:
            open(gate, "w").close()
        assert first.result() == (1, 1) and behind.result() == (7, 3)
        assert [future.result() for future in others] == [(2, 2), (3, 3), (4, 2), (5, 3)]


def test_dropped_work_of_trainers_ends_and_the_next_begins():
    with WorkerPool(1, trainers=1) as pool:
        answers = pool.map(time.sleep, [(0,), (60,), (60,)], net=True)
        assert next(iter(answers))[0] == 0
        waiting = pool.begin(square, 3, split=TWICE)
        answers.close()  # as when an error ends the job
        assert waiting.done() and isinstance(waiting.exception(), CancelledError)
        assert list(pool.map(square, [(3,)], net=True)) == [(0, 9)]


@pytest.mark.parametrize("trainers", [None, 1])
def test_work_under_way_is_seen_before_its_result(tmp_path, monkeypatch, trainers):
    monkeypatch.setattr(pool, "TICK", 0.05)
    file, seen = tmp_path / "file", []

    def watch(units: float) -> None:
        seen.append(units)
        if units == 4.0:
            file.touch()

    with WorkerPool(2, trainers=trainers) as workers:
        workers.watch = watch
        net = {"net": True} if trainers else {}
        tasks = [(str(file),)] * 2
        if trainers:  # which works on one of them
            monkeypatch.setattr(workers, "watch", lambda units: watch(2 * units))
        assert [result for _, result in workers.map(reports_and_waits, tasks, **net)] == [None] * 2
        assert workers.under_way() == 0 and 4.0 in seen
    assert workers.under_way() == 0  # of no process


def test_a_result_that_was_taken_is_not_kept(monkeypatch):
    taken: list[weakref.ref[Future]] = []
    result = WorkerPool.result

    def seen(self, future):
        taken.append(weakref.ref(future))
        return result(self, future)

    monkeypatch.setattr(WorkerPool, "result", seen)
    with WorkerPool(1) as workers:
        answers = workers.map(square, [(x,) for x in range(20)])
        for _ in range(10):
            next(answers)
        gc.collect()
        assert sum(future() is not None for future in taken) <= 2
        assert len(list(answers)) == 10


def test_work_that_a_dead_worker_has_dropped_begins_again(tmp_path):
    """A network begins, a worker dies before it is requested, and a request still gets its result."""
    with WorkerPool(1, trainers=1) as workers:
        model = workers.begin(square, 3, behind=False)
        assert model.result() == 9
        waiting = workers.begin(wait_for, str(tmp_path / "never"), behind=False)
        once = str(tmp_path / "once")
        assert list(workers.map(die_until, [(once, 1, 2)])) == [(0, 4)]
        assert isinstance(waiting.exception(), CancelledError)
        assert list(workers.map(square, [(3,), (4,)], net=True, started={0: waiting})) == [
            (0, 9), (1, 16)
        ]  # fmt: skip
