"""Processes killed at random moments, disks that fill, folders that two want, files that vanish."""

import os
import shutil
import signal
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import gone
from tests.experiments.test_main_job import children
from tests.robustness.conftest import NAMES, PROGRAMS, TIMES, end

pytestmark = pytest.mark.robust


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
            assert (process.returncode, process.communicate()[1]) == (0, "")
            assert program.answer(out) == own.answer
            out, kept = tmp_path / f"{killed}", set()
            continue
        with row.attempt():
            process.kill()
            process.communicate()
            assert all(gone(pid) for pid in workers)
            killed += 1
            now = program.kept(out)
            row.lose("finished evaluations", len(kept - now))
            assert kept <= now
            kept = now
    with row.attempt():
        assert program.finish(out) == (0, "")
        assert program.answer(out) == own.answer


@pytest.mark.parametrize("name", ["run", "export"])
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
                for pid in workers[:1]:
                    os.kill(pid, signal.SIGKILL)
                assert process.communicate(timeout=900)[1] == "" and process.returncode == 0
                assert program.answer(out) == own.answer
            finally:
                end(process)


def _command(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
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


def goes_on(program, own, row, out):
    """The same command, now with room, ends with the same answer; notes what was kept and is lost."""
    kept = program.kept(out)
    assert program.finish(out) == (0, "")
    lost = 0 if program.name == "export" else len(kept - program.kept(out))
    row.lose("finished evaluations", lost)
    assert program.answer(out) == own.answer


@pytest.mark.parametrize("name", NAMES)
def test_no_file_may_grow_beyond_a_quota(name, whole, tally, tmp_path):
    """What can be had without root: a limit to the size of each file, up to that of the largest."""
    own, program, row = whole(name), PROGRAMS[name], tally(f"a quota for files: {name}")
    for number, share in enumerate(np.linspace(0.05, 0.95, max(TIMES // 4, 2))):
        out = tmp_path / str(number)
        with row.attempt():
            code, error = program.finish(out, most=int(share * own.largest))
            assert code == 2 and error.count("\n") == 1 and "too large" in error, error
            goes_on(program, own, row, out)


@pytest.mark.parametrize("name", NAMES)
def test_the_disk_is_full_at_every_stage(name, whole, tally, tmp_path):
    own, program, row = whole(name), PROGRAMS[name], tally(f"the disk is full: {name}")
    for number, share in enumerate(np.linspace(0.05, 0.95, max(TIMES // 4, 2))):
        folder = tmp_path / str(number)
        with disk(folder, max(int(share * own.size) // 4096, 2) * 4096), row.attempt():
            out = folder / "out"
            code, error = program.finish(out)
            assert code == 2 and error.count("\n") == 1 and "Traceback" not in error, error
            room = ["mount", "-o", f"remount,size={64 * own.size}", str(folder)]
            subprocess.run(room, check=True)
            goes_on(program, own, row, out)


@pytest.mark.parametrize("name", NAMES)
def test_two_are_started_on_one_folder(name, tally, tmp_path):
    program, row = PROGRAMS[name], tally(f"two on one folder: {name}")
    with row.attempt():
        one, other = program.start(tmp_path / "out"), program.start(tmp_path / "out")
        try:
            while one.poll() is None and other.poll() is None:
                time.sleep(0.05)
            first, last = (one, other) if one.poll() is not None else (other, one)
            error = first.communicate()[1]
            assert first.returncode == 2 and "in use by another" in error and error.count("\n") == 1
            assert last.communicate(timeout=900)[1] == "" and last.returncode == 0
        finally:
            for process in (one, other):
                end(process)


def well_under_way(program, out):
    """A process of the program that has kept two pieces of its work, and goes on."""
    process = program.start(out)
    while len(program.kept(out)) < 2:
        assert process.poll() is None
        time.sleep(0.002)
    return process


@pytest.mark.parametrize("name", NAMES)
def test_the_clock_goes_back_between_sessions(name, whole, tally, tmp_path):
    """Every file is of the year 2100 when the command goes on."""
    own, program, row = whole(name), PROGRAMS[name], tally(f"the clock moved back: {name}")
    out = tmp_path / "out"
    with row.attempt():
        end(well_under_way(program, out))
        for path in (out, *out.rglob("*")):
            os.utime(path, (4.1e9, 4.1e9))
        assert program.finish(out) == (0, "")
        assert program.answer(out) == own.answer


def test_half_of_an_export_vanishes_while_it_runs(whole, tally, tmp_path):
    own, program, row = whole("export"), PROGRAMS["export"], tally("half a dataset deleted: export")
    out = tmp_path / "out"
    with row.attempt():
        process = well_under_way(program, out)
        for path in sorted(out.rglob("*.png"))[::2]:
            path.unlink(missing_ok=True)
        error = process.communicate(timeout=900)[1]
        assert process.returncode == 2 and error.count("\n") == 1 and "vanished" in error, error
        assert not (out / "dataset.json").exists()
        assert program.finish(out) == (0, "")
        assert program.answer(out) == own.answer


def test_half_of_the_labels_vanish_while_a_job_runs(camvid, tally, tmp_path):
    """What a run has read stays with it; a new one names the first label that is missing."""
    program = PROGRAMS["run"]
    words = [word.replace("cityscapes", "camvid") for word in program.command]
    other = type(program)("run", [*words, "--data", str(camvid)], program.log)
    row, whole_data = tally("half a dataset deleted: run"), tmp_path / "copy"
    shutil.copytree(camvid, whole_data)
    with row.attempt():
        out = tmp_path / "out"
        process = other.start(out)
        while not other.kept(out):
            assert process.poll() is None, process.stderr.read()
            time.sleep(0.02)
        for path in sorted(camvid.glob("trainannot/*.png"))[::2]:
            path.unlink()
        assert process.communicate(timeout=900)[1] == "" and process.returncode == 0
        code, error = other.finish(tmp_path / "again")
        assert code == 2 and error.count("\n") == 1 and str(camvid) in error, error
        shutil.copytree(whole_data, camvid, dirs_exist_ok=True)
        assert other.finish(tmp_path / "again") == (0, "")
        assert other.answer(tmp_path / "again") == other.answer(out)
