"""Whole files or none, and JSON that is read with suspicion."""

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shell.errors import UserError
from shell.files import digest, folder_digest, parse_json, read_json, versions, write, write_json


def pieces(texts: list[str], error: BaseException):
    yield from texts
    raise error


@given(st.lists(st.text()), st.sampled_from([OSError(5, "I/O error"), KeyboardInterrupt()]))
def test_what_stops_a_writer_leaves_the_old_file(tmp_path_factory, texts, error):
    path = tmp_path_factory.mktemp("out") / "file"
    content = "".join(texts).encode()
    assert write(path, iter(texts)) == len(content) and path.read_bytes() == content
    with pytest.raises(type(error)):
        write(path, pieces(["new", *texts], error))
    assert path.read_bytes() == content and list(path.parent.iterdir()) == [path]


def test_a_full_disk_leaves_the_old_file_and_is_named(tmp_path, full_disk, monkeypatch):
    path = tmp_path / "summary.json"
    path.write_text("old")
    with pytest.raises(OSError) as caught:
        write_json(path, {"new": 1})
    assert caught.value.filename == str(path)
    assert list(tmp_path.iterdir()) == [path] and path.read_text() == "old"
    monkeypatch.undo()
    write_json(path, {"new": 1})
    assert path.read_text() == '{\n  "new": 1\n}\n'
    write(path, b"\x00\x01", part=tmp_path / "elsewhere")
    assert path.read_bytes() == b"\x00\x01" and list(tmp_path.iterdir()) == [path]
    with pytest.raises(ValueError):
        write_json(path, {"miou": math.nan})
    assert path.read_bytes() == b"\x00\x01"
    with pytest.raises(FileNotFoundError) as caught:
        write(tmp_path / "none" / "file", "x")
    assert caught.value.filename == str(tmp_path / "none" / "file")


@pytest.mark.parametrize("text", ["", "{", "NaN", "[-Infinity]", "[" * 10**5, "\xff"])
def test_what_is_no_json_is_named(text, tmp_path):
    path = tmp_path / "x.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(ValueError):
        parse_json(path.read_bytes())
    with pytest.raises(UserError, match="is no JSON file") as caught:
        read_json(path)
    assert str(path) in str(caught.value)
    with pytest.raises(FileNotFoundError):
        read_json(tmp_path / "none.json")


def test_canonical_json_by_hand():
    # printf '{"a":[1,null],"b":0.5}' | sha256sum
    wanted = "e538351ae63f53e363c30268d420c1326bbb521f9654b990125d44fa23340bdc"
    assert digest({"b": 0.5, "a": [1, None]}) == wanted


def test_a_folder_is_told_by_the_names_and_bytes_of_its_files(tmp_path):
    def found(*files: tuple[str, str]) -> str:
        root = Path(tmp_path / str(len(list(tmp_path.iterdir()))))
        for name, text in files:
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text)
        return folder_digest(root)

    one = found(("car/a.obj", "v 0 0 0"), ("b", ""))
    assert one == found(("b", ""), ("car/a.obj", "v 0 0 0"))
    others = [
        found(("car/a.obj", "v 0 0 1"), ("b", "")),
        found(("bus/a.obj", "v 0 0 0"), ("b", "")),
        found(("car/a.obj", "v 0 0 0")),
    ]
    assert len({one, *others}) == 4


def test_versions_of_packages_that_may_be_missing():
    found = versions(["numpy", "no-such-package"])
    assert found["numpy"][0].isdigit() and found["no-such-package"] == "not installed"
    assert json.loads(json.dumps(found)) == found
