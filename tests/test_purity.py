"""The rules of the layout, checked on the syntax trees of all our sources.

- The core is pure: no global randomness, no clock, no print; these live in the thin shell.
- `scene` knows no JAX outside `scene/callback.py`, so that render workers start fast.
- `sdr_jax`, `scene` and `seg` know neither each other nor `experiments`; `common` lies below all of them.
"""

import ast
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import pytest

ROOT = Path(__file__).resolve().parents[1]
FLOOR = "common"  # what all may import, and what imports none of them
LIBRARIES = ("sdr_jax", "scene", "seg")
PACKAGES = (FLOOR, *LIBRARIES, "experiments")

# The thin shell: folders end with a slash. A `__main__.py` is a command line wherever it is.
# The cache keeps arrays on disk between processes; ask and tell its history in a file; `tune` runs
# simulators as processes, in a run folder.
SHELL = (
    "benchmarks/", "common/", "experiments/",
    "scene/cache.py", "scene/callback.py", "scene/check.py", "scene/compiled.py",
    "scene/stats.py", "scene/assets/library.py", "scene/dataset/", "scene/render/",
    "scene/mesh/siblings.py", "scene/mesh/bombs.py", "scene/mesh/file.py",
    "sdr_jax/ask_tell.py", "sdr_jax/tune/", "seg/data/", "seg/model.py", "seg/weights/",
)  # fmt: skip
JAX = frozenset({"flax", "jax", "jaxlib", "optax"})
IMPURE_MODULES = frozenset({"random", "time"})
# What `numpy.random` has besides functions on a hidden global state.
SEEDED = frozenset({"BitGenerator", "Generator", "PCG64", "SeedSequence", "default_rng"})


def in_shell(path: str) -> bool:
    """Whether a file, relative to the root, may touch the world."""
    if PurePosixPath(path).name == "__main__.py":
        return True
    return any(path.startswith(s) if s.endswith("/") else path == s for s in SHELL)


def forbidden_imports(path: str) -> set[str]:
    """Top-level names that a file must not import."""
    package = path.split("/")[0]
    names = set() if in_shell(path) else set(IMPURE_MODULES)
    if package in (FLOOR, *LIBRARIES):
        names |= {*PACKAGES, "benchmarks", "tests"} - {package, FLOOR}
    if package == FLOOR or (package == "scene" and path != "scene/callback.py"):
        names |= JAX
    return names


def imported_modules(node: ast.AST) -> list[str]:
    """Absolute dotted names that a node imports; relative imports stay in their package."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
        return [node.module]
    if isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
        name = ast.unparse(node.func).split(".")[-1]
        if name in ("import_module", "__import__") and isinstance(node.args[0].value, str):
            return [node.args[0].value]
    return []


def dotted_names(tree: ast.AST) -> dict[str, str]:
    """What each imported local name stands for: `np` -> `numpy`, `rand` -> `numpy.random.rand`."""
    names = {}
    for node in ast.walk(tree):
        absolute = isinstance(node, ast.ImportFrom) and node.level == 0
        for alias in node.names if absolute or isinstance(node, ast.Import) else ():
            name = alias.name if absolute or alias.asname else alias.name.split(".")[0]
            names[alias.asname or name] = f"{node.module}.{name}" if absolute else name
    return names


def resolve(node: ast.AST, names: dict[str, str]) -> str:
    """The full dotted name of an attribute chain, or '' for anything else."""
    if isinstance(node, ast.Name):
        return names.get(node.id, node.id)
    if isinstance(node, ast.Attribute):
        value = resolve(node.value, names)
        return f"{value}.{node.attr}" if value else ""
    return ""


def breaches(source: str, path: str) -> Iterator[str]:
    """Yields `path:line: what is wrong` for every breach in one source text."""
    tree = ast.parse(source, filename=path)
    names, forbidden = dotted_names(tree), forbidden_imports(path)
    for node in ast.walk(tree):
        where = f"{path}:{getattr(node, 'lineno', 0)}"
        for module in imported_modules(node):
            if module.split(".")[0] in forbidden:
                yield f"{where}: imports {module}"
        if in_shell(path):
            continue
        if isinstance(node, ast.Name) and node.id == "print" and "print" not in names:
            yield f"{where}: print"
        used = [resolve(node, names)] if isinstance(node, ast.Attribute) else []
        if isinstance(node, ast.ImportFrom) and node.level == 0:
            used = [f"{node.module}.{alias.name}" for alias in node.names]
        for full in used:
            if full.startswith("numpy.random.") and full.split(".")[2] not in SEEDED:
                yield f"{where}: global {full}"
        if isinstance(node, ast.Call) and not node.args and not node.keywords:
            full = resolve(node.func, names)
            if full in ("numpy.random.default_rng", "numpy.random.SeedSequence"):
                yield f"{where}: {full}() without a seed"


def test_our_sources_keep_the_rules():
    paths = sorted(p for package in PACKAGES for p in (ROOT / package).rglob("*.py"))
    texts = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in paths}
    assert {f"{package}/__init__.py" for package in PACKAGES} <= set(texts)
    found = [breach for path, text in texts.items() for breach in breaches(text, path)]
    assert not found, "\n" + "\n".join(found)


@pytest.mark.parametrize(("path", "source", "complaint"), [
    ("scene/classes.py", "import numpy as np\nx = np.random.rand(3)", "global numpy.random.rand"),
    ("seg/train.py", "import numpy\nnumpy.random.seed(0)", "global numpy.random.seed"),
    ("seg/train.py", "from numpy import random as r\nr.normal()", "global numpy.random.normal"),
    ("seg/train.py", "import numpy.random as r\nr.shuffle(x)", "global numpy.random.shuffle"),
    ("seg/train.py", "from numpy.random import rand", "global numpy.random.rand"),
    ("scene/street/street.py", "import numpy as np\nnp.random.default_rng()", "without a seed"),
    ("sdr_jax/policy.py", "import random", "imports random"),
    ("sdr_jax/policy.py", "from random import choice", "imports random"),
    ("sdr_jax/policy.py", "def f():\n    from time import monotonic", "imports time"),
    ("sdr_jax/policy.py", "print(1)", "print"),
    ("sdr_jax/policy.py", "jax.tree.map(print, x)", "print"),
    ("scene/street/street.py", "import jax.numpy as jnp", "imports jax.numpy"),
    ("scene/dataset/render.py", "from jax import Array", "imports jax"),
    ("scene/render/embree/renderer.py", "import flax", "imports flax"),
    ("scene/street/street.py", "from seg.classes import CITYSCAPES", "imports seg.classes"),
    ("scene/callback.py", "import sdr_jax", "imports sdr_jax"),
    ("seg/data/camvid.py", "import scene.classes", "imports scene.classes"),
    ("sdr_jax/callback.py", "from experiments import reward", "imports experiments"),
    ("seg/train.py", "import importlib\nimportlib.import_module('scene')", "imports scene"),
])  # fmt: skip
def test_a_breach_is_found(path, source, complaint):
    (found,) = breaches(source, path)
    assert found.startswith(f"{path}:{source.count(chr(10)) + 1}: ") and complaint in found
