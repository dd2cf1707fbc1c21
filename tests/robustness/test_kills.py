"""Processes killed at random moments, disks that fill, folders that two want, files that vanish."""

import os
import shutil
import signal
import subprocess
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import gone
from tests.experiments.test_main_job import children
from tests.robustness.conftest import NAMES, PROGRAMS, TIMES, end

pytestmark = pytest.mark.robust
STAGES = list(enumerate(np.linspace(0.05, 0.95, max(TIMES // 4, 2))))


def finished(process):
    """What a process says that ends well: nothing."""
    assert (process.communicate(timeout=900)[1], process.returncode) == ("", 0)


def refused(code, error, words):
    """The command ended with one line that has these words; JAX may warn of its own cache before it."""
    *warnings, last = error.splitlines()
    assert code == 2 and words in last, error
    assert all(
        "persistent compilation cache" in line or "warnings.warn" in line for line in warnings
    ), error


def goes_on(own, row, out):
    """The same command ends with the same answer; notes what was kept and is lost."""
    kept = own.program.kept(out)
    assert own.program.finish(out) == (0, "")
    lost = 0 if own.program.name == "export" else len(kept - own.program.kept(out))
    row.lost["finished evaluations"] += lost
    assert own.program.answer(out) == own.answer


def well_under_way(program, out):
    """A process of the program that has kept two pieces of its work, and goes on."""
    process = program.start(out)
    while len(program.kept(out)) < 2:
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.002)
    return process


@pytest.mark.parametrize("name", NAMES)
def test_the_main_process_is_killed(name, whole, tally, tmp_path):
    """Again and again in one folder, until it is finished; then in a new one."""
    own, program = whole(name), PROGRAMS[name]
    row, rng = tally(f"kill -9 of the main process: {name}"), np.random.default_rng(1)
    out, killed, kept = tmp_path / "0", 0, set()
    while killed < TIMES:
        process = program.start(out)
        workers: list[int] = []
        until = time.monotonic() + rng.uniform(0, own.seconds)
        while time.monotonic() < until and process.poll() is None:
            workers = children(process.pid) or workers
            time.sleep(0.01)
        if process.poll() is not None:
            finished(process)
            assert program.answer(out) == own.answer
            out, kept = tmp_path / f"{killed}", set()
            continue
        with row.attempt():
            process.kill()
            process.communicate()
            assert all(gone(pid) for pid in workers)
            killed += 1
            now = program.kept(out)
            row.lost["finished evaluations"] += len(kept - now)
            assert kept <= now
            kept = now
    with row.attempt():
        goes_on(own, row, out)


@pytest.mark.parametrize("name", ["run", "trainers", "export"])
def test_a_worker_is_killed(name, whole, tally, tmp_path):
    own, program = whole(name), PROGRAMS[name]
    row, rng = tally(f"kill -9 of a worker: {name}"), np.random.default_rng(2)
    for number in range(max(TIMES // 4, 1)):
        with row.attempt():
            out = tmp_path / str(number)
            process = program.start(out)
            try:
                time.sleep(rng.uniform(0.3, 0.9) * own.seconds)
                # Beside workers there is a process that tracks what they share.
                workers = [p for p in children(process.pid) if b"spawn_main" in _command(p)]
                if workers:  # with trainers: a renderer or a trainer
                    os.kill(workers[number % len(workers)], signal.SIGKILL)
                finished(process)
                assert program.answer(out) == own.answer
            finally:
                end(process)


def _command(pid: int) -> bytes:
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    return b""


@contextmanager
def disk(folder: Path, size: int):
    """A disk of so many bytes, or a skip where none can be made."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("a small disk needs root: mount -t tmpfs; files that may not grow are tried")
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.mark.parametrize("name", NAMES)
def test_no_file_may_grow_beyond_a_quota(name, whole, tally, tmp_path):
    """What can be had without root: a limit to the size of each file, up to that of the largest."""
    own, row = whole(name), tally(f"a quota for files: {name}")
    for number, share in STAGES:
        out = tmp_path / str(number)
        with row.attempt():
            refused(*own.program.finish(out, int(share * own.largest)), "too large")
            goes_on(own, row, out)


@pytest.mark.parametrize("name", NAMES)
def test_the_disk_is_full_at_every_stage(name, whole, tally, tmp_path):
    own, row = whole(name), tally(f"the disk is full: {name}")
    for number, share in STAGES:
        folder = tmp_path / str(number)
        with disk(folder, max(int(share * own.size) // 4096, 2) * 4096), row.attempt():
            refused(*own.program.finish(folder / "out"), "")
            room = ["mount", "-o", f"remount,size={64 * own.size}", str(folder)]
            subprocess.run(room, check=True)
            goes_on(own, row, folder / "out")


@pytest.mark.parametrize("name", NAMES)
def test_two_are_started_on_one_folder(name, tally, tmp_path):
    with tally(f"two on one folder: {name}").attempt():
        both = [PROGRAMS[name].start(tmp_path / "out") for _ in range(2)]
        try:
            while all(process.poll() is None for process in both):
                time.sleep(0.05)
            first, last = sorted(both, key=lambda process: process.poll() is None)
            error = first.communicate()[1]
            refused(first.returncode, error, "in use by another")
            finished(last)
        finally:
            for process in both:
                end(process)


@pytest.mark.parametrize("name", NAMES)
def test_the_clock_goes_back_between_sessions(name, whole, tally, tmp_path):
    """Every file is of the year 2100 when the command goes on."""
    own, row, out = whole(name), tally(f"the clock moved back: {name}"), tmp_path / "out"
    with row.attempt():
        end(well_under_way(own.program, out))
        for path in (out, *out.rglob("*")):
            os.utime(path, (4.1e9, 4.1e9))
        goes_on(own, row, out)


def test_half_of_an_export_vanishes_while_it_runs(whole, tally, tmp_path):
    own, row, out = whole("export"), tally("half a dataset deleted: export"), tmp_path / "out"
    with row.attempt():
        process = well_under_way(own.program, out)
        for path in sorted(out.rglob("*.png"))[::2]:
            path.unlink(missing_ok=True)
        error = process.communicate(timeout=900)[1]
        refused(process.returncode, error, "disappeared during the export")
        assert not (out / "dataset.json").exists()
        goes_on(own, row, out)


def test_half_of_the_labels_vanish_while_a_job_runs(camvid, tally, tmp_path):
    """What a run has read stays with it; a new one names the first label that is missing."""
    command = [word.replace("cityscapes", "camvid") for word in PROGRAMS["run"].command]
    program = PROGRAMS["run"]._replace(command=[*command, "--data", str(camvid)])
    out, again, copy = (tmp_path / name for name in ("out", "again", "copy"))
    shutil.copytree(camvid, copy)
    with tally("half a dataset deleted: run").attempt():
        process = well_under_way(program, out)
        for path in sorted(camvid.glob("trainannot/*.png"))[::2]:
            path.unlink()
        finished(process)
        refused(*program.finish(again), str(camvid))
        shutil.copytree(copy, camvid, dirs_exist_ok=True)
        assert program.finish(again) == (0, "")
        assert program.answer(again) == program.answer(out)
