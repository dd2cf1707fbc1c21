"""Arrays on disk equal computed ones, whatever has happened to the files."""

import os

import numpy as np
import pytest

from scene import cache
from scene.assets import catalogue
from scene.render.geometry import asset_shape

NUMBERS = np.arange(12, dtype=np.int32).reshape(3, 4)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path))
    monkeypatch.setattr(cache, "_written", 0)
    return tmp_path


def ask(name="x"):
    """Whether the numbers came from disk; they must be right in both cases."""
    calls = []
    arrays = cache.cached(name, lambda: calls.append(1) or {"a": NUMBERS.copy()})
    assert list(arrays) == ["a"] and (arrays["a"] == NUMBERS).all()
    return not calls


def test_a_file_is_read_while_it_is_whole_and_else_made_anew(folder):
    assert [ask(), ask()] == [False, True]
    [path] = folder.glob("*/*")
    content = path.read_bytes()
    flipped = content.replace(NUMBERS.tobytes(), (NUMBERS ^ 4).tobytes())
    np.savez(path, a=np.array([{"a": 1}], object))  # never unpickled
    for data in (path.read_bytes(), content[:-40], flipped, b""):
        path.write_bytes(data)
        assert [ask(), ask()] == [False, True]


def test_off_keeps_nothing_and_where_nothing_can_be_written_it_is_only_slower(folder, monkeypatch):
    (folder / "file").write_text("no folder")
    for place in ("off", str(folder / "file")):
        monkeypatch.setenv(cache.VARIABLE, place)
        assert [ask(), ask()] == [False, False] and not list(folder.glob("*/*"))


def test_the_oldest_files_go_where_there_are_too_many(folder, monkeypatch):
    monkeypatch.setattr(cache, "LOOK", 1)
    others = [folder / "xla" / "function.npz", folder / "7-street" / "photo.png"]
    for path in others:
        path.parent.mkdir()
        path.write_bytes(bytes(10**6))
        os.utime(path, (0, 0))
    for k in range(12):
        ask(f"{k}")
        path = next(folder.glob(f"*/{k}.npz"))
        os.utime(path, (k, k))
        monkeypatch.setattr(cache, "MOST", 4 * path.stat().st_size)
    left = {path for path in folder.glob("*/*") if path not in others}
    assert {path.stem for path in left} >= {"9", "10", "11"} and len(left) <= 5
    assert all(path.exists() for path in others)


def test_shapes_and_bounds_from_disk_are_those_that_are_made(folder, monkeypatch):
    def both():
        asset_shape.cache_clear()
        catalogue.bounds.cache_clear()
        shape = asset_shape("tree", 1, "far")
        return [a.tobytes() for a in (*shape[:4], catalogue.bounds("tree", 1))]

    computed, path = both(), next(folder.glob("*/shape-tree-1-far.npz"))
    arrays = dict(np.load(path))  # beyond the corners compiled code would read anything
    np.savez(path, **{**arrays, "faces": arrays["faces"] + 10**6})
    assert both() == computed
    monkeypatch.setattr(catalogue, "asset", None)  # from here on only from disk
    assert both() == computed
