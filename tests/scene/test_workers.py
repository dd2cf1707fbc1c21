"""Worker processes: answers by index, errors passed on, one death survived."""

import os
import signal
import time

import pytest

from scene.workers import WorkerError, WorkerPool


def square(x):
    return x * x


def fail(x):
    raise ValueError(f"cannot do {x}")


def die_until(path, deaths, x):
    """Kill this process the first ``deaths`` times that work ``x`` is tried."""
    if x == 2:
        with open(path, "a") as file:
            file.write(".")
        if os.path.getsize(path) <= deaths:
            os.kill(os.getpid(), signal.SIGKILL)
    return x * x


def surroundings():
    import cv2

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
    return cores, cv2.getNumThreads(), os.environ.get("SCENE_TEST"), os.getpid()


def sleep(seconds):
    time.sleep(seconds)
    return seconds


@pytest.mark.parametrize("workers", [0, 1, 2])
def test_every_task_is_answered_with_its_index_and_errors_are_passed_on(workers):
    with WorkerPool(workers) as pool:
        assert dict(pool.map(square, [(x,) for x in range(5)])) == {x: x * x for x in range(5)}
        assert list(pool.map(square, [])) == []
        with pytest.raises(ValueError, match="cannot do 3"):
            list(pool.map(fail, [(3,)]))
        assert list(pool.map(square, [(3,)])) == [(0, 9)]
    with pytest.raises(ValueError, match="0 or more, not -2"):
        WorkerPool(-2)


def test_work_of_a_killed_worker_is_done_again_with_the_same_answers(tmp_path):
    marker = tmp_path / "deaths"
    with WorkerPool(1) as pool:
        answers = list(pool.map(die_until, [(str(marker), 1, x) for x in range(4)]))
    assert sorted(answers) == [(x, x * x) for x in range(4)] and marker.stat().st_size == 2


def test_a_worker_killed_twice_is_an_error_that_says_what_to_try(tmp_path):
    marker = tmp_path / "deaths"
    with WorkerPool(1) as pool:
        with pytest.raises(WorkerError, match=r"died twice with [1-4] tasks left .*--workers"):
            list(pool.map(die_until, [(str(marker), 9, x) for x in range(4)]))
        assert marker.stat().st_size == 2
        assert list(pool.map(square, [(3,)])) == [(0, 9)]  # and it can be used again


def test_workers_have_one_core_and_the_environment_asked_for():
    with WorkerPool(1, {"SCENE_TEST": "yes"}) as pool:
        [(_, (cores, threads, value, pid))] = pool.map(surroundings, [()])
        assert (cores, threads, value) == (1, 1, "yes") and pid != os.getpid()
        assert list(pool.map(surroundings, [()])) == [(0, (1, 1, "yes", pid))]  # long-lived
    assert "SCENE_TEST" not in os.environ


def test_leaving_early_drops_the_work_under_way():
    started = time.monotonic()
    with WorkerPool(1) as pool:
        for index, answer in pool.map(sleep, [(0,), (60,)]):
            assert (index, answer) == (0, 0)
            break
    assert time.monotonic() - started < 30
