"""Worker processes: answers by index, errors passed on, one death survived."""

import os
import signal
import time

import pytest

from common.errors import UserError
from common.workers.pool import LESS_URGENT, WorkerError, WorkerPool
from tests.conftest import refused
from tests.tasks import die_until, fail, square, surroundings, wait_for


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
            executor = pool._executors[behind]
            while not executor._broken:
                time.sleep(0.01)
            begun = {0: pool.begin(square, 2)} if behind else {}
            answers = pool.map(square, [(2,), (3,)], begun=begun)
            assert sorted(answers) == [(0, 4), (1, 9)]


def test_requested_work_that_still_waits_behind_other_work_is_urgent(tmp_path):
    with WorkerPool(1) as pool:
        gate = tmp_path / "gate"
        blocked = [pool.begin(wait_for, str(gate)) for _ in range(3)]  # one waits for its process
        asked = pool.begin(os.getpriority, os.PRIO_PROCESS, 0)
        answer = pool.map(os.getpriority, [(os.PRIO_PROCESS, 0)], begun={0: asked})
        assert list(answer) == [(0, os.getpriority(os.PRIO_PROCESS, 0))]
        assert asked.cancelled() and not blocked[0].done()
        gate.touch()
        assert list(pool.map(wait_for, [(str(gate),)], begun={0: blocked[0]})) == [(0, None)]


def test_workers_have_one_thread_one_gpu_their_environment_and_leaving_early_drops_the_work():
    with WorkerPool(1, {"SCENE_TEST": "yes", "CUDA_VISIBLE_DEVICES": "5,7"}) as pool:
        [(_, (*own, pid))] = pool.map(surroundings, [()])
        assert own[1:] == ["1", 1, "5", "yes"]
        # Two jobs would give their first workers the same one.
        assert own[0] is None or own[0] == os.sched_getaffinity(0)
        assert pid != os.getpid()
        assert list(pool.map(surroundings, [()])) == [(0, (*own, pid))]  # long-lived
        behind = pool.begin(os.getpriority, os.PRIO_PROCESS, 0).result()
        assert behind == min(os.getpriority(os.PRIO_PROCESS, 0) + LESS_URGENT, 19)
        assert 0 < pool.cpu_share() < 2
    assert "SCENE_TEST" not in os.environ
    started = time.monotonic()
    with WorkerPool(1) as pool:
        assert next(iter(pool.map(time.sleep, [(0,), (60,)]))) == (0, None)
    assert time.monotonic() - started < 30
