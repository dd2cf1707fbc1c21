"""The run folder: written whole or not at all, continued, and guarded."""

import errno
import json
import os
import resource
from dataclasses import replace

import pytest
from experiments.errors import UserError
from experiments.folder import (
    EVALUATION_FIELDS,
    FINAL_FIELDS,
    Log,
    RunFolder,
    plain,
    write_atomically,
    write_json,
)
from experiments.targets import camvid_target
from hypothesis import given
from hypothesis import strategies as st

from experiments import folder as module
from experiments.config import camvid_config
from experiments.main import main

LINE = {
    "update": 0,
    "dataset": 1,
    "actions": [1, 2],
    "seed": 5,
    "reward": 0.25,
    "class_iou": [0.5, None],
    "render_seconds": 1.0,
    "train_seconds": 2.0,
    "elapsed": 3.5,
}


def evaluations(path):
    return Log(path, EVALUATION_FIELDS)


@pytest.fixture
def full_disk(monkeypatch):
    """Bytes reach the file, but the disk takes none of them."""

    def fsync(descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(module.os, "fsync", fsync)


def test_lines_come_back(tmp_path):
    log = evaluations(tmp_path / "e.jsonl")
    assert log.lines == [] and not (tmp_path / "e.jsonl").exists()
    log.append(LINE)
    log.append({**LINE, "dataset": 2})
    log.close()
    again = evaluations(tmp_path / "e.jsonl")
    assert again.lines == [LINE, {**LINE, "dataset": 2}]
    again.append({**LINE, "dataset": 3})
    assert [line["dataset"] for line in evaluations(tmp_path / "e.jsonl").lines] == [1, 2, 3]


@given(st.data())
def test_a_kill_while_writing_loses_at_most_the_last_line(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("log") / "e.jsonl"
    log = evaluations(path)
    for dataset in range(3):
        log.append({**LINE, "dataset": dataset})
    log.close()
    whole = path.read_bytes()
    cut = data.draw(st.integers(0, len(whole)))
    path.write_bytes(whole[:cut])
    again = evaluations(path)
    kept = whole[:cut].count(b"\n")
    assert [line["dataset"] for line in again.lines] == list(range(kept))
    for dataset in range(kept, 3):
        again.append({**LINE, "dataset": dataset})
    again.close()
    assert path.read_bytes() == whole


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("{update: 1}", "line 2 is not JSON"),
        ("", "line 2 is not JSON"),
        ("\xff\xfe", "line 2 is not JSON"),
        ("[1, 2]", "line 2 is no JSON object"),
        (json.dumps({k: v for k, v in LINE.items() if k != "reward"}), "line 2: reward must"),
        (json.dumps({**LINE, "seed": "x"}), "line 2: seed must be of type int"),
        (json.dumps({**LINE, "reward": float("nan")}), "line 2 is not JSON"),
    ],
)
def test_a_corrupt_line_is_named(tmp_path, line, complaint):
    path = tmp_path / "e.jsonl"
    path.write_bytes(f"{json.dumps(LINE)}\n{line}\n{json.dumps(LINE)}\n".encode("latin-1"))
    before = path.read_bytes()
    with pytest.raises(UserError, match=complaint) as caught:
        evaluations(path)
    assert str(path) in str(caught.value) and "--out" in str(caught.value)
    assert path.read_bytes() == before


def test_a_full_disk_is_named_and_takes_no_half_line(tmp_path, full_disk, monkeypatch):
    path = tmp_path / "e.jsonl"
    path.write_text(json.dumps(LINE) + "\n")
    before = path.read_bytes()
    log = evaluations(path)
    with pytest.raises(OSError) as caught:
        log.append(LINE)
    assert (caught.value.errno, caught.value.filename) == (errno.ENOSPC, str(path))
    assert path.read_bytes() == before and len(log.lines) == 1
    monkeypatch.undo()
    log.append(LINE)
    log.close()
    assert path.read_bytes() == 2 * before


def test_a_file_that_cannot_grow_takes_no_half_line(tmp_path):
    path = tmp_path / "e.jsonl"
    path.write_text(json.dumps(LINE) + "\n")
    before = path.read_bytes()
    log = evaluations(path)
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 10, old[1]))
    try:
        with pytest.raises(OSError) as caught:
            log.append(LINE)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
    assert (caught.value.errno, caught.value.filename) == (errno.EFBIG, str(path))
    assert path.read_bytes() == before


def test_whole_files_or_none(tmp_path, full_disk, monkeypatch):
    path = tmp_path / "summary.json"
    path.write_text("old")
    with pytest.raises(OSError) as caught:
        write_json(path, {"new": 1})
    assert caught.value.filename == str(path)
    assert [p.name for p in tmp_path.iterdir()] == ["summary.json"] and path.read_text() == "old"
    monkeypatch.undo()
    write_json(path, {"new": 1})
    assert json.loads(path.read_text()) == {"new": 1}
    write_atomically(path, b"\x00\x01")
    assert path.read_bytes() == b"\x00\x01"
    with pytest.raises(ValueError):
        write_json(path, {"miou": float("nan")})
    assert path.read_bytes() == b"\x00\x01"


def test_a_new_folder_says_everything_needed_to_repeat_the_run(tiny_twin):
    run = RunFolder(tiny_twin, "twin")
    assert not run.continued and run.elapsed == 0
    run.close()
    stored = json.loads((tiny_twin.out / "config.json").read_text())
    assert stored["target"] == "twin" and set(stored["versions"]) >= {"jax", "numpy", "sdr-jax"}
    assert {k: v for k, v in stored.items() if k not in ("target", "versions")} == plain(tiny_twin)


def test_the_same_run_is_continued_with_other_workers(tiny_twin):
    run = RunFolder(tiny_twin, "twin")
    run.evaluations.append(LINE)
    run.close()
    again = RunFolder(replace(tiny_twin, workers=7), "twin")
    assert again.continued and again.elapsed == 3.5 and again.evaluations.lines == [LINE]
    again.close()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seed": 3}, "seed = 0, not 3"),
        ({"twin_seed": 1}, "twin_seed = 0, not 1"),
        ({"holdout": "B"}, "holdout = None, not B"),
        ({"candidates": ("spread",)}, r"candidates = \['argmax', 'spread'\], not \['spread'\]"),
    ],
)
def test_another_configuration_is_named_with_both_values(tiny_twin, change, words):
    RunFolder(tiny_twin, "twin").close()
    with pytest.raises(UserError, match=words) as caught:
        RunFolder(replace(tiny_twin, **change), "twin")
    assert "--out" in str(caught.value)


def test_nested_fields_and_the_target_are_named(tiny_twin):
    RunFolder(tiny_twin, "twin").close()
    search = replace(tiny_twin.search, bins=7)
    with pytest.raises(UserError, match=r"search\.bins = 5, not 7"):
        RunFolder(replace(tiny_twin, search=search), "twin")
    with pytest.raises(UserError, match="target = twin, not cityscapes"):
        RunFolder(tiny_twin, "cityscapes")


def test_a_folder_in_use_is_refused_and_free_again_afterwards(tiny_twin):
    first = RunFolder(tiny_twin, "twin")
    with pytest.raises(UserError, match="in use by another run"):
        RunFolder(tiny_twin, "twin")
    first.close()
    RunFolder(tiny_twin, "twin").close()


def test_a_folder_killed_at_its_birth_is_taken(tiny_twin):
    tiny_twin.out.mkdir()
    for name in ("lock", "config.json.part"):
        (tiny_twin.out / name).write_text("")
    RunFolder(tiny_twin, "twin").close()
    assert (tiny_twin.out / "config.json").exists()


def test_a_folder_of_other_things_stays_as_it_is(tiny_twin):
    tiny_twin.out.mkdir()
    (tiny_twin.out / "thesis.tex").write_text("x")
    with pytest.raises(UserError, match="other files"):
        RunFolder(tiny_twin, "twin")
    assert [p.name for p in tiny_twin.out.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("text", ["{", "[]", ""])
def test_a_broken_config_is_named(tiny_twin, text):
    tiny_twin.out.mkdir()
    (tiny_twin.out / "config.json").write_text(text)
    with pytest.raises(UserError, match=r"config\.json is no JSON object"):
        RunFolder(tiny_twin, "twin")


def test_a_full_disk_leaves_no_new_folder(tiny_twin, full_disk):
    with pytest.raises(OSError) as caught:
        RunFolder(tiny_twin, "twin")
    assert caught.value.filename == str(tiny_twin.out / "config.json")
    assert not tiny_twin.out.exists()


def fails(error_line, camvid, out) -> str:
    """The one line with which the CamVid job refuses ``out``."""
    arguments = ["--preset", "smoke", "--workers", "0", "--data", str(camvid), "--out", str(out)]
    assert main("camvid", camvid_config, camvid_target, "", arguments) == 2
    return error_line(begun=True)


def test_out_is_a_file(error_line, camvid, tmp_path):
    (tmp_path / "file").write_text("mine")
    assert "is a file; it must be a folder" in fails(error_line, camvid, tmp_path / "file")
    assert "cannot be written" in fails(error_line, camvid, tmp_path / "file" / "below")
    assert (tmp_path / "file").read_text() == "mine"


def test_out_cannot_be_written(error_line, camvid, tmp_path, monkeypatch):
    # Root may write anywhere but in a file system that takes no files.
    text = fails(error_line, camvid, "/proc/run")
    assert "--out /proc/run cannot be written" in text and "choose another" in text

    def read_only(*_, **__):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(module.Path, "mkdir", read_only)
    assert "Read-only file system" in fails(error_line, camvid, tmp_path / "run")


def test_out_fills_the_disk(error_line, camvid, tmp_path, full_disk):
    text = fails(error_line, camvid, tmp_path / "run")
    assert "config.json: No space left on device" in text and "the same command goes on" in text
    assert not (tmp_path / "run").exists()


def test_out_holds_another_run(error_line, camvid, tmp_path):
    config = replace(camvid_config("smoke"), data=camvid, out=tmp_path / "run", seed=4)
    RunFolder(config, "camvid").close()
    assert "seed = 4, not 0" in fails(error_line, camvid, tmp_path / "run")


def test_finals_have_their_own_fields(tmp_path):
    (tmp_path / "f.jsonl").write_text(json.dumps(LINE) + "\n")
    with pytest.raises(UserError, match="kind must be of type str"):
        Log(tmp_path / "f.jsonl", FINAL_FIELDS)
