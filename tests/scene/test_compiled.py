"""Cached functions are never those of other sources, and the cache may be missing."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "scene"
START = """
import numpy as np
from scene.render.embree.sunlight import _begin
one, flat = np.zeros(1, np.int32), np.ones((1, 3), np.float32)
print(_begin(one, np.zeros((1, 3), np.float32), flat, np.ones(1, np.int8))[1][0, 0])
"""
"""Where a ray begins: a compiled function with a constant of another file."""
WORKER = """
from scene.render import renderer
from common.workers.pool import WorkerPool
with WorkerPool(1) as pool:
    print([type(found).__name__ for _, found in pool.map(renderer, [("embree",)])])
"""


@pytest.fixture
def copied(tmp_path):
    """``copied(code, variable=...)`` runs code on a copy of the sources; returns its output and errors."""
    hidden = shutil.ignore_patterns("__pycache__")
    for package in ("scene", "common"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=hidden)
    unset = ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    environment |= {"PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}

    def run(code, **variables):
        ran = subprocess.run(
            [sys.executable, "-c", code],
            cwd=tmp_path, env=environment | variables, capture_output=True, text=True,
        )  # fmt: skip
        assert ran.returncode == 0, ran.stderr
        return ran.stdout.strip(), ran.stderr

    return run


def test_a_constant_of_another_file_is_seen_when_it_changes(copied, tmp_path):
    assert float(copied(START)[0]) == pytest.approx(0.01)
    source = tmp_path / "scene/render/visibility.py"
    text = source.read_text()
    assert "\nOFFSET = 1e-2\n" in text
    source.write_text(text.replace("\nOFFSET = 1e-2\n", "\nOFFSET = 3e-2\n"))
    assert float(copied(START)[0]) == pytest.approx(0.03)
    assert len(list((tmp_path / "scene/__pycache__").glob("kernels-*"))) == 1


def test_where_nothing_can_be_written_that_is_said_once(copied, tmp_path):
    for folder in [p for p in (tmp_path / "scene").rglob("*") if p.is_dir()]:
        (folder / "__pycache__").touch()  # no folder can be made there, by anybody
    (tmp_path / "scene/__pycache__").touch()
    (tmp_path / "tmp").mkdir()
    out, errors = copied(START + WORKER, HOME="/dev/null", TMPDIR=str(tmp_path / "tmp"))
    assert out.splitlines() == ["0.01", "['EmbreeRenderer']"]
    assert errors.count("NUMBA_CACHE_DIR") == errors.count("\n") == 1
    assert list((tmp_path / "tmp").iterdir()) == []


def test_a_folder_that_the_user_names_is_used(copied, tmp_path):
    copied(START, NUMBA_CACHE_DIR=str(tmp_path / "mine"))
    assert list((tmp_path / "mine").glob("kernels-*/*/*.nbi"))
    assert not list((tmp_path / "scene").rglob("*.nbi"))


@pytest.mark.parametrize("path", sorted(SCENE.rglob("*.py")), ids=lambda p: p.stem)
def test_all_functions_are_compiled_so(path):
    """There are none in folders whose changes are ignored."""
    from scene.compiled import WITHOUT

    names = {
        (node.module, alias.name)
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert not names & {("numba", name) for name in ("njit", "jit", "vectorize", "cfunc")}
    if path.relative_to(SCENE).parts[0] in WITHOUT:
        assert ("scene.compiled", "njit") not in names
