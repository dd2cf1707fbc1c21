"""What ruff does not check of the rules of the layout: every generator has a seed, and `scene` knows no JAX.

`scene` without JAX lets render workers start fast.
"""

import re
from collections.abc import Iterator

import pytest

from tests.conftest import ROOT

PACKAGES = ("common", "sdr_jax", "scene", "seg", "experiments")
WITHOUT_SEED = r"\b(?:default_rng|SeedSequence)\(\s*\)"
IMPORT_OF_JAX = r"^\s*(?:from|import) +(?:jax|jaxlib|flax|optax)\b"


def breaches(source: str, path: str) -> Iterator[str]:
    """What breaks a rule in the source of a file, relative to the root."""
    yield from re.findall(WITHOUT_SEED, source)
    if path.startswith(("common/", "scene/")) and path != "scene/callback.py":
        yield from re.findall(IMPORT_OF_JAX, source, re.MULTILINE)


def test_our_sources_keep_the_rules():
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    texts = {path.relative_to(ROOT).as_posix(): path.read_text() for path in paths}
    assert "scene/callback.py" in texts
    found = {path: [*breaches(text, path)] for path, text in texts.items()}
    assert {path: wrong for path, wrong in found.items() if wrong} == {}


@pytest.mark.parametrize(("path", "source", "count"), [
    ("scene/street/street.py", "import numpy as np\nnp.random.default_rng()", 1),
    ("scene/street/street.py", "def f():\n    import jax.numpy as jnp", 1),
    ("scene/dataset/render.py", "from jax import Array", 1),
    ("common/files.py", "import flax", 1),
    ("scene/callback.py", "import jax", 0),
    ("seg/train.py", "import jax\nrng = np.random.default_rng(seed)", 0),
])  # fmt: skip
def test_a_breach_is_found(path, source, count):
    assert len([*breaches(source, path)]) == count
