"""Each library can be had without the others, and `scene` without paying for JAX."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def modules_after(statement: str) -> set[str]:
    """Top-level names of the modules that a fresh interpreter holds after a statement."""
    code = f"{statement}\nimport sys\nprint(*{{name.split('.')[0] for name in sys.modules}})"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize(
    ("package", "absent"),
    [
        ("sdr_jax", {"scene", "seg", "experiments", "trimesh", "cv2"}),
        ("scene", {"sdr_jax", "seg", "experiments", "jax", "jaxlib", "flax", "optax"}),
        ("seg", {"sdr_jax", "scene", "experiments", "trimesh", "embreex"}),
    ],
)
def test_a_library_imports_only_what_is_its_own(package, absent):
    loaded = modules_after(f"import {package}")
    assert package in loaded
    assert not loaded & absent


def test_workers_wait_neither_for_trimesh_nor_for_rich():
    loaded = modules_after(
        "import scene.render.__main__, scene.dataset.export\n"
        "from scene.assets.catalogue import FAMILIES, asset\n"
        "assets = [asset(family, 0) for family in FAMILIES]"
    )
    assert "scene" in loaded
    assert not loaded & {"trimesh", "networkx", "rich"}
