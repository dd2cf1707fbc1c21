"""Lines of JSON: what comes back, what a kill or a full disk takes, and many writers."""

import errno
import json
import multiprocessing
import resource
import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.command import exit_code
from common.errors import UserError
from common.lines import JsonLines
from tests.conftest import refused
from tests.tasks import add_alone, add_many

LINE = {"key": "k", "reward": 0.25, "class_iou": [0.5, None]}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file with one line."""
    JsonLines(tmp_path / "e.jsonl").append(LINE)
    return tmp_path / "e.jsonl"


def test_lines_come_back(path):
    log = JsonLines(path)
    assert log.lines == [LINE] and log.where(0) == f"{path}: line 1"
    log.append({"n": 2}, {"n": 3})
    assert log.lines == JsonLines(path).lines == [LINE, {"n": 2}, {"n": 3}]
    assert [json.loads(line) for line in path.read_text().splitlines()] == log.lines
    assert not JsonLines(path.with_name("new")).lines and not path.with_name("new").exists()
    in_memory = JsonLines(None)
    in_memory.append(LINE)
    assert in_memory.refresh() == [] and in_memory.lines == [LINE]


@given(st.lists(st.dictionaries(st.text(), st.text() | st.floats(0, 1)), max_size=4), st.data())
def test_a_kill_while_writing_loses_at_most_the_last_line(tmp_path_factory, records, data):
    path = tmp_path_factory.mktemp("log") / "e.jsonl"
    JsonLines(path).append(*records)
    whole = path.read_bytes()
    cut = data.draw(st.integers(0, len(whole)))
    path.write_bytes(whole[:cut])
    again = JsonLines(path)
    kept = whole[:cut].count(b"\n")
    assert again.lines == records[:kept]
    for record in records[kept:]:
        again.append(record)
    assert path.read_bytes() == whole


@pytest.mark.parametrize(("line", "complaint"), [
    ("{update: 1}", "line 2 is not JSON"), ("", "line 2 is not JSON"),
    ("\xff\xfe", "line 2 is not JSON"), ("[" * 10**5, "line 2 is not JSON"),
    ('{"reward": NaN}', "line 2 is not JSON"), ("[1, 2]", "line 2 is not a JSON object"),
])  # fmt: skip
def test_a_corrupt_line_is_named_with_its_cure(path, line, complaint):
    path.write_bytes(f"{json.dumps(LINE)}\n{line}\n{json.dumps(LINE)}\n".encode("latin-1"))
    before = path.read_bytes()
    refused(UserError, f"{path}: {complaint}; begin anew", JsonLines, path, "begin anew")
    assert path.read_bytes() == before


def test_a_full_disk_is_named_and_takes_no_half_line(path, full_disk, monkeypatch):
    before = path.read_bytes()
    log = JsonLines(path)
    refused(ValueError, "", log.append, LINE, {"reward": float("nan")})
    caught = refused(OSError, "", log.append, LINE)
    assert (caught.errno, caught.filename) == (errno.ENOSPC, str(path))
    assert path.read_bytes() == before and len(log.lines) == 1
    monkeypatch.undo()
    log.append(LINE)
    assert path.read_bytes() == 2 * before


def test_a_file_that_cannot_grow_takes_no_half_line(path):
    before = path.read_bytes()
    log = JsonLines(path)
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 10, old[1]))
    try:
        caught = refused(OSError, "", log.append, LINE)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
    assert (caught.errno, caught.filename) == (errno.EFBIG, str(path))
    assert path.read_bytes() == before


@pytest.mark.parametrize("text", [f"{json.dumps(LINE)}\n" * 2, '{"a": 1}\n', ""])
def test_a_file_that_was_changed_meanwhile_is_left_alone(path, text, capsys):
    log = JsonLines(path)
    path.write_text(text)
    refused(RuntimeError, "changed by another process", log.append, LINE)
    assert exit_code(lambda: log.append(LINE)) == 2 and path.read_text() == text
    assert capsys.readouterr().err.startswith(f"error: {path} was changed by another process; run")


def test_what_another_process_adds_is_read_once(path):
    one, other = JsonLines(path), JsonLines(path)
    one.append({"n": 1}, {"n": 2})
    assert other.refresh() == [{"n": 1}, {"n": 2}] and other.refresh() == []
    with path.open("ab") as file:
        file.write(b'{"n"')  # it is still writing
    assert other.refresh() == []
    with other.shared():
        other.append({"n": 3})
    assert JsonLines(path).lines == [LINE, {"n": 1}, {"n": 2}, {"n": 3}]


@pytest.mark.parametrize("kind", ["Thread", "Process"])
def test_two_may_write_at_once(tmp_path, kind):
    path = tmp_path / "new" / "shared.jsonl"
    module = threading if kind == "Thread" else multiprocessing.get_context("spawn")
    ready = module.Barrier(2)
    writers = [getattr(module, kind)(target=add_many, args=(path, name, ready)) for name in "xy"]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    before, after = JsonLines(path).lines[::2], JsonLines(path).lines[1::2]
    for name in "xy":
        assert [line["k"] for line in before if line["name"] == name] == list(range(20))
    assert after == [{"after": [*line.values()]} for line in before]  # appended together


def test_what_two_append_at_once_is_written_or_refused(tmp_path):
    path, module = tmp_path / "history.jsonl", multiprocessing.get_context("spawn")
    ready, counts = module.Barrier(2), module.Queue()
    writers = [module.Process(target=add_alone, args=(path, name, ready, counts)) for name in "xy"]
    for writer in writers:
        writer.start()
    ended, written = 0, 0
    while ended < 2:
        name = counts.get(timeout=60)
        ended, written = ended + (name is None), written + (name is not None)
    for writer in writers:
        writer.join()
    assert len(JsonLines(path).lines) == written
