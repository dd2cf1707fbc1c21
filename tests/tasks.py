"""Functions that tests send to worker processes, which import this file and not all that tests need."""

import os
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from common.errors import UserError
from common.lines import JsonLines
from common.sent import here
from common.workers.under_way import ending_report, report


def square(x):
    return x * x


def fail(x):
    raise UserError(f"cannot do {x}")


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

    cores = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
    gpu = os.environ.get("CUDA_VISIBLE_DEVICES")
    threads = os.environ["OPENBLAS_NUM_THREADS"]
    return cores, threads, cv2.getNumThreads(), gpu, os.environ.get("SCENE_TEST"), os.getpid()


def loaded(*names):
    """Which of these modules this process has loaded."""
    return {name for name in names if name in sys.modules}


def wait_for(path: str) -> None:
    while not os.path.exists(path):
        time.sleep(0.01)


def told(name, seconds):
    """What a worker reads under a name, and which worker it is."""
    time.sleep(seconds)
    root = here(name)
    texts = sorted(p.read_text() for p in root.rglob("*") if p.is_file())
    return texts, str(root), os.environ.get("SCENE_TEST"), os.getpid()


def ready_and(x, ready=None):
    return x, ready


def gathered(tasks, ready):
    """Of each of several tasks: its argument, the results of its parts, and the number of the tasks."""
    return [(*task, parts, len(tasks)) for task, parts in zip(tasks, ready, strict=True)]


def gathered_at(tasks, ready):
    """The same, when the files exist that the tasks name."""
    for name, _ in tasks:
        wait_for(name)
    return [(x, len(tasks)) for _, x in tasks]


def doubled(x):
    return 2 * x


def die_with_parts(path, deaths, x, ready):
    return die_until(path, deaths, x), ready


def add_many(path: Path, name: str, ready: Any) -> None:
    log = JsonLines(path)
    ready.wait(60)
    for k in range(20):
        with log.shared():
            time.sleep(0.002)  # for the other one to step in, were it not for the lock
            log.append({"name": name, "k": k}, {"after": [name, k]})


def add_alone(path, name, ready, counts):
    log = JsonLines(path)
    ready.wait(60)
    for k in range(150):
        log.refresh()
        with suppress(RuntimeError):  # the other one was faster: nothing is written
            log.append({"name": name, "k": k})
            counts.put(name)
    counts.put(None)


def reports_and_waits(path: str) -> None:
    """Report two units of work, then wait until a file exists."""
    with ending_report():
        report(2.0)
        while not Path(path).exists():
            time.sleep(0.01)
