"""Each library can be had without the others, and `scene` without paying for JAX; imports point one way."""

import ast
import re
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from importlib import import_module
from pathlib import Path

import griffe
import pytest

from tests.conftest import ROOT, printed


def modules_after(statement: str) -> set[str]:
    """Top-level names of the modules that a fresh interpreter holds after a statement."""
    code = f"{statement}\nimport sys\nprint(*{{name.split('.')[0] for name in sys.modules}})"
    return set(printed(code)[-1].split())


@pytest.mark.parametrize(("package", "absent"), [
    ("sdr_jax", {"scene", "seg", "experiments", "trimesh", "cv2"}),
    ("scene", {"sdr_jax", "seg", "experiments", "jax", "jaxlib", "flax", "optax"}),
    ("seg", {"sdr_jax", "scene", "experiments", "trimesh", "embreex"}),
])  # fmt: skip
def test_a_library_imports_only_what_is_its_own(package, absent):
    loaded = modules_after(f"import {package}")
    assert package in loaded and not loaded & absent


@pytest.mark.parametrize("package", ["sdr_jax", "scene", "seg"])
def test_public_names_are_loaded_on_first_use_from_modules_of_the_package(package):
    alone = modules_after(f"import {package}\nassert dir({package})")
    assert not alone & {"jax", "numpy"}
    whole = import_module(package)
    assert whole.__all__ == dir(whole)
    assert all(getattr(whole, name) is not None for name in whole.__all__)
    with pytest.raises(AttributeError, match=f"No {package} attribute nothing"):
        _ = whole.nothing
    reader = griffe.load_extensions(str(ROOT / "scripts" / "docs_sources.py"))
    page = griffe.load(package, search_paths=[ROOT], extensions=reader)
    assert sorted(page.exports) == whole.__all__  # what the reference lists


def test_a_function_with_the_name_of_its_module_is_what_the_package_offers_in_any_order():
    printed(
        "import sys, sdr_jax.sdr, sdr_jax.registry, sdr_jax\n"
        "from sdr_jax import run, sdr, space\n"
        "for function in (run, sdr, space):\n"
        "    assert function is getattr(sys.modules[function.__module__], function.__name__)\n"
        "assert sdr_jax.sdr is sdr and sys.modules['sdr_jax.sdr'].SdrState"
    )


def test_no_device_is_started_by_an_import():
    # set_up_process decides later how many cores and how much memory of a GPU the process takes
    printed(
        "import experiments.app.main_job, experiments.app.fit.job, experiments.studies.ablation\n"
        "from jax._src import xla_bridge\n"
        "assert not xla_bridge.backends_are_initialized()"
    )


def test_workers_wait_neither_for_trimesh_nor_for_rich_nor_for_opengl():
    loaded = modules_after(
        "import scene.render.__main__, scene.dataset.export, scene.render.opengl.renderer\n"
        "from scene.assets.catalogue import FAMILIES, asset\n"
        "assets = [asset(family, 0) for family in FAMILIES]"
    )
    assert "scene" in loaded and not loaded & {"trimesh", "networkx", "rich", "OpenGL"}


LIBRARIES = ("scene", "seg", "sdr_jax")
MACHINERY = ("config", "targets", "evaluation", "session", "attribute_search", "tables")
"""Folders of `experiments`; each imports from those before it only."""
BELOW: dict[str, tuple[str, ...]] = {
    "common": (),
    **{library: ("common",) for library in LIBRARIES},
    **{
        f"experiments.{folder}": (
            "common", *LIBRARIES, *(f"experiments.{before}" for before in MACHINERY[:k])
        )
        for k, folder in enumerate((*MACHINERY, "app"))
    },
}  # fmt: skip
"""What each package or folder may import from, beside itself."""
BELOW["experiments.studies"] = BELOW["experiments.app"]
BELOW["experiments"] = (*BELOW["experiments.app"], "experiments.app", "experiments.studies")
"""The commands."""


def modules() -> dict[str, Path]:
    """The files of all packages by module."""
    packages = {name.partition(".")[0] for name in BELOW}
    paths = [path for package in packages for path in (ROOT / package).rglob("*.py")]
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in paths]
    return dict(zip((name.removesuffix(".__init__") for name in names), paths, strict=True))


FILES = modules()


def imported(text: str) -> Iterator[str]:
    """Our modules that a text imports, also within functions."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in FILES)
        elif isinstance(node, ast.ImportFrom) and node.module in FILES:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from (name if name in FILES else node.module for name in names)


def folder(module: str) -> str:
    """The key of `BELOW` for a module."""
    first, *others = module.split(".")
    inner = f"{first}.{others[0]}" if others else first
    return inner if inner in BELOW else first


def upward(module: str, text: str) -> list[str]:
    """What a module imports that is not below it."""
    own = folder(module)
    return sorted({name for name in imported(text) if folder(name) not in (own, *BELOW[own])})


def circle(graph: Mapping[str, set[str]]) -> list[str]:
    """The nodes of a circle, if there is any."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_imports_go_down_the_list_of_folders():
    folders = {folder(module) for module in FILES}
    assert folders == BELOW.keys()
    wrong = {module: upward(module, path.read_text()) for module, path in FILES.items()}
    assert {module: names for module, names in wrong.items() if names} == {}


def test_libraries_of_rivals_alone_come_from_a_checkout():
    """`study searches` compares with methods of other libraries, which only benchmarks need."""
    outside = r"^ *(?:from|import) (?:benchmarks|scripts|tests)\b"
    lines = {name: re.findall(outside, path.read_text(), re.M) for name, path in FILES.items()}
    assert {name: len(found) for name, found in lines.items() if found} == {
        "experiments.config.method": 1
    }


def test_no_files_and_no_folders_of_experiments_import_each_other():
    files = {module: {*imported(path.read_text())} - {module} for module, path in FILES.items()}
    assert circle(files) == []
    folders: dict[str, set[str]] = {}
    for module, names in files.items():
        if module.count(".") > 1 and module.startswith("experiments."):
            own = module.rpartition(".")[0]
            others = {name.rpartition(".")[0] for name in names if name.count(".") > 1}
            folders.setdefault(own, set()).update(others - {own})
    assert "experiments.app.report" in folders["experiments.app"]
    assert circle(folders) == []


@pytest.mark.parametrize(("module", "text", "wrong"), [
    ("common.files", "def f():\n    from scene.version import ENGINE", ["scene.version"]),
    ("seg.train", "import scene.names", ["scene.names"]),
    ("scene.check", "from experiments import config", ["experiments.config"]),
    ("experiments.targets.base", "from experiments.session import session",
     ["experiments.session.session"]),
    ("experiments.tables.form", "from experiments import fit", ["experiments"]),
    ("experiments.app.export", "from experiments.studies.table import FORM", ["experiments.studies.table"]),
    ("experiments.studies.table", "from experiments.app import export", ["experiments.app.export"]),
    ("experiments.camvid", "from experiments.app.fit.command import main", []),
    ("experiments.app.export", "from experiments.tables import form\nfrom seg.train import train", []),
])  # fmt: skip
def test_an_import_of_what_lies_above_is_found(module, text, wrong):
    assert upward(module, text) == wrong


def test_a_circle_is_found():
    assert set(circle({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}})) == {"a", "b", "c"}
