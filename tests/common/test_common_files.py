"""Whole files or none, and JSON that is read with suspicion."""

import errno
import json
import math
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import UserError
from common.files import (
    WIDE,
    check_file,
    digest,
    files_below,
    folder_digest,
    json_text,
    read_json,
    versions,
    whole_folder,
    write,
    write_json,
)
from common.lines import JsonLines
from tests.conftest import refused


@given(st.lists(st.text()), st.sampled_from([OSError(5, "I/O error"), KeyboardInterrupt()]))
def test_what_stops_a_writer_leaves_the_old_file(tmp_path_factory, texts, error):
    def pieces():
        yield from ["new", *texts]
        raise error

    path = tmp_path_factory.mktemp("out") / "file"
    content = "".join(texts).encode()
    assert write(path, iter(texts)) == len(content) and path.read_bytes() == content
    refused(type(error), "", write, path, pieces())
    assert path.read_bytes() == content and list(path.parent.iterdir()) == [path]


def test_whole_files_or_none(tmp_path, full_disk, monkeypatch):
    path = tmp_path / "summary.json"
    path.write_text("old")
    caught = refused(OSError, "", write_json, path, {"new": 1})
    assert caught.filename == str(path)
    assert list(tmp_path.iterdir()) == [path] and path.read_text() == "old"
    monkeypatch.undo()
    write_json(path, {"new": 1})
    assert path.read_text() == '{"new": 1}\n' and read_json(path) == {"new": 1}
    write(path, b"\x00\x01", part=tmp_path / "elsewhere")
    refused(ValueError, "", write_json, path, {"miou": math.nan})
    assert path.read_bytes() == b"\x00\x01" and list(tmp_path.iterdir()) == [path]


def test_whole_folders_or_the_old_ones(tmp_path, monkeypatch):
    folder = tmp_path / "model"

    def made(text):
        with whole_folder(folder) as part:
            write(part / "file", text)

    def breaks(old, new, replace=os.replace):
        if Path(old).name.endswith("-part"):
            raise OSError(5, "Input/output error")
        replace(old, new)

    made("one")
    copies = [tmp_path / f"model{ending}" for ending in (".old", ".part")]
    for copy in copies:  # a user's own
        copy.mkdir()
    with monkeypatch.context() as patch:
        patch.setattr("common.files.os.replace", breaks)
        refused(OSError, "Input/output error", made, "two")
    assert (folder / "file").read_text() == "one" and {*tmp_path.iterdir()} == {folder, *copies}
    folder.rename(tmp_path / ".model.sdr-jax-old")  # as a kill leaves it
    with pytest.raises(KeyError), whole_folder(folder):
        raise KeyError
    assert (folder / "file").read_text() == "one" and {*tmp_path.iterdir()} == {folder, *copies}
    made("two")
    assert (folder / "file").read_text() == "two" and {*tmp_path.iterdir()} == {folder, *copies}
    monkeypatch.chdir(folder)
    with whole_folder(Path(".")) as part:
        write(part / "file", "three")
    assert (folder / "file").read_text() == "three"


def test_files_and_folders_are_synced_with_the_folder_that_names_them(tmp_path, monkeypatch):
    synced = []

    def fsync(descriptor):
        synced.append(Path(os.readlink(f"/proc/self/fd/{descriptor}")).name)

    if not Path("/proc/self/fd").is_dir():
        pytest.skip("names of open files are needed")
    monkeypatch.setattr("common.files.os.fsync", fsync)
    write(tmp_path / "a", "1")
    assert synced == ["a.part", tmp_path.name]
    write(tmp_path / "b", "1", sync=False)
    assert len(synced) == 2
    with whole_folder(tmp_path / "model") as part:
        (part / "inner").mkdir()
        (part / "inner" / "file").write_text("1")
    assert synced[2:] == ["file", "inner", ".model.sdr-jax-part", tmp_path.name]
    assert (tmp_path / "model" / "inner" / "file").read_text() == "1"
    synced.clear()
    lines = JsonLines(tmp_path / "lines")
    lines.append({"a": 1})
    lines.append({"a": 2})
    assert synced == ["lines", tmp_path.name, "lines"]


def test_a_folder_that_takes_no_file_is_refused_before_the_work(tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise OSError(30, "Read-only file system")

    check_file("--json", tmp_path / "scores.json")
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr("common.files.tempfile.TemporaryFile", refuse)
    message = r"--json .*scores\.json: cannot write to .* \(Read-only file system\)"
    refused(UserError, message, check_file, "--json", tmp_path / "scores.json")


PLAIN = st.none() | st.integers() | st.floats(allow_nan=False, allow_infinity=False)
VALUES = st.recursive(
    PLAIN | st.text() | st.just("[\n1,\n 2\n]"),
    lambda values: (
        st.lists(values) | st.lists(PLAIN, min_size=1) | st.dictionaries(st.text(), values)
    ),
)


@given(VALUES)
def test_json_has_what_fits_a_line_on_one_and_so_every_list_of_numbers(value):
    long = [*range(-50, 50), None]
    text = json_text({"one": long, "more": [{"a": []}, ["b" * WIDE]], "value": value})
    start = '{\n  "one": [-50, -49, ' + ", ".join(map(str, range(-48, 50)))
    start += (
        ', null],\n  "more": [\n    {"a": []},\n    [\n      "' + "b" * WIDE + '"\n    ]\n  ],\n'
    )
    assert text.startswith(start) and json.loads(text)["value"] == value


@pytest.mark.parametrize("text", ["", "{", "NaN", "[-Infinity]", "[" * 10**5, "\xff"])
def test_a_file_that_is_not_json_is_named(text, tmp_path):
    path = tmp_path / "x.json"
    path.write_bytes(text.encode("latin-1"))
    refused(UserError, f"{path} is not a JSON file", read_json, path)


def test_canonical_json_by_hand_folders_by_names_and_bytes_and_versions(tmp_path):
    # printf '{"a":[1,null],"b":0.5}' | sha256sum
    expected = "e538351ae63f53e363c30268d420c1326bbb521f9654b990125d44fa23340bdc"
    assert digest({"b": 0.5, "a": [1, None]}) == expected
    installed = versions(["numpy", "no-such-package"])
    assert installed["numpy"][0].isdigit() and installed["no-such-package"] == "not installed"
    digests = [folder_digest(tmp_path)]
    for name, text in (("b/x", "1"), ("a", "2"), ("a", "3")):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
        digests.append(folder_digest(tmp_path))
    (tmp_path / "a").rename(tmp_path / "c")
    assert len({*digests, folder_digest(tmp_path)}) == 5
    (tmp_path / "c").rename(tmp_path / "a")
    assert folder_digest(tmp_path) == digests[-1]


def test_a_folder_that_may_not_be_read_is_no_empty_one(tmp_path, monkeypatch):
    (tmp_path / "open").mkdir()
    (tmp_path / "closed").mkdir()
    (tmp_path / "open" / "a.png").touch()
    scandir = os.scandir

    def refusing(path):
        if str(path).endswith("closed"):
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refusing)
    with pytest.raises(PermissionError, match="closed"):
        files_below(tmp_path)
