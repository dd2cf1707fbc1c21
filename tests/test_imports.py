"""Each library can be had without the others, and `scene` without paying for JAX."""

import pytest

from tests.conftest import printed


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


def test_workers_wait_neither_for_trimesh_nor_for_rich_nor_for_opengl():
    loaded = modules_after(
        "import scene.render.__main__, scene.dataset.export, scene.render.opengl.renderer\n"
        "from scene.assets.catalogue import FAMILIES, asset\n"
        "assets = [asset(family, 0) for family in FAMILIES]"
    )
    assert "scene" in loaded and not loaded & {"trimesh", "networkx", "rich", "OpenGL"}
