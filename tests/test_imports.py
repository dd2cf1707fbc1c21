"""Each library can be had without the others, and `scene` without paying for JAX."""

from importlib import import_module

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


def test_workers_wait_neither_for_trimesh_nor_for_rich_nor_for_opengl():
    loaded = modules_after(
        "import scene.render.__main__, scene.dataset.export, scene.render.opengl.renderer\n"
        "from scene.assets.catalogue import FAMILIES, asset\n"
        "assets = [asset(family, 0) for family in FAMILIES]"
    )
    assert "scene" in loaded and not loaded & {"trimesh", "networkx", "rich", "OpenGL"}
