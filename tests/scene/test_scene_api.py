"""The names that ``import scene`` offers."""

import ast
import re
from pathlib import Path

import scene

ROOMS = (
    "names", "classes", "attributes", "version", "versions", "cache", "compiled", "streams",
    "proposal", "held", "look", "mesh", "sky", "ground", "assets", "street", "render",
    "outline", "dataset", "labelled", "preview", "check", "stats", "callback", "parsers",
)  # fmt: skip
"""Folders in order; each imports from earlier ones only."""


def test_imports_between_rooms_point_one_way():
    root, imports = Path(scene.__path__[0]), set()
    for path in sorted(root.rglob("*.py")):
        room = path.relative_to(root).parts[0].removesuffix(".py")
        if path.name == "__main__.py" or room == "__init__":
            continue  # a command uses what it likes; public names are imported on first use
        imports.add(room)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("scene."):
                other = node.module.split(".")[1]
                assert ROOMS.index(other) <= ROOMS.index(room), f"{path}: {node.module}"
    assert imports == set(ROOMS)


def test_the_example_in_the_docstring_runs():
    lines = [line[4:] for line in scene.__doc__.splitlines() if re.match(r"    \S", line)]
    exec("\n".join(lines), scope := {})
    images, labels = scope["dataset"]
    assert images.shape == (*labels.shape, 3) == (8, 120, 160, 3)
    assert labels[labels != 255].max() < 19
