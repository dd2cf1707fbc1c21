"""The folder of a job: what it accepts, and what it leaves alone."""

import errno
import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from unittest.mock import Mock

import pytest

from common.errors import UserError
from common.folder import as_json, opened, refuse_foreign, refuse_unwritable

ROWS = [{"name": "yaw", "low": 0.0}, {"name": "fog", "low": 0.5}]
JOB = {
    "seed": 0, "data": Path("/data"), "names": ("argmax", "spread"), "rows": ROWS,
    "search": {"bins": 5, "options": {"lr": 0.5}},
}  # fmt: skip


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "run"


def opens(out: Path, config: dict = JOB, **options) -> bool:
    """Open a folder for a moment; returns whether it was new."""
    with opened(out, config, **options) as resumed:
        return not resumed


def refused(out: Path, config: dict = JOB) -> str:
    """The error of opening a folder, whose content stays the same."""
    before = {path: path.is_file() and path.read_bytes() for path in out.rglob("*")}
    with pytest.raises(UserError, match=str(out)) as caught:
        opens(out, config)
    assert {path: path.is_file() and path.read_bytes() for path in out.rglob("*")} == before
    return str(caught.value)


def test_a_new_folder_says_everything_needed_to_repeat_the_job(tmp_path):
    out = tmp_path / "runs" / "new"
    assert opens(out, packages=["none"])
    stored = json.loads((out / "config.json").read_text())
    assert stored == {"version": 1, **as_json(JOB), "versions": {"none": "not installed"}}
    assert stored["data"] == "/data" and stored["names"] == ["argmax", "spread"]


def test_the_same_job_resumes_with_other_free_values(out):
    assert opens(out, {**JOB, "workers": 1}, packages=["numpy"])
    before = (out / "config.json").read_bytes()
    assert not opens(out, {**JOB, "workers": 7}, free=("workers",))
    assert (out / "config.json").read_bytes() == before
    assert "workers = 1, not 7" in refused(out, {**JOB, "workers": 7})


@pytest.mark.parametrize(("change", "words"), [
    ({"seed": 3}, "seed = 0, not 3"), ({"new": True}, "new = null, not true"),
    ({"data": Path("/other")}, 'data = "/data", not "/other"'),
    ({"names": ("spread",)}, 'names = ["argmax", "spread"], not ["spread"]'),
    ({"search": {"bins": 7, "options": {"lr": 0.5}}}, "search.bins = 5, not 7"),
    ({"search": {"bins": 5, "options": {}}}, "search.options.lr = 0.5, not null"),
    ({"rows": ROWS[:1]}, "rows = [{"),
    ({"rows": [ROWS[0], {"name": "fog", "low": 0.25}]}, "rows.fog.low = 0.5, not 0.25"),
])  # fmt: skip
def test_another_job_is_refused_with_both_values(out, change, words):
    assert opens(out)
    error = refused(out, {**JOB, **change})
    assert words in error and "use another --out" in error


def test_a_second_process_is_kept_out_until_the_first_is_killed(out):
    code = (
        "import sys, time; from pathlib import Path; from common.folder import opened\n"
        "with opened(Path(sys.argv[1]), {'seed': 0}):\n    print('in', flush=True); time.sleep(600)"
    )
    command = [sys.executable, "-c", code, str(out)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "in\n"
            assert "in use by another run" in refused(out, {"seed": 0})
        finally:
            process.kill()
    for _ in range(2):  # and after an error
        with suppress(KeyboardInterrupt), opened(out, {"seed": 0}) as resumed:
            assert resumed
            raise KeyboardInterrupt


def test_a_folder_killed_early_is_used_and_one_with_other_files_is_not(out):
    out.mkdir()
    refuse_foreign(out, JOB)
    for name in ("lock", "config.json.part", "mine"):
        (out / name).write_text("")
    assert "contains other files and no run" in refused(out)
    assert opens(out, allowed=("mine",))
    assert {path.name for path in out.iterdir()} == {"config.json", "lock", "mine"}


def test_a_folder_from_before_there_were_versions_resumes(out):
    assert opens(out)
    stored = json.loads((out / "config.json").read_text())
    assert stored.pop("version") == 1
    (out / "config.json").write_text(json.dumps(stored))
    before = (out / "config.json").read_bytes()
    assert not opens(out) and (out / "config.json").read_bytes() == before
    assert "seed = 0, not 3" in refused(out, {**JOB, "seed": 3})


@pytest.mark.parametrize("version", [0, 2, "1", None])
def test_an_unknown_version_is_refused(out, version):
    assert opens(out)
    stored = json.loads((out / "config.json").read_text())
    (out / "config.json").write_text(json.dumps({**stored, "version": version}))
    error = refused(out)
    assert (
        f"config.json has version {json.dumps(version)}, but this program reads version 1" in error
    )


@pytest.mark.parametrize("text", ["{", "[]", "", "\xff"])
def test_a_broken_config_is_named(out, text):
    out.mkdir()
    (out / "config.json").write_bytes(text.encode("latin-1"))
    assert "config.json is not a JSON object" in refused(out)


def test_out_is_a_file_or_cannot_be_written(out, monkeypatch):
    out.write_text("mine")
    assert "is a file; it must be a folder" in refused(out)
    assert f"cannot be written ({out} is a file)" in refused(out / "below")
    assert out.read_text() == "mine"
    # Root may write anywhere but in a file system that takes no files.
    assert "cannot be written" in refused(Path("/proc/run"))
    with monkeypatch.context() as patch:
        patch.setattr(os, "access", lambda path, mode: Path(path) != out.parent)
        new = f"cannot be written ({out.parent} is read-only)"
        assert new in refused(out.with_name("new"))
        with pytest.raises(UserError, match="is read-only"):  # before anything is measured
            refuse_unwritable(out.with_name("new") / "below")
    read_only = OSError(errno.EROFS, os.strerror(errno.EROFS))
    monkeypatch.setattr(Path, "mkdir", Mock(side_effect=read_only))
    assert "(Read-only file system); choose another" in refused(out.with_name("new"))


@pytest.mark.parametrize("exists", [False, True])
def test_a_full_disk_leaves_no_new_folder_and_keeps_an_old_one(out, full_disk, exists):
    if exists:
        out.mkdir()
    with pytest.raises(OSError) as caught:
        opens(out)
    assert caught.value.filename == str(out / "config.json")
    assert out.exists() == exists and not (out / "config.json").exists()
